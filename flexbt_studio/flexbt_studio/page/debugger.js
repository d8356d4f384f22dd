// SPDX-License-Identifier: BSD-3-Clause
// The debugger of a robot's trees and machine. Its commands are lines of the operator's page, and go the way of those.

import {ask, choose} from './choice.js';
import {word} from './commands.js';
import {REACTION_MS} from './decision.js';
import {byId, html, svg} from './elements.js';
import {widthOf} from './graph.js';
import {isSame, ProgramLink} from './live.js';
import {placeOf} from './player.js';
import {ServerLink} from './server_link.js';
import {sheet} from './sheets.js';
import {SIMULATION} from './simulator.js';

const SIGNS = {HELD: '‖', WAITS: '?', breakpoint: '●', force: '⇒', dummy: '◆'};
const FONT = '600 12px system-ui, sans-serif';
const LONGEST = 20000;    // characters of a line; the executive takes less
const ANSWER_MS = 3000;   // a held tree is let go once, unless the robot does not answer within this time
const TOLD = 50;          // lines of the log
const FIRST_WALL = 1e8;   // s; a time before it is one of a simulation
const RESULTS = ['SUCCESS', 'FAILURE'].map((label) => ({label}));

const keyOf = (hold) => `${hold.run} ${hold.since}`;
const lastOf = (path) => path.split('/').at(-1).replace(/::\d+$/, '');
const list = (lines) => html('ul', {}, ...lines.map((line) => html('li', {}, line)));
const timeOf = (stamp) => (!stamp ? '' : stamp >= FIRST_WALL ? new Date(1000 * stamp).toLocaleTimeString() : `${stamp.toFixed(1)} s`);

export class Debugger {
  // studio has file, part, told, link, graph, player, go, save and treeFiles. live knows what runs, and where that is in the files.
  constructor(studio, live) {
    Object.assign(this, {studio, live, robot: null, server: null, event: {}, known: {}, seen: new Map(), readers: {}, turned: -Infinity});
    const act = (id, text, keys, run) => html('button', {type: 'button', id: `debug-${id}`, title: keys && `${keys}`, onclick: run}, text);
    this.stops = [...document.querySelectorAll('.stop')];  // in the dialogs, too
    for (const one of this.stops) one.addEventListener('click', () => this.do('stop'));
    this.bar = html('div', {id: 'held', role: 'alert', class: 'bar', tabindex: '-1'});
    this.who = html('p', {id: 'debug-who', class: 'hint'});
    this.buttons = html('fieldset', {class: 'buttons', 'aria-label': 'at the selected item'},
      act('break', 'Breakpoint', 'b', () => this.toggle()), act('if', 'Breakpoint If…', 'B', () => this.toggle(true)), act('run-to', 'Run to Here', 'Ctrl+F10', () => this.runTo()),
      act('force', 'Force Result…', 'f', () => this.give('force')), act('dummy', 'Dummy…', 'd', () => this.give('dummy')), act('pause', 'Pause', 'p', () => this.pause()));
    this.set = html('ul', {id: 'debug-set', class: 'list', tabindex: '-1', 'aria-label': 'what is set'});
    this.data = html('div', {id: 'debug-data'});
    this.log = html('ol', {id: 'debug-log', class: 'list', 'aria-label': 'answers of the robot'});
    this.pane = html('details', {id: 'debug', open: true, hidden: true}, html('summary', {}, 'Debugger'), this.who, this.buttons,
      html('div', {class: 'buttons'}, act('why', 'Why Not Running', 'q', () => this.why()), act('board', 'Blackboard', '', () => this.board()), act('userdata', 'Userdata', '', () => this.do('userdata', null, true)), act('switch', 'Use This Version…', '', () => this.offer())), this.set, this.data, this.log);
    byId('alarm').after(this.bar);
    byId('runs').prepend(this.pane);
    addEventListener('keydown', (event) => {  // in a dialog, too
      if (!this.link || event.key !== 'F5' || !event.shiftKey) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      if (!event.repeat) this.do('stop');
    }, {capture: true});
    addEventListener('beforeunload', (event) => { if (this.server && this.event.holds?.length) event.preventDefault(); });  // the bar tells what stays held
  }

