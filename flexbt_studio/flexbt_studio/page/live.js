// SPDX-License-Identifier: BSD-3-Clause
// What runs on a robot now, and in the last minutes: the statuses of its trees and its active states on the graphs.

import {ask} from './choice.js';
import {byId} from './elements.js';
import {statusesAt} from './player.js';
import {RECORDING} from './recordings.js';

const AGAIN_MS = 2000;  // until a robot that was not found is looked for again

export class Live {
  // studio has link, file, open (its files by name), treeFiles and told.
  constructor(studio, player) {
    Object.assign(this, {studio, player, isOn: false, robot: null, trees: new Map()});
    byId('live').addEventListener('click', () => this.toggle());
  }

  welcome(hasRobots, isNewServer) {
    byId('live').hidden = !hasRobots;
    if (isNewServer && this.isOn && !this.isRecording) this.player.forget();
    if (this.isOn && (hasRobots || this.isRecording)) this.watch();
  }

  toggle() { if (this.isOn) this.player.end(); else this.watch(this.isRecording ? '' : undefined); }
  get isRecording() { return Boolean(this.robot?.startsWith(RECORDING)); }

  // Watch a robot; without a name the one before, or else the own one.
  async watch(robot = this.robot ?? '') {
    const asked = this.asked = {}, isOver = () => this.asked !== asked;  // another was asked for since, or it was turned off
    try {
      const now = await this.studio.link.request('watch', {robot});
      if (isOver()) return;
      if (this.player.isLive && now !== this.robot) { this.player.end(); this.asked = asked; }
      this.robot = now;
      this.studio.debugger.connect(now);
      const begin = this.isRecording ? await this.at(0) : null;
      if (isOver()) return;
      this.on(true);
      if (!this.player.isLive) this.player.play(begin ? now.replace(RECORDING, 'Recording ') : `Robot ${now}`, begin ? [begin] : [], {isLive: true, owner: this, ended: () => { this.on(false); this.studio.recordings.ended(); }});
      if (this.last?.robot === now) this.take(this.last);
    } catch (refusal) {
      if (isOver()) return;
      if (!this.isOn || robot !== this.robot || this.isRecording) { this.studio.told(refusal.message, 'warning'); return; }
      this.lost(refusal.message);
      if (refusal.kind !== 'lost') setTimeout(() => { if (!isOver()) this.watch(); }, AGAIN_MS);  // it may be found later
    }
  }

  // Nothing is heard of the robot: what is shown is its last known state.
  lost(problem) {
    const event = this.player.isLive && !this.isRecording ? this.player.moments.at(-1)?.event : null;
    if (event && event.problem !== problem) this.take({...event, link: 'lost', problem});
  }

  commands(page) {
    return [
      page('live', 'What the robot does now: show or hide', null, () => this.toggle()),
      page('groot2', 'Watch a program with Groot2\'s port (BehaviorTree.CPP)', null, async () => {
        const address = await ask('Address of the program', '127.0.0.1:1667', 'HOST:PORT. Programs with a Groot2Publisher, and bt_server with groot2_port, can be watched.');
        if (address) this.watch(`groot2 ${address}`);
      }),
    ];
  }

  on(isOn) {
    this.isOn = isOn;
    if (!isOn) this.asked = null;
    if (isOn && !this.isRecording) byId('live').hidden = false;
    byId('live').setAttribute('aria-pressed', String(isOn && !this.isRecording));
    if (!isOn) byId('live').className = '';
  }

  // A graph has changed: the nodes of the trees are at other places.
  viewed() {
    this.trees.clear();
    if (this.player.isLive) this.player.again();
  }

  take(event) {
    this.last = event;
    if (!this.isOn || event.robot !== this.robot || !this.player.isLive) return;
    byId('live').className = event.link === 'live' ? 'good' : 'warning';
    this.player.push(this.moment(event));
  }

  moment(event) {
    const isLive = event.link === 'live';
    const moment = {time: performance.now() / 1000, title: `${isLive ? '' : `NO LINK, last known state${event.problem ? ` (${event.problem})` : ''}: `}${event.behavior || 'no behavior'} ${event.state}`, event};
    // Lines and statuses are made when they are shown: the places of a tree's nodes may arrive later.
    Object.defineProperty(moment, 'lines', {get: () => this.lines(event)});
    moment.statuses = () => this.statuses(event);
    return moment;
  }

