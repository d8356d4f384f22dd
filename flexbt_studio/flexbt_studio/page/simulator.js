// SPDX-License-Identifier: BSD-3-Clause
// A simulated robot: start it in a world, run the open file on it, watch it on the map, and let something go wrong.

import {byId, html} from './elements.js';
import {MapPane} from './map_pane.js';
import {ServerLink} from './server_link.js';

export const SIMULATION = 'simulation';
const SERVERS = ['follow_path', 'compute_path_to_pose', 'compute_path_through_poses', 'smooth_path', 'spin', 'backup', 'drive_on_heading', 'wait', 'assisted_teleop', 'dock_robot', 'undock_robot', 'compute_route'];
// What may go wrong: {text, of: what is chosen, level: what is typed, fault(chosen, level): [fault, entity, parameters]}.
const FAULTS = [
  {text: 'door is shut and jams', of: ({doors}) => doors, fault: (door) => ['door_jammed', door, {where: 'closed'}]},
  {text: 'battery drops to a level, %', level: 10, fault: (_, level) => ['battery_low', '', {level: level / 100}]},
  {text: 'server fails', of: () => SERVERS, fault: (server) => ['server_fails', '', {server, error_msg: 'a fault of the simulation'}]},
  {text: 'server hangs', of: () => SERVERS, fault: (server) => ['server_hangs', '', {server}]},
  {text: 'server refuses goals', of: () => SERVERS, fault: (server) => ['server_refuses', '', {server}]},
  {text: 'wheels are stuck', fault: () => ['stuck_wheel', '', {side: 'both'}]},
  {text: 'localization is off by a distance, m', level: 1, fault: (_, level) => ['localization_lost', '', {jump: [level, 0, 0]}]},
  {text: 'lidar sends nothing', fault: () => ['sensor_silent', '', {sensor: 'lidar'}]},
];
const BUILT_IN = 'built-in map';

export class Simulator {
  // studio has link, file, told, live, allowCode and jobs.
  constructor(studio) {
    Object.assign(this, {studio, state: {state: 'ended', doors: [], robots: []}, link: null, known: {}, taken: []});
    const button = (id, text, run, more = {}) => html('button', {type: 'button', id: `sim-${id}`, onclick: run, ...more}, text);
    this.worlds = html('select', {id: 'sim-world', 'aria-label': 'world'}, html('option', {value: ''}, BUILT_IN));
    this.speed = html('input', {id: 'sim-speed', type: 'number', min: 0.1, max: 100, step: 'any', value: 1, 'aria-label': 'simulated seconds in a second', title: 'Simulated seconds in a second'});
    this.goal = html('input', {id: 'sim-goal', placeholder: 'place, or x y yaw', 'aria-label': 'goal: a place, or x y yaw', spellcheck: 'false'});
    this.asked = html('p', {id: 'sim-asked', class: 'warning', hidden: true});
    this.what = html('select', {id: 'sim-what', 'aria-label': 'what goes wrong', onchange: () => this.offer()}, ...FAULTS.map(({text}, at) => html('option', {value: at}, text)));
    this.which = html('select', {id: 'sim-which', 'aria-label': 'of which'});
    this.level = html('input', {id: 'sim-level', type: 'number', step: 'any', 'aria-label': 'how much'});
    this.panel = html('div', {id: 'sim-on', hidden: true},
      html('div', {class: 'buttons'}, button('run', 'Run This File', () => this.run(), {class: 'primary'}), this.goal, button('cancel', 'End the Run', () => this.cancel()), html('a', {id: 'sim-operate', href: `simulator/${location.hash}`, target: '_blank', rel: 'noopener'}, "operator's page")),
      html('div', {class: 'buttons', role: 'group', 'aria-label': 'what if'}, 'What if: ', this.what, this.which, this.level, button('happen', 'Happens', () => this.happen()), button('over', 'All Faults End', () => this.end())),
      html('div', {class: 'buttons'}, button('drop', 'Drop Obstacles on the Map', () => this.aim(!this.drops), {'aria-pressed': 'false'}), button('take', 'Remove Them', () => { this.taken = (this.known.obstacles ?? []).map(([name]) => name); this.takeNext(); }, {disabled: true})));
    byId('runs').append(html('details', {id: 'simulator', name: 'job', ontoggle: (event) => { if (event.target.open) this.opened(); }}, html('summary', {}, 'Simulation', html('span', {id: 'sim-state', class: 'hint'})),
      html('p', {class: 'hint'}, 'A simulated robot on this computer, apart from all others: no real robot moves.'),
      html('div', {class: 'buttons'}, this.worlds, html('label', {}, 'speed ', this.speed), button('start', 'Start', () => this.toggle())), this.panel));
    this.view = new MapPane('sim', 'SIMULATION', {
      pose: (...pose) => { this.goal.value = pose.map((one) => one.toFixed(2)).join(' '); },
      obstacle: (x, y) => this.link?.send({obstacle: [x, y]}),
      leave: () => this.aim(false),
      costmaps: 'simulator/costmaps',
    }, this.asked);
    this.map = this.view.map;
    this.offer();
  }

  commands(page) { return [page('simulate', 'Simulation: start a robot, run this file, what if', null, () => { this.studio.jobs.open('simulator'); })]; }