  // Join the robot that is watched, as the operator of this browser: where its operator's page is served, too, or by Groot2's protocol.
  connect(robot) {
    const isProgram = robot.startsWith('groot2 '), path = robot === SIMULATION ? 'simulator/link' : location.pathname.endsWith('/studio/') && !this.live.isRecording ? '../link' : '';
    if (robot === this.robot && this.link) return;
    this.link?.close();
    Object.assign(this, {robot, link: null, server: null, event: {}, known: {}, drawn: ''});
    const mine = (act) => (...words) => { if (this.robot === robot) act(...words); };
    const on = {parts: mine((parts) => this.takeParts(parts)), message: mine((message) => this.take(message)), map: () => {}, state: mine((isOpen, name, text) => { this.server = {isOpen, name, text}; this.known.link = null; this.draw(); })};
    if (isProgram) this.link = new ProgramLink(on, robot, this.studio.link);
    else if (path) this.link = new ServerLink(on, () => (robot === SIMULATION ? '' : `?robot=${encodeURIComponent(robot)}`), path);
    this.draw();
  }

  takeParts(parts) {
    const before = this.known.actions?.pause;
    Object.assign(this.known, parts);
    if (before && before.lines[0] !== this.known.actions.pause.lines[0]) this.turned = performance.now();  // Pause means something else now
    this.draw();
  }

  // The simulated robot that was watched has ended.
  leave() {
    this.link?.close();
    Object.assign(this, {robot: null, link: null, server: null, event: {}, known: {}});
    this.draw();
  }

  get isOn() { return Boolean(this.link) && this.live.isOn; }

  commands() {
    const live = (id, title, keys, run) => ({id: `debug_${id}`, title, keys, run, where: 'live'});
    return [
      live('stop', 'STOP the run and the robot', ['Shift+F5'], () => this.do('stop')), live('continue', 'Continue the held tree, or confirm the held transition', ['F5'], () => this.goOn()),
      live('step', 'Tick the held tree once; of a machine, step into', ['F11'], () => this.step('into')), live('over', 'Step over', ['Ctrl+F11'], () => this.step('over')), live('out', 'Step out', ['Shift+F11'], () => this.step('out')),
      live('run_to', 'Run to the selected node', ['Ctrl+F10'], () => this.runTo()), live('break', 'Set or clear a breakpoint', ['b'], () => this.toggle()), live('if', 'Set a breakpoint with a condition', ['B'], () => this.toggle(true)),
      live('force', 'Force a result of the node, once', ['f'], () => this.give('force')), live('dummy', 'Replace the node by a dummy, or take it away', ['d'], () => this.give('dummy')), live('pause', 'Pause the tree, or the run of a machine', ['p'], () => this.pause()),
      live('why', 'Why the node is not running', ['q'], () => this.why()), live('board', 'Show the blackboard and who wrote it', null, () => this.board()), live('userdata', 'Show the userdata and who wrote it', null, () => this.do('userdata', null, true)),
      live('switch', 'Let the robot use this version of the file', null, () => this.offer()),
    ];
  }

  // Send a line of the operator, which belongs to a decision or to none. With data, its answer comes as a value.
  do(line, decision = null, data = false) {
    if (line.length > LONGEST) this.told(`The command has ${line.length} characters, ${LONGEST} are possible; nothing was sent`, 'warning');
    else if (this.studio.player.showsPast && line !== 'stop') this.told('The player shows the past; nothing was sent. Go back to now first (Esc in the player); only STOP is sent from here', 'warning');
    else if (!this.link?.send({do: line, decision, data})) this.told('There is no connection to the operator\'s page; nothing was sent', 'error');
  }

