// SPDX-License-Identifier: BSD-3-Clause
// What runs on a robot now, and in the last minutes: the statuses of its trees and its active states on the graphs.

import {byId} from './choice.js';
import {statusesAt} from './player.js';

export class Live {
  // studio has link, file, open (its files by name), treeFiles and told.
  constructor(studio, player) {
    Object.assign(this, {studio, player, isOn: false, robot: null, trees: new Map()});
    byId('live').addEventListener('click', () => this.toggle());
  }

  welcome(hasRobots) {
    byId('live').hidden = !hasRobots;
    if (this.isOn && hasRobots) this.watch();
  }

  toggle() { if (this.isOn) this.player.end(); else this.watch(); }

  async watch() {
    try {
      this.robot = await this.studio.link.request('watch');
      this.on(true);
      if (!this.player.isLive) this.player.play(`Robot ${this.robot}`, [], {isLive: true, owner: this, ended: () => this.on(false)});
      if (this.last?.robot === this.robot) this.take(this.last);
    } catch (refusal) {
      this.studio.told(refusal.message, 'warning');
    }
  }

  on(isOn) {
    this.isOn = isOn;
    byId('live').setAttribute('aria-pressed', String(isOn));
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
    const isLive = event.link === 'live';
    byId('live').className = isLive ? 'good' : 'warning';
    const moment = {time: performance.now() / 1000, title: `${isLive ? '' : 'NO LINK, last known state: '}${event.behavior || 'no behavior'} ${event.state}`, event};
    // Lines and statuses are made when they are shown: the places of a tree's nodes may arrive later.
    Object.defineProperty(moment, 'lines', {get: () => this.lines(event)});
    moment.statuses = () => this.statuses(event);
    this.player.push(moment);
  }

  // The trees of an event that are shown: of several runs of one tree that which runs, or else the last.
  shown(event) { return [...new Map([...event.trees].sort((one, other) => one.running - other.running).map((one) => [one.tree, one])).values()]; }

  // The places of a tree's nodes: {nodes, isSame}, or null while they are asked for. isSame tells whether the tree of the robot has
  // the nodes that the file has.
  places(tree) {
    if (!this.trees.has(tree.tree)) {
      this.trees.set(tree.tree, null);
      const {file, link} = this.studio, {trees} = this;
      link.request('trees', {file: file?.name ?? ''}).then((files) => (files[tree.tree] ? link.request('run_nodes', {file: files[tree.tree], tree: tree.tree}) : {}))
        .then((nodes) => { trees.set(tree.tree, nodes); if (this.player.isLive) this.player.again(); }).catch(() => trees.delete(tree.tree));
    }
    const nodes = this.trees.get(tree.tree);
    return nodes && {nodes, isThere: Object.keys(nodes).length > 0, isSame: !tree.nodes || Object.keys(nodes).length === tree.nodes && Object.keys(tree.statuses).every((path) => nodes[path])};
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