  // The past of the robot, which the server keeps: lanes since a revision, or null if it has none; what was at a time.
  lanes(revision) { return this.studio.link.request('past', {robot: this.robot, revision}); }
  async at(time) {
    const event = await this.studio.link.request('past', {robot: this.robot, time, ...(this.isRecording ? {map: this.studio.recordings.map} : {})});
    if (event.robot === this.robot) this.studio.recordings.show(event);
    return this.moment(event);
  }

  // The trees of an event that are shown: of several runs of one tree that which runs, or else the last.
  shown(event) { return [...new Map([...event.trees].sort((one, other) => one.running - other.running).map((one) => [one.tree, one])).values()]; }

  // The places of a tree's nodes: {nodes, isThere, isSame}, or null while they are asked for. isSame tells whether the tree of the
  // robot has the nodes that the file has.
  places(tree) {
    const key = `${tree.tree}\n${tree.file ? tree.run : ''}`, {trees} = this;
    if (!trees.has(key)) {
      trees.set(key, null);
      this.find(tree).then((nodes) => { trees.set(key, nodes); if (this.player.isLive) this.player.again(); }).catch(() => trees.delete(key));
    }
    const nodes = trees.get(key);
    return nodes && {nodes, isThere: Object.keys(nodes).length > 0, isSame: isSame(tree, nodes)};
  }

  // Of a program that sends its tree as a file, that file is shown if the project has no such tree.
  async find(tree) {
    const {file, link} = this.studio, files = await link.request('trees', {file: file?.name ?? ''});
    const nodes = (owner) => (owner ? link.request('run_nodes', {file: owner, tree: tree.tree}) : {});
    const own = await nodes(files[tree.tree]);
    if (!tree.file || isSame(tree, own)) return own;
    if (this.sent !== tree.file) { this.sent = tree.file; this.studio.go(tree.file); }
    return nodes(tree.file);
  }

  // The open file of the machine that runs, or null; isSame tells whether it has all active states.
  machine(event) {
    const found = [...this.studio.open.values()].find(({name, view}) => view.states && event.behavior && (view.behavior?.name || name.split('/').at(-1).replace(/\.[a-z]+$/, '')) === event.behavior);
    return found ? {file: found, isSame: event.active.every((path) => found.parts.has(path))} : null;
  }

  statuses(event) {
    const machine = this.machine(event), found = machine?.isSame ? statusesAt(event.active.map((path) => [path, 'RUNNING']), (path) => [machine.file.name, path]) : new Map();
    for (const tree of this.shown(event)) {
      const places = this.places(tree);
      if (places?.isSame) for (const [place, status] of statusesAt(Object.entries(tree.statuses).filter(([, status]) => status !== 'IDLE'), (path) => places.nodes[path])) found.set(place, status);
    }
    return found;
  }

  lines(event) {
    const machine = this.machine(event);
    return [
      ...event.active, ...(machine && !machine.isSame ? [`✗ the robot runs another version of the machine ${event.behavior}`] : []),
      ...this.shown(event).map((tree) => {
        const places = this.places(tree);
        if (places && !places.isThere) return `the tree ${tree.tree} is not in this project`;
        if (places && !places.isSame) return `✗ the robot runs another version of the tree ${tree.tree}`;
        return `${tree.tree}: ${tree.running ? 'running' : 'ended'}`;
      }),
    ];
  }
}

// Whether a tree that runs has these nodes, as far as is known of it.
export const isSame = (tree, nodes) => !tree.nodes || (Object.keys(nodes).length === tree.nodes && Object.keys(tree.statuses).every((path) => nodes[path]));

// The debugger's link to a program with Groot2's port, which takes some lines of the operator.
export class ProgramLink {
  constructor(on, robot, link) {
    Object.assign(this, {on, robot, link});
    queueMicrotask(() => { on.state(true, '', ''); on.parts({link: {state: 'live'}}); on.message({hello: {operator: ''}}); });
  }

  send({do: line}) {
    this.link.request('groot2', {robot: this.robot, do: line}).then((data) => { if (data) this.on.message({read: {title: 'tree blackboard', data}}); }, (refusal) => this.on.message({told: {text: refusal.message, tone: 'warning'}}));
    return true;
  }

  close() {}
}