  told(text, tone) {
    this.studio.told(text, tone);
    this.log.prepend(html('li', {class: tone}, text));
    while (this.log.childElementCount > TOLD) this.log.lastElementChild.remove();
  }

  take({hello, told, read, refused}) {
    if (hello) { this.operator = hello.operator; this.drawn = ''; this.draw(); for (const hold of this.event.holds ?? []) this.ask(hold); }
    if (refused) this.told(`${refused.word}: ${refused.text}`, 'warning');
    if (told) this.told(told.text, told.tone === 'plain' ? '' : told.tone);
    if (told?.text.startsWith('tree set')) this.board();
    if (!read) return;
    if (read.data && this.readers[read.title]) this.readers[read.title](read.data);
    else if (read.title === 'tree blackboard') this.showBoard(read.data);
    else if (read.title === 'userdata') this.showRows(read.data.flatMap(({path, values, writers, written}) => values.map((one, at) => [`${path} ${one.key}`, one.text, writers[at] || 'no state', timeOf(written[at])])), 'Userdata');
    else if (byId('sheet').open) this.told(`${read.title}: ${read.text}`, '');  // what is read or merged there stays
    else sheet(read.title, [html('pre', {}, read.text)]);
  }

  // What runs on the robot has changed.
  taken(event) {
    if (event.robot !== this.robot) return;
    const before = new Set((this.event.holds ?? []).map(keyOf));
    this.event = event;
    for (const hold of (event.holds ?? []).filter((one) => !before.has(keyOf(one)))) {
      this.told(`HELD: ${hold.text}`, 'warning');
      const place = this.place(event, hold);
      if (place && this.studio.player.isFollowing.checked) this.studio.follow(...place);
      if (this.server?.isOpen) this.ask(hold);
    }
    this.draw();
  }

  ask({run}) { this.do(`tree blackboard --run ${word(run)}`, null, true); }

  // Clear all that is set at a node: the BT server knows no parts of it.
  clear({tree, path}) {
    const marks = this.event.points.filter((one) => one.tree === tree && one.path === path).map((one) => one.mark);
    this.do(`tree clear ${word(path)} --tree ${word(tree)}`);
    if (marks.length > 1) this.told(`Cleared at ${lastOf(path)}: ${marks.join(', ')}`, '');
  }

  // The pane and the bar.

