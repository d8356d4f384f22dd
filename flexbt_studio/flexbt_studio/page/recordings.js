// SPDX-License-Identifier: BSD-3-Clause
// Recordings: of robots and incidents, and logs of trees, on the same graphs as what runs now.

import {choose} from './choice.js';
import {byId, html} from './elements.js';
import {lineOf} from './jobs.js';
import {MapPane} from './map_pane.js';

export const RECORDING = 'recording ';
const size = (bytes) => (bytes < 1e6 ? `${Math.ceil(bytes / 1000)} kB` : `${(bytes / 1e6).toFixed(1)} MB`);

export class Recordings {
  // studio has link, go, told, live, jobs, player and treeFiles.
  constructor(studio) {
    Object.assign(this, {studio, map: ''});
    const button = (id, text, run) => html('button', {type: 'button', id: `recordings-${id}`, onclick: run}, text);
    this.pane = new MapPane('recorded', 'RECORDED');
    this.log = html('ol', {id: 'recordings-log', class: 'list', 'aria-label': 'log up to the moment that is shown'});
    byId('runs').append(html('details', {id: 'recordings', name: 'job'}, html('summary', {}, 'Recordings', html('span', {id: 'recordings-state', class: 'hint'})),
      html('p', {class: 'hint'}, 'What a robot did, on the graphs: runs and incidents of a recorder, logs of trees (.btlog).'),
      html('div', {class: 'buttons'}, button('open', 'Open a Recording…', () => this.choose()), button('failure', 'Last Failure', () => this.failure()), button('decide', 'Would It Decide Otherwise?', () => this.decide())),
      html('div', {id: 'recordings-decided', 'aria-live': 'polite'}), this.log));
  }

  commands(page) { return [page('recordings', 'Open a recording of a robot, or a log of a tree', null, () => this.choose()), page('last_failure', 'Last failure of the recording or robot that is shown', null, () => this.failure()),
    page('decide', 'Would the open file decide otherwise in this recording?', null, () => this.decide())]; }

  async choose() {
    const {studio} = this;
    studio.jobs.open('recordings');
    const all = await studio.link.request('recordings');
    if (!all.length) { studio.told('There is no recording. The program recorder makes them; studio --recordings names their folder', 'warning'); return; }
    const chosen = await choose('Open a recording', all.map(({name, bytes, changed}) => ({label: name, detail: `${new Date(1000 * changed).toLocaleString()}, ${size(bytes)}`})));
    if (chosen) await this.open(chosen.label);
  }

  async open(name) {
    const {studio} = this, {live, player, jobs} = studio;
    if (name.endsWith('.btlog')) { await this.openLog(name); return; }
    this.map = '';
    await live.watch(`${RECORDING}${name}`);
    if (live.robot !== `${RECORDING}${name}` || !live.isOn) return;
    byId('recordings-state').textContent = name;
    const reached = await studio.link.request('reached', {name});
    for (const [tree, paths] of Object.entries(reached)) {
      const nodes = await live.find({tree, nodes: 0, statuses: {}});
      if (paths.every((path) => nodes[path])) jobs.cover(nodes, paths);
      if (!studio.file && studio.treeFiles[tree]) await studio.go(studio.treeFiles[tree]);
    }
    jobs.show();
    player.again();
  }

  // Feed the recording that is shown to the open file, and tell the first decision that differs.
  async decide() {
    const {studio} = this, {live, jobs, file} = studio, recording = live.robot?.startsWith(RECORDING) ? live.robot.slice(RECORDING.length) : '';
    if (!file || !recording || !live.isOn) { studio.told('Open a recording of a robot, and a tree or behavior that it used', 'warning'); return; }
    jobs.open('recordings');
    const told = (part) => {
      byId('recordings-decided').replaceChildren(html('p', {class: 'hint'}, `${recording}, decided again by ${file.name}:`), part);
      part.scrollIntoView({block: 'nearest'});
    };
    told(html('p', {}, 'feeding the robot with the recording…'));
    const entry = await jobs.start(jobs.decisions, 'decide', file, {recording});
    if (jobs.decisions.get(file.name)?.state === 'running') return;  // it was asked again meanwhile
    if (entry) told(html('pre', {class: entry.event.result[0].differs ? 'warning' : 'good'}, entry.event.result[0].text));
    else told(html('p', {class: 'error'}, jobs.decisions.get(file.name)?.message ?? 'it was ended'));
  }

  // A log of one tree, on its own graph, or on that of the log if the project has another tree or none.
  async openLog(name) {
    const {studio} = this, {live, jobs, player} = studio, asked = live.asked = {}, isOver = () => live.asked !== asked;  // another was asked for since
    const {file, tree, nodes: count, events, epoch} = await studio.link.request('tree_log', {name});
    const nodes = await live.find({tree, file, nodes: count, statuses: Object.fromEntries(events.map((one) => [one.path, one.after]))});
    const [owner] = Object.values(nodes)[0] ?? [file];
    if (isOver()) return;
    await studio.go(owner);
    if (isOver()) return;
    const end = {time: events.at(-1)?.time ?? 0, blackboard: {}}, lines = [...events.map(lineOf), `${name}: begun ${new Date(1000 * epoch).toLocaleString()}, ${events.length} transitions`];
    this.entry = {events, end, lines, event: {nodes}, files: new Set(Object.values(nodes).map(([one]) => one)), state: 'done'};
    player.play(`Log of ${tree}`, jobs.momentsOf(this.entry), {owner: this.entry, ended: () => this.ended()});
    byId('recordings-state').textContent = name;
    jobs.cover(nodes, events.filter((one) => !['IDLE', 'SKIPPED'].includes(one.after)).map((one) => one.path));
    jobs.show();
  }

  // What a moment of the past shows besides the graphs.
  show({robot, seen, map, cells}) {
    const isRecorded = robot.startsWith(RECORDING);
    if (isRecorded && map !== this.map && !cells) this.pane.clear();
    if (isRecorded && cells) this.pane.map.setMap(cells, Uint8Array.from(atob(cells.cells), (one) => one.charCodeAt(0)));
    if (isRecorded) this.map = map;
    if (isRecorded) this.pane.show(seen);
    this.pane.isShown = isRecorded && this.pane.map.hasContent();
    this.log.replaceChildren(...seen.log.map(({text, tone}) => html('li', {class: tone}, text)));
    this.log.scrollTop = this.log.scrollHeight;
  }

  ended() {
    this.pane.isShown = false;
    this.log.replaceChildren();
    byId('recordings-state').textContent = '';
  }

  failure() {
    const {studio, entry} = this, {player} = studio;
    if (entry && player.owner === entry) {
      const at = entry.events.findLastIndex((one) => one.after === 'FAILURE');
      if (at < 0) studio.told('No node has failed in this log'); else player.go(at);
    } else if (player.isLive && player.hasPast) { player.timeline.at = null; player.timeline.jump('failure', -1); }
    else studio.told('Open a recording first, or turn Live on', 'warning');
  }
}