  // Ask the studio for something of the simulation.
  ask(method, args = {}) { return this.studio.link.request(`simulator_${method}`, args); }

  async opened() {
    const found = await this.ask('worlds'), now = this.worlds.value;
    this.worlds.replaceChildren(html('option', {value: ''}, BUILT_IN), ...found.map((name) => html('option', {value: name}, name)));
    this.worlds.value = found.includes(now) ? now : '';
  }

  // The page is connected; a simulated robot that it has started has ended with the connection before.
  async welcome() { this.take(await this.ask('state').catch(() => null) ?? {...this.state, state: 'ended', message: ''}); }

  async toggle() {
    if (this.state.state === 'ended') await this.ask('start', {world: this.worlds.value, speed: Number(this.speed.value)});
    else await this.ask('stop');
  }

  take(state) {
    const before = this.state.state, isOn = state.state !== 'ended';
    this.state = state;
    byId('sim-state').textContent = {starting: 'starting…', running: `running at speed ${state.speed}`, ended: state.message ? 'ended' : ''}[state.state];
    byId('sim-start').textContent = isOn ? 'Stop' : 'Start';
    this.worlds.disabled = this.speed.disabled = isOn;
    this.panel.hidden = !(this.view.isShown = state.state === 'running');
    if (before === state.state) return;
    if (!isOn) {
      this.link?.close();
      Object.assign(this, {link: null, taken: []});
      this.map.costmaps.leave();
      if (state.message) this.studio.told(`Simulation: ${state.message}`, 'error');
      if (this.studio.live.robot !== SIMULATION) return;
      this.studio.live.robot = null;
      if (this.studio.live.isOn) this.studio.player.end();
      this.studio.debugger.leave();
    } else if (state.state === 'running') {
      this.view.clear();
      this.link = new ServerLink({parts: (parts) => this.show(parts), map: (head, cells) => this.map.setMap(head, cells), message: ({told, read}) => { if (told ?? read) this.studio.told((told ?? read).text, told?.tone ?? ''); }, state: () => {}}, () => '', 'simulator/link');
      this.map.costmaps.open();
      this.aim(false);
      this.offer();
      this.studio.live.watch(SIMULATION);
      this.studio.told('The simulated robot is there', 'good');
    }
  }

  // What the operator's page of the robot is told.
  show(parts) {
    Object.assign(this.known, parts);
    this.view.show(parts);
    if ('obstacles' in parts) { byId('sim-take').disabled = !parts.obstacles.length; this.takeNext(); }
    if (!('decisions' in parts)) return;
    const asked = parts.decisions.find((one) => one.kind === 'input');
    this.asked.hidden = !asked;
    this.asked.replaceChildren(...(asked ? [`? ${asked.line} `, html('button', {type: 'button', onclick: () => this.link?.send({answer: this.goal.value, decision: asked.id})}, 'Answer with the Goal')] : []));
  }

  // Remove the next obstacle once one is gone: the server takes four requests of a page at a time.
  takeNext() {
    const name = this.taken.shift();
    if (name) this.link?.send({remove_obstacle: name});
  }

  // A click on the map drops an obstacle, or else is the goal.
  aim(drops) {
    this.drops = drops;
    byId('sim-drop').setAttribute('aria-pressed', String(drops));
    this.map.setMode(drops ? 'obstacle' : 'pose');
  }

  async run() {
    const {studio} = this, {file} = studio;
    if (!file) { studio.told('Open a file to run', 'warning'); return; }
    if (file.language === 'python' && !await studio.allowCode()) return;
    await file.settled();
    const selected = studio.part(file.selected)?.data.tree ?? file.view.trees?.[0]?.path, tree = file.view.main || (file.view.trees ?? []).find((one) => one.path === selected)?.id || '';
    studio.told(`Running ${file.name} in the simulation`);
    const started = await this.ask('run', {file: file.name, tree, goal: this.goal.value});
    if (started && !this.link?.send({do: `start ${started} --autonomy full`})) studio.told('There is no connection to the simulated robot', 'error');
  }

  cancel() {
    this.ask('cancel');
    if (this.known.status?.running) this.link?.send({do: 'stop'});
  }

  // What can be chosen for what goes wrong.
  offer() {
    const {of, level} = FAULTS[this.what.value], found = of?.(this.state) ?? [];
    this.which.hidden = !of;
    this.which.replaceChildren(...found.map((one) => html('option', {}, one)));
    this.level.hidden = level === undefined;
    this.level.value = level ?? '';
  }

  async happen() {
    const chosen = FAULTS[this.what.value], [fault, entity, parameters] = chosen.fault(this.which.value, Number(this.level.value));
    if (chosen.of && !this.which.value) { this.studio.told(`There is none in this world: ${chosen.text}`, 'warning'); return; }
    const text = [this.which.hidden ? '' : this.which.value, chosen.text, this.level.hidden ? '' : this.level.value].filter(Boolean).join(' ');
    await this.ask('what_if', {fault, entity: entity || this.robot, parameters, clear: false});
    this.studio.told(`Simulation: ${text}`, 'warning');
  }

  async end() {
    for (const entity of [this.robot, ...this.state.doors]) await this.ask('what_if', {fault: '', entity, parameters: {}, clear: true});
    this.studio.told('Simulation: all faults have ended');
  }

  get robot() { return this.state.robots[0] ?? ''; }
}