  draw() {
    const {event, known, server} = this, holds = event.holds ?? [], asked = (known.decisions ?? []).filter((one) => one.kind !== 'input');
    for (const one of this.stops) one.hidden = !this.link || this.link instanceof ProgramLink;
    this.pane.hidden = !this.link;
    const isObserver = this.operator === null, link = !server?.isOpen ? `${server?.name ?? 'CONNECTING'} ${server?.text ?? ''}` : known.link?.state === 'live' ? '' : 'NO LINK to the robot: what was last known; only STOP is sent';
    const seen = new Map(asked.map(({id}) => [id, this.seen.get(id) ?? performance.now()]));
    this.seen = seen;
    const key = JSON.stringify([holds, asked, event.points, event.breakpoints, link, this.operator, known.status?.authority, known.actions?.authority]);
    if (key === this.drawn) return;
    this.drawn = key;
    const focused = [this.bar, this.set].find((one) => one.contains(document.activeElement));
    const button = (text, run) => html('button', {type: 'button', disabled: isObserver, onclick: run}, text);
    this.bar.replaceChildren(...(link && (this.link || holds.length) ? [html('p', {class: 'error'}, link)] : []),
      ...holds.map((one) => html('p', {class: 'warning'}, html('b', {}, `${one.path ? '‖ HELD' : '‖ PAUSED'} `), `${one.text}. It stays so when this page is closed. ${one.acts.length ? `Still active: ${one.acts.join(', ')}. ` : ''}`, button('Step', () => this.release(one, 'step')), button('Continue', () => this.release(one, 'continue')))),
      ...asked.map((one) => html('p', {class: 'decision'}, html('b', {}, '? '), `${[one.line, ...one.reasons].join(' · ')} `, ...['into', 'over', 'out'].map((how) => button(`Step ${how}`, () => this.answer(`step ${how}`, one))), button('Confirm', () => this.answer('confirm', one)))));
    this.who.replaceChildren(isObserver ? 'Observer: look, and touch nothing. ' : `${this.robot} ${this.operator ? `· you: ${this.operator} ` : ''}`, known.status?.authority ? `· authority ${known.status.authority} ` : '',
      ...(isObserver ? [] : (known.actions?.authority?.lines ?? []).map((line) => html('button', {type: 'button', class: 'quiet', onclick: () => this.do(line)}, line))), this.robot?.startsWith('groot2 ') ? '' : html('a', {href: `${this.robot === SIMULATION ? 'simulator/' : `../?robot=${encodeURIComponent(this.robot ?? '')}`}${location.hash.replace(/[&#]?(file|node)=[^&]*/g, '')}`, target: '_blank', rel: 'noopener'}, "operator's page"));
    this.buttons.disabled = isObserver;
    const row = (text, tone, go, line) => html('li', {class: tone}, html('button', {type: 'button', onclick: go}, text), html('button', {type: 'button', class: 'quiet', disabled: isObserver, 'aria-label': `clear: ${text}`, title: 'Clear all that is set there', onclick: () => this.do(line)}, '×'));
    this.set.replaceChildren(...(event.points ?? []).map((one) => row(one.text, one.problem ? 'warning' : null, () => this.show(this.place(event, one)), `tree clear ${one.path ? word(one.path) : ''} --tree ${word(one.tree)}`)),
      ...(event.breakpoints ?? []).map((path) => row(`machine: breakpoint at ${path}`, null, () => { const machine = this.live.machine(event); if (machine) this.show([machine.file.name, path]); }, `clear ${word(path)}`)));
    if (focused?.childElementCount) focused.focus(); else if (focused) this.studio.graph.focus();  // no new button: a key that is on its way would press it
    this.studio.graph.on.drawn();
  }

  // The places of a tree's nodes in the files, by their paths in a run; none if it is in no file. A file that cannot be used is told,
  // and keeps no command from the robot.
  async nodes(tree) {
    return this.live.places(tree)?.nodes ?? await this.live.find(tree).catch((refusal) => { this.told(refusal.message, 'error'); return {}; });
  }

  async show(place) { if (place) await this.studio.go(place[0], () => place[1]); else this.told('It is not in the files of this project', 'warning'); }

  // The place in the files of a node of a tree of the robot, if they have this tree.
  place(event, {tree, path}) {
    const places = this.live.places(event.trees.find((one) => one.tree === tree) ?? {tree, nodes: 0, statuses: {}});
    return places?.isSame ? places.nodes[path] : null;
  }

  // Draw on the graph what is set and held at the moment that the player shows.
  paint(graph, file) {
    const {player} = this.studio, event = player.isLive ? (player.past ?? player.moments[player.at])?.event : null, marks = new Map();
    const put = (place, mark) => { if (place) marks.set(placeOf(...place), [...(marks.get(placeOf(...place)) ?? []), mark]); };
    if (event?.holds) {
      for (const one of event.holds) if (one.path) put(this.place(event, one), 'HELD');
      for (const one of event.points) if (one.path) put(this.place(event, one), one.mark + (one.condition ? ' if' : ''));
      const machine = this.live.machine(event);
      if (machine?.isSame) { for (const path of event.waiting) put([machine.file.name, path], 'WAITS'); for (const path of event.breakpoints) put([machine.file.name, path], 'breakpoint'); }
    }
    for (const item of graph.items) {
      const own = marks.get(placeOf(file, item.path)) ?? [], within = placeOf(file, item.path === '/' ? '/' : `${item.path}/`);
      const inside = item.isFolded ? [...marks].filter(([place]) => place.startsWith(within)).flatMap(([, texts]) => texts) : [];
      const text = [...own, ...inside.map((one) => `inside ${one}`)].map((one) => `${SIGNS[one.replace('inside ', '').split(' ')[0]] ?? '•'} ${one}`).join('  ');
      if ((item.debugged ?? '') === text) continue;
      item.debugged = text;
      const {element, box: [x, y, , height]} = item, label = item.label;
      item.plain ??= label;
      item.label = text ? `${item.plain}, ${[...own, ...inside].join(', ')}` : item.plain;
      element.setAttribute('aria-label', item.label + element.getAttribute('aria-label').slice(label.length));
      element.querySelector(':scope > .debug-mark')?.remove();
      element.classList.toggle('debug-held', own.includes('HELD') || own.includes('WAITS'));
      if (text) element.append(svg('g', {class: 'debug-mark'}, svg('path', {d: shape(x - 6, y + height - 3, widthOf(text, FONT) + 14)}), svg('text', {x: x + 1, y: y + height + 9.5}, text)));
    }
  }

  // The selected item.

  // What the user answers about the robot that is watched; null, after telling why, if another one is by then.
  async asked(answer) {
    const {robot} = this, given = await answer;
    if (given === null || robot === this.robot) return given;
    this.told(`${robot} is not watched any more; nothing was sent`, 'warning');
    return null;
  }

  // What the robot calls the selected item: {state}, or {tree, path, run} with an empty run if no such tree runs; null after telling why.
  async target() {
    const {studio, live, event} = this, {file} = studio, part = studio.part(file?.selected);
    const refuse = (text) => { this.told(text, 'warning'); return null; };
    if (!this.link || !event.trees) return refuse('Nothing is known of the robot yet; turn Live on');
    if (!part || part.kind === 'tree') return refuse('Select a node or a state');
    if (part.kind !== 'node') {
      const machine = live.machine(event);
      if (machine?.file !== file) return refuse(`The robot does not run the machine ${file.name}`);
      return machine.isSame ? {state: part.data.path} : refuse(`The robot runs another version of ${file.name}`);
    }
    const found = [], running = live.shown(event);
    const isHere = (nodes) => Object.entries(nodes).filter(([, [name, path]]) => name === file.name && path === part.path).map(([path]) => path);
    for (const tree of running) {
      const nodes = await this.nodes(tree), paths = isHere(nodes);
      if (paths.length && !isSame(tree, nodes)) return refuse(`The robot runs another version of the tree ${tree.tree}`);
      found.push(...paths.map((path) => ({tree: tree.tree, path, run: tree.running ? tree.run : ''})));
    }
    if (!found.length) for (const tree of Object.keys(studio.treeFiles)) found.push(...isHere(await this.nodes({tree})).map((path) => ({tree, path, run: ''})));
    const running_ones = found.filter((one) => one.run), all = running_ones.length ? running_ones : found;
    if (!all.length) return refuse(`${part.title} is in no tree of this project that can be built`);
    return all.length === 1 ? all[0] : this.asked(choose(`Which ${part.title}?`, all.map((one) => ({...one, label: one.path, detail: `tree ${one.tree}`}))));
  }

  // Do something with the selected node. Tells why if it is none.
  async node(act, needsRun = false) {
    const at = await this.target();
    if (at?.state) this.told('This is for nodes of trees', 'warning');
    else if (at && needsRun && !at.run) this.told(`The tree ${at.tree} does not run`, 'warning');
    else if (at) await act(at, (kind) => this.event.points.find((one) => one.tree === at.tree && one.path === at.path && (!kind || one.mark.startsWith(kind))));
  }

  async toggle(withCondition = false) {
    const at = await this.target();
    if (at?.state) { this.do(`${this.event.breakpoints.includes(at.state) ? 'clear' : 'breakpoint'} ${word(at.state)}`); return; }
    if (!at) return;
    const before = this.event.points.find((one) => one.tree === at.tree && one.path === at.path && one.mark === 'breakpoint');
    if (before && !withCondition) { this.clear(at); return; }
    const condition = withCondition ? await this.asked(ask(`Hold before ${lastOf(at.path)} while`, before?.condition ?? '', 'A script on the blackboard of the node, such as attempt > 2. It may not write.')) : '';
    if (condition !== null) this.do(`break ${word(at.path)} --tree ${word(at.tree)}${condition ? ` --if ${word(condition)}` : ''}`);
  }

  give(verb) {
    return this.node(async (at, set) => {
      if (verb === 'dummy' && set('dummy')) { this.clear(at); return; }
      const result = await this.asked(choose(verb === 'force' ? `Result of ${lastOf(at.path)} at its next tick` : `Result of the dummy in the place of ${lastOf(at.path)}`, RESULTS));
      if (result) this.do(`tree ${verb} ${word(at.path)} ${result.label} --tree ${word(at.tree)}`);
    });
  }

  runTo() {
    return this.node((at) => {
      const held = this.event.holds.find((one) => one.run === at.run);
      if (held) this.release(held, 'run-to', word(at.path)); else this.told(`The tree ${at.tree} is neither held nor paused`, 'warning');
    }, true);
  }
  why() { return this.node((at) => this.do(`tree why ${word(at.path)} --run ${word(at.run)}`), true); }

  // The held tree or the run.

  // One of the trees that run, by the held ones if isHeld; the one that is shown counts, or else the user is asked.
  async tree(isHeld) {
    const all = isHeld ? this.event.holds ?? [] : (this.event.trees ?? []).filter((one) => one.running), {file} = this.studio;
    if (!all.length) { this.told(isHeld ? 'No tree is held or paused' : 'No tree runs', 'warning'); return null; }
    const inFile = [];
    for (const one of all) if (Object.values(await this.nodes(one)).some(([name]) => name === file?.name)) inFile.push(one);
    const fit = inFile.length ? inFile : all;
    return fit.length === 1 ? fit[0] : this.asked(choose('Which tree?', fit.map((one) => ({...one, label: one.tree, detail: one.text ?? one.run}))));
  }

  get isMachine() { return Boolean(this.studio.file?.view.states); }

  // The transition that waits: of the selected state, or the only one.
  async decision() {
    const all = (this.known.decisions ?? []).filter((one) => one.kind !== 'input'), own = all.filter((one) => one.path === this.studio.file?.selected), fit = own.length ? own : all;
    if (!fit.length) { this.told('No transition is held', 'warning'); return null; }
    return fit.length === 1 ? fit[0] : this.asked(choose('Which transition?', fit.map((one) => ({...one, label: one.path, detail: one.line}))));
  }

  answer(line, decision) {
    if (performance.now() - this.seen.get(decision.id) < REACTION_MS) this.told('The decision has just come; nothing was sent. Look at it, and press again', 'warning');
    else if (decision.drawn?.plan.length || decision.drawn?.goal) this.told("What is asked is on a map; answer on the operator's page", 'warning');
    else this.do(line, decision.id);
  }

  // Whether keys mean the machine: its file is open, or only it is held.
  get meansMachine() { return this.isMachine || (!this.event.holds?.length && (this.known.decisions ?? []).some((one) => one.kind !== 'input')); }

  async goOn() {
    if (this.meansMachine) { const one = await this.decision(); if (one) this.answer('confirm', one); return; }
    const held = await this.tree(true);
    if (held) this.release(held, 'continue');
  }

  async step(how) {
    if (this.meansMachine) { const one = await this.decision(); if (one) this.answer(`step ${how}`, one); return; }
    const held = how === 'into' ? await this.tree(true) : this.told('Trees have one kind of step: F11', 'warning');
    if (held) this.release(held, 'step');
  }

  // Let a held tree go. What was pressed twice must not let it go from where it is held next.
  release(held, verb, node = '') {
    const key = keyOf(held), now = performance.now();
    if (this.released?.key === key && now - this.released.at < ANSWER_MS) { this.told('That is on its way to the robot', 'warning'); return; }
    this.released = {key, at: now};
    this.do(`tree ${verb} ${node} --run ${word(held.run)}`);
  }

  async pause() {
    if (this.isMachine) {
      const line = this.known.actions?.pause?.lines[0] ?? 'pause';
      if (performance.now() - this.turned < REACTION_MS) this.told(`This has just come to mean "${line}"; nothing was sent. Press it again`, 'warning');
      else this.do(line);
      return;
    }
    const tree = await this.tree(false);
    if (tree) this.do(`tree pause --run ${word(tree.run)}`);
  }

  // The blackboard.

  async board() {
    const tree = await this.tree(Boolean(this.event.holds?.length));
    if (tree) this.ask(tree);
  }

  showBoard({tree, recorded, entries}) {
    const rows = entries.map(({scope, key, text, writes}) => [`${scope ? `${scope} ` : ''}${key}`, text || 'never written', writes.length ? writes[0].writer || 'no node' : '', timeOf(writes[0]?.stamp)]);
    const button = (text, act) => html('button', {type: 'button', onclick: act}, text);
    this.showRows(rows, `Blackboard of ${tree}`, [...(recorded ? [] : [button('Record Who Writes', () => this.do(`tree record --tree ${word(tree)}`))]), ...(this.event.holds?.length ? [button('Change…', () => this.change())] : [])]);
  }

  // A change of the blackboard of the held tree.
  async change() {
    const held = await this.tree(true), script = held && await this.asked(ask(`Change the blackboard of ${held.tree}`, '', 'A script that assigns, such as speed := 0.5; tries := 0'));
    if (script) this.do(`tree set ${word(script)} --run ${word(held.run)}`);
  }

  showRows(rows, title, more = []) {
    const cell = (text) => html('td', {}, text);
    this.data.replaceChildren(html('table', {}, html('caption', {}, title), html('thead', {}, html('tr', {}, ...['key', 'value', 'by', 'at'].map((text) => html('th', {scope: 'col'}, text)))), html('tbody', {}, ...rows.map((row) => html('tr', {}, ...row.map(cell))))), ...(rows.length ? [] : ['Nothing is in it.']), ...more);
  }

  // The open file on the robot.

  async offer() {
    const {studio, event, live} = this, {file} = studio;
    if (!this.link || !event.trees || !file) { this.told('Nothing is known of the robot yet; turn Live on', 'warning'); return; }
    await file.settled();
    if (file.problem) { this.told(`The text cannot be read: ${file.problem.message}`, 'error'); return; }
    if (this.isMachine) {
      if (live.machine(event)?.file !== file) this.told(`The robot does not run the machine ${file.name}`, 'warning');
      else { this.readers.structure = (known) => { delete this.readers.structure; this.offerMachine(file, known.states); }; this.do('structure', null, true); }
      return;
    }
    const runs = [];
    for (const run of event.trees.filter((one) => one.running)) if (Object.values(await this.nodes(run)).some(([name]) => name === file.name)) runs.push(run);
    if (!runs.length) { this.told(`No tree of ${file.name} runs; its next run reads the file as it is saved`, 'warning'); return; }
    const faults = this.faults(file), states = faults.length ? [] : [...new Set(runs.map((run) => event.runners?.[run.run]).filter(Boolean))];
    const chosen = await this.asked(sheet(`${file.name}: let the robot use this version`, [
      html('p', {}, `The run of ${runs.map((run) => run.tree).join(', ')} goes on with the version that it has begun with. The next run reads the file as it is saved on the robot. If it has an error, the robot keeps the last good version and says so.`),
      ...faults, ...(faults.length ? [] : [html('p', {}, states.length ? 'To use it now, the robot leaves the state and enters it again: the tree is halted, and begins anew.' : 'No state of a machine runs this tree, so it cannot be begun anew from here.')])],
    [['Save', {}, states.length ? '' : 'primary'], ...states.map((state) => [`Save and Repeat ${state}`, {state}, 'primary']), ['Cancel', null, '']]));
    if (chosen && await this.saved(file) && chosen.state) this.do(`repeat ${word(chosen.state)}`);
  }

  async offerMachine(file, states) {
    const {against, does} = machineChanges(states, file.view.states, this.known.active.paths), faults = this.faults(file), {name, parameters} = file.view.behavior ?? {name: this.event.behavior, parameters: []};
    const chosen = await this.asked(sheet(`${file.name}: switch the robot to this version`, [
      ...(against.length ? [html('p', {class: 'error'}, 'The robot would refuse it:'), list(against)] : []), ...faults,
      html('p', {}, does.length ? 'A switch keeps the active states, and changes:' : 'States and transitions are as on the robot; values of parameters are not compared.'), list(does),
      html('p', {class: 'hint'}, 'The robot reads the file as it is installed there. A file that this robot has not installed from here stays as it was.')],
    [...(against.length || faults.length ? [] : [['Save and Switch', true, 'primary']]), [against.length || faults.length ? 'Close' : 'Cancel', null, '']]));
    if (!chosen || !await this.saved(file)) return;
    const values = parameters.length ? await this.asked(ask('Parameters, NAME=VALUE …', parameters.map((one) => `${one.name}=${one.default ?? ''}`).join(' '), 'As for "switch" at the prompt. What is left out gets its default.')) : '';
    if (values !== null) this.do(`switch ${word(name || this.event.behavior)} ${values}`.trim());
  }

  // What is wrong with a file, as the checker says.
  faults(file) {
    const all = file.findings.filter((one) => one.severity === 'error').map((one) => one.message);
    return all.length ? [html('p', {class: 'error'}, 'This version has errors, and the robot would refuse it:'), list(all)] : [];
  }

  async saved(file) {
    if (file === this.studio.file && file.isChanged) await this.studio.save();
    if (!file.isChanged) return true;
    this.told(`${file.name} is not saved; nothing was sent`, 'warning');
    return false;
  }
}

// What a switch from the states of the robot to those of a file changes, and what speaks against it: the active states have to stay.
export function machineChanges(running, wanted, active) {
  const before = new Map(running.map((one) => [one.path, one])), after = new Map(wanted.map((one) => [one.path, one]));
  const embedded = wanted.filter((one) => one.kind === 'behavior').map((one) => `${one.path}/`), isOwn = (path) => !embedded.some((one) => path.startsWith(one));
  const lost = active.filter((path) => isOwn(path) && !after.has(path)), does = [];
  const against = lost.map((path) => `${path} is active, and is not in this version`);
  for (const path of active) {
    const one = before.get(path), other = after.get(path);
    if (other?.type && one && one.type !== other.type) against.push(`${path} is active, and is a ${one.type} there, but a ${other.type} in this version`);
  }
  for (const path of after.keys()) if (!before.has(path)) does.push(`adds ${path}`);
  for (const [path, one] of before) {
    const other = after.get(path);
    if (!other) { if (isOwn(path)) does.push(`removes ${path}`); continue; }
    const targets = new Map(one.transitions.map((way) => [way.outcome, way.target.replace(/^=/, '').split('/').at(-1)]));
    for (const way of other.transitions) if (targets.get(way.outcome) !== way.target) does.push(`${path}: ${way.outcome} leads to ${way.target}${targets.has(way.outcome) ? `, not to ${targets.get(way.outcome)}` : ''}`);
    for (const [outcome, target] of targets) if (target && !other.transitions.some((way) => way.outcome === outcome)) does.push(`${path}: ${outcome} does not lead to ${target} any more`);
  }
  return {against, does};
}

// An octagon around a text.
const shape = (x, y, width) => `M${x + 4} ${y}h${width - 8}l4 4v9l-4 4h${8 - width}l-4 -4v-9z`;
