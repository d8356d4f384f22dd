// SPDX-License-Identifier: BSD-3-Clause
// What the server tells, put into the page; texts only as text.

import {ACTIONS, Commands} from './commands.js';
import {DecisionBar, element, plain} from './decision.js';
import {LEAST, drawTree, has, keep, mark, offer, part, press, show, spread, statuses} from './drawing.js';
import {byId, pressedOnce, replace, svg as svgElement} from './elements.js';
import {RobotMap} from './map.js';
import {panels} from './panels.js';
import {operator, remember, remembered, ServerLink} from './server_link.js';
import {Timeline} from './timeline.js';
import {viewport} from './viewport.js';

const MOST_LOG = 500;
const MOMENT_MS = 100;  // between two moments that are asked for: the server ends a page that sends more than 20 messages a second
const known = {actions: {}, active: {paths: [], states: []}, decisions: [], trees: [], tree_states: {}, left_out: [], robots_left_out: [], behaviors: [], places: {}, robots: [], obstacles: [], times: {}};
let server = {open: false, word: 'CONNECTING', text: ''};
let heard = performance.now();

const tell = (text, tone) => {
  byId('told').textContent = text;
  byId('told').className = tone;
  byId('log').querySelector('.shown')?.classList.remove('shown');  // what is told below is in the log, and is seen there when it is replaced
  if (text) addLog(text, `${tone} sent shown`);
};
const send = (message) => {
  const sent = link.send(message);
  if (sent && ('answer' in message || 'do' in message)) touched = undefined;  // that is dealt with; it may be refused, and come back
  if (!sent && !('complete' in message || 'lanes' in message)) tell('The server of this page is gone; nothing was sent', 'error');
  return sent;
};
const isLive = () => server.open && known.link?.state === 'live';

// The moment that is shown: wanted by the operator, asked for, and what has come of it; null is now. Decisions, commands and
// the head of the page are always those of now, and of the past nothing but STOP goes out.
let recording = '', wanted = null, asked = null, asking = null, askedAt = -Infinity, past = null;
const seen = () => past ?? known;

const bar = new DecisionBar(byId('decision'), byId('decision-line'), byId('decision-body'), byId('waiting'), {send, tell, placesOf: () => Object.keys(known.places).sort()});
const map = new RobotMap(byId('map'), byId('map-keys'), {
  pose: (x, y, yaw) => { if (bar.shown?.wants_pose) bar.answer([x, y, yaw].map((one) => one.toFixed(3)).join(' '), mapDecision); },
  obstacle: (x, y) => send({obstacle: [x, y]}),
  cursor: (text) => { byId('map-cursor').textContent = text; },
  leave: () => { dropping = false; choose(); },
  costmaps: 'costmaps',
});
byId('map-tools').prepend(map.layers);
let mapDecision = null;
bar.turned = new URL(location).searchParams.get('decision');  // a link of "console alerts"
let dropping = false;
for (const [id, by] of [['map-out', 0.8], ['map-in', 1.25], ['map-fit', 0]]) byId(id).addEventListener('click', () => map.zoomBy(by));
const commands = new Commands({send, tell, bar, now: () => known});
pressedOnce('button:not(.stop, .zoom *, .timeline *), .choice', tell);
// What is pressed right after the dialog has closed was meant for it. Its 'close' can come after a second click.
for (const kind of ['click', 'keydown', 'close']) byId('dialog').addEventListener(kind, () => bar.uncovered());
byId('waiting').addEventListener('change', () => drawPlan());
byId('drop').addEventListener('click', () => { dropping = !dropping; choose(); });
// What the operator deals with, for the wait times of the report: from the first key or click while it is on the page.
let touched;
for (const kind of ['keydown', 'pointerdown']) {
  addEventListener(kind, () => {
    if (bar.id !== touched && isLive() && send({touched: true, decision: bar.id})) touched = bar.id;
  }, {capture: true});
}
document.querySelector('.skip').addEventListener('click', (event) => { event.preventDefault(); byId('decision').focus(); });  // the address keeps the token
byId('robot').addEventListener('change', (event) => { goTo(event.target.value); });

function goTo(robot) {
  const address = new URL(location.href);
  address.searchParams.set('robot', robot);
  location.assign(address);
  if (address.href === location.href) location.reload();
}

const isWanted = (text) => byId('log-filter').value.toLowerCase().split(/\s+/).every((word) => text.toLowerCase().includes(word));
byId('log-filter').addEventListener('input', () => { for (const line of byId('log').children) line.hidden = !isWanted(line.textContent); });

function addLog(text, tone) {
  const log = byId('log');
  const line = element('div', {class: tone}, text);
  line.hidden = !isWanted(text);
  log.append(line);
  while (log.childElementCount > MOST_LOG) log.firstElementChild.remove();
  showEnd();
}

// The log follows its newest line, also in a pane that has become smaller, unless somebody has scrolled up in it.
let follows = true;
const showEnd = () => { if (follows) byId('log').scrollTop = byId('log').scrollHeight; };
byId('log').addEventListener('scroll', ({target: {scrollHeight, scrollTop, clientHeight}}) => { if (clientHeight) follows = scrollHeight - scrollTop - clientHeight < 30; });
new ResizeObserver(showEnd).observe(byId('log'));

// What a click on the map means. A pose that is pointed at belongs to the decision that was on the page then.
function choose() {
  const wants = bar.shown?.wants_pose && isLive() && wanted === null;
  const mode = dropping && wanted === null ? 'obstacle' : wants ? 'pose' : '';
  if (mode === 'pose' && mapDecision !== bar.id) {
    mapDecision = bar.id;
    map.point(null);
  }
  map.setMode(mode);
  byId('drop').setAttribute('aria-pressed', String(dropping));
}

// What the decision on the page is about is drawn in the place of the plan; while it has not arrived, nothing is.
function drawPlan() {
  const decision = past ? past.decisions[0] : bar.shown;
  const {plan, goal} = decision?.drawn ?? {plan: seen().plan ?? [], goal: null};
  map.set('plan', plan);
  map.set('goal', goal ?? plan[plan.length - 1] ?? null);
  byId('map').hidden = !(byId('map-empty').hidden = map.hasContent());
}

// Containers and sub-trees that are folded, by machine or tree.
const foldedOf = (key) => new Set([remembered('folded', {})[key] ?? []].flat());

function fold(key, one) {
  const all = remembered('folded', {}), of = foldedOf(key);
  if (!of.delete(one)) of.add(one);
  delete all[key];  // the latest are kept
  remember('folded', Object.fromEntries([...Object.entries(all), [key, [...of]]].slice(-50)));
}

const machineSvg = byId('machine').querySelector('svg');
const machineView = viewport(machineSvg, {grows: 1.7, changed: () => spread(machineSvg)});

function foldMachine(path) {
  const key = `machine ${seen().machine.behavior}`;
  if (path) fold(key, path);
  send({fold: [...foldedOf(key)]});
  if (past) showMoment(wanted);
}

function drawMachine() {
  const {machine, active, decisions, status} = seen();
  const lines = byId('machine-text'), key = seen().folded || machine?.drawing;
  const told = (...text) => { lines.replaceChildren(...text); delete machineSvg.dataset.key; delete machineSvg.dataset.of; };
  if (!machine) {
    told(element('p', {class: 'empty'}, !status ? 'Nothing has arrived from the robot. Start its executive, or check the network.' : status.running ? 'The state machine has not arrived yet.' : 'No behavior is running. Press Start… (s) to choose one.'));
    return;
  }
  const isOf = machineSvg.dataset.of === machine.drawing, isNew = has(key) && !(isOf && machineSvg.dataset.key === key);
  if (!key || !(isNew || isOf)) {  // that of the same machine with other parts folded is marked until the new one comes
    told(element('p', {class: 'hint'}, key ? 'The diagram is being drawn.' : 'It is too large for a diagram.'), ...machine.lines.map((line) => element('div', {}, line)));
    return;
  }
  lines.replaceChildren();
  if (!byId('machine').clientWidth) return;  // nothing of it can be measured until its pane is shown
  if (isNew) {
    machineView.content(show(machineSvg, byId('machine-legend'), key));
    machineSvg.dataset.of = machine.drawing;
  }
  const svg = machineSvg, places = new Map(machine.paths.map((path, index) => [path, index]));
  const shown = (path) => { for (let at = path; at; at = at.slice(0, at.lastIndexOf('/'))) { const state = places.has(at) && part(svg, `s${places.get(at)}`); if (state) return state; } return null; };
  const ids = (paths) => paths.filter((path) => places.has(path)).flatMap((path) => [`s${places.get(path)}`, `m${places.get(path)}`]);
  const waiting = decisions.map((decision) => decision.path);
  mark(svg, 'lit', status?.running ? ids(active.paths) : []);
  mark(svg, 'waits', [...ids(waiting), ...waiting.map((path) => shown(path)?.id).filter(Boolean)]);
  mark(svg, 'wanted', decisions.filter((decision) => decision.wanted && places.has(decision.path)).map((decision) =>
    `s${places.get(decision.path)}o${machine.outcomes[places.get(decision.path)].indexOf(decision.wanted)}`));
  machine.paths.forEach((path, index) => {
    const box = part(svg, `m${index}in`) ?? part(svg, `s${index}`);
    if (index && machine.containers.includes(index) && box) press(box, `${box.id.startsWith('m') ? 'fold' : 'unfold'} ${path}`, () => foldMachine(path));
  });
  // The outcomes of what is active, at their transitions: the answer to the decision in the bar is sent, any other outcome is asked about.
  const choices = new Map();
  for (const {path, outcomes} of isLive() && wanted === null && status?.running ? active.states : []) {
    const decision = decisions.find((one) => one.path === path);
    if (!places.has(path)) continue;
    machine.outcomes[places.get(path)].forEach((outcome, index) => {
      const isAnswer = decision?.choices.some(({value}) => value === outcome);
      if (!isAnswer && !outcomes.includes(outcome)) return;
      choices.set(`s${places.get(path)}o${index}`, {label: `${isAnswer ? 'answer' : 'force'} ${path}: ${outcome}`, run: () => {
        if (!isAnswer) commands.forced(path, outcome);
        else if (bar.id === decision.id) bar.answer(outcome, decision.id);
        else { bar.turn(decision.id); tell('this decision is in the bar now; nothing was sent. Check it and answer', 'warning'); }
      }});
    });
  }
  offer(svg, choices);
  machineView.reveal(shown(active.states[0]?.path));
}

// The mission queue: of the past without buttons. A row is made again only when it has changed, so that a button keeps the focus.
let queueShown = '';

function drawQueue() {
  const {queue} = seen(), acts = isLive() && wanted === null && Boolean(queue);
  for (const id of ['queue-add', 'queue-hold']) byId(id).disabled = !acts;
  const text = JSON.stringify([queue, acts]);
  if (text === queueShown) return;
  queueShown = text;
  byId('queue-held').textContent = queue?.held ? `HELD: ${queue.held}` : '';
  byId('queue-hold').textContent = queue?.hold ? 'Release' : 'Hold';
  replace(byId('queue'), ...(queue?.entries ?? []).map((entry, row) => {
    const buttons = [['↑', 'Move up', entry.up], ['↓', 'Move down', entry.down], ['✕', 'Remove', `queue remove ${entry.number}`]].map(([sign, what, line]) => {
      const place = `queue ${row} ${sign}`;
      commands.means(place, line);
      return element('button', {type: 'button', class: 'quiet', title: `${what} entry ${entry.number}`, disabled: !acts || !line, onclick: () => commands.toggle(place)}, sign);
    });
    const state = element('span', {class: entry.running ? 'running' : 'dim'}, entry.state);
    return element('li', {}, element('div', {}, element('strong', {}, `${entry.number}  ${entry.text}`), ' ', state, element('div', {class: 'hint'}, entry.details)), ...buttons);
  }));
}
byId('queue-hold').addEventListener('click', () => commands.toggle('queue-hold'));
byId('queue-add').addEventListener('click', () => commands.start('queue add'));

function treePane(id) {
  const svg = svgElement('svg');
  const drawing = element('div', {class: 'drawing', tabindex: '0', role: 'group', 'aria-label': 'diagram of the tree: + and - zoom, arrows move it, 0 fits it'}, svg);
  const pane = element('div', {'data-id': id, class: 'tree'}, element('p', {'aria-live': 'polite'}), drawing);
  return Object.assign(pane, {svg, view: viewport(svg, {grows: 1 / LEAST})});
}

function drawTrees() {
  const place = byId('trees');
  const panes = new Map([...place.children].map((pane) => [pane.dataset.id, pane]));
  const shown = seen().trees.map((tree) => {
    const pane = panes.get(tree.id) ?? treePane(tree.id);
    const {paused, server_gone: gone, leaves} = seen().tree_states[tree.id];
    const acts = gone ? 'SERVER GONE: last state' : leaves.length ? `▶ ${leaves.join(', ')}` : 'no leaf runs';
    const text = `${tree.tree}${paused && !gone ? ' (paused)' : ''}: ${acts}`;
    pane.classList.toggle('gone', gone);
    if (pane.firstElementChild.textContent !== text) pane.firstElementChild.textContent = text;
    return [tree, pane];
  });
  const panesNow = shown.map(([, pane]) => pane);
  if (panesNow.length !== place.children.length || panesNow.some((pane, index) => place.children[index] !== pane)) place.replaceChildren(...panesNow);
  for (const [tree, {svg, view}] of shown) {
    if (!svg.parentElement.clientWidth) continue;  // it is laid out for its pane, when that is shown
    const state = seen().tree_states[tree.id], folds = foldedOf(`tree ${tree.tree}`), text = JSON.stringify([tree.nodes, [...folds]]);
    if (svg.dataset.key !== text) {
      const again = (index) => { fold(`tree ${tree.tree}`, index); drawTrees(); part(svg, `t0n${index}`)?.focus(); };
      const extent = drawTree(svg, tree.nodes, folds, again);
      svg.dataset.key = text;
      view.content(extent);
    }
    statuses(svg, state.statuses, state.last);
    view.reveal(part(svg, `t0n${state.statuses.findLastIndex((status) => status === 'running')}`));
  }
}

function drawHead() {
  const {status, times} = known;
  const live = isLive();
  const age = times.age == null ? null : times.age + (performance.now() - heard) / 1000;
  byId('link').textContent = server.open ? (known.link?.word ?? 'LISTENING').replace(/ [\d.]+ \w+$/, '') : server.word;
  byId('link').className = `badge ${live ? 'good' : 'error'}`;
  byId('age').textContent = age == null ? '' : live ? '' : `${age.toFixed(0)} s old`;
  byId('name').textContent = plain((known.robot ?? '').replace(/^\/$/, '') || 'FlexBT');
  byId('runs').textContent = status?.runs ?? '';
  byId('holder').textContent = [known.operator && `you: ${plain(known.operator.replace(/@[^@]*$/, ''))}`, status?.authority && `authority ${status.authority}`].filter(Boolean).join(' · ');
  byId('holder').title = byId('holder').textContent;
  const alarm = [];
  if (!server.open) alarm.push(...(server.text ? [server.text, 'trying again'] : []));
  else if (!live) alarm.push('NO LINK: showing the last known state; only STOP can be sent');
  if (known.link?.problem) alarm.push(known.link.problem);
  if (status) alarm.push(...(status.alarm ? [status.alarm] : []), ...status.missed, ...[status.message, status.asked].filter(Boolean));
  if (byId('alarm').textContent !== alarm.join('\n')) byId('alarm').textContent = alarm.join('\n');
  document.body.classList.toggle('blind', !live && wanted === null);
  document.body.classList.toggle('past', wanted !== null);
  byId('past').hidden = wanted === null;
  byId('past').textContent = `${recording ? 'RECORDING' : 'PAST'} ${timeline.label} ✕`;
  byId('timeline-title').textContent = recording ? plain(`Time line of ${recording}`) : 'Time line';
  const acts = live && wanted === null;
  drawQueue();
  bar.allow(acts, wanted === null ? undefined : 'this page shows the past: go back to now first (Esc)');
  const running = Boolean(status?.running);
  byId('pause').firstChild.data = known.actions.pause?.lines[0] === 'resume' ? 'Go on ' : 'Pause ';
  byId('start').firstChild.data = running ? 'Switch… ' : 'Start… ';
  for (const stop of document.querySelectorAll('.stop')) stop.disabled = !server.open;
  const blocked = [...ACTIONS.filter((action) => action !== 'stop').map((action) => [action, known.actions[action]?.blocked]),
    ['force', running ? '' : 'no state is active'], ['start', ''], ['note', '']];
  for (const [id, why] of blocked) {
    byId(id).disabled = !acts || Boolean(why);
    byId(id).title = acts ? why ?? '' : live ? 'Back to now first (Esc)' : 'No live link';
  }
  for (const button of byId('autonomy').querySelectorAll('button')) {
    button.disabled = !acts;
    button.setAttribute('aria-pressed', String(button.value === String(status?.autonomy)));
  }
  const marks = [['locked', status?.locked ?? []], ['breakpoint', status?.breakpoints ?? []]];
  const names = known.active.states.map((state) => `▶ ${state.path}${state.paused ? ' (paused)' : ''}${
    marks.map(([mark, paths]) => paths.includes(state.path) ? ` (${mark})` : '').join('')}${state.activity.length ? `: ${state.activity.join('; ')}` : ''}`);
  if (!names.length) names.push('between states');
  for (const [mark, paths] of marks) {
    const others = paths.filter((path) => !known.active.states.some((state) => state.path === path));
    if (others.length) names.push(`${mark}: ${others.join(', ')}`);
  }
  const text = running ? names.map(plain).join('\n') : '';
  if (byId('active').textContent !== text) byId('active').textContent = text;
  document.title = `${known.decisions.length ? '? ' : ''}${live ? '' : 'BLIND '}${known.robot ?? ''} FlexBT`;
}

// The robots that are found, the most urgent first. A page that has named none goes to the first that comes.
function drawRobots() {
  const others = known.robots.filter((robot) => robot.name !== known.robot);
  if (others.length && others.length === known.robots.length && !new URL(location).searchParams.has('robot')) goTo(others[0].name);
  byId('robots-pane').hidden = byId('choose-robot').hidden = others.length === 0;
  const names = known.robots.map((robot) => robot.name).sort();
  const options = [...byId('robot').options].map((option) => option.value);
  const isNew = names.join('\n') !== options.join('\n');
  if (isNew) byId('robot').replaceChildren(...names.map((name) => element('option', {value: name}, name)));
  if (isNew || document.activeElement !== byId('robot')) byId('robot').value = known.robot;
  const address = new URL(location);
  if (names.includes(known.robot) && !address.searchParams.has('robot')) {  // the page is that of this robot also when the link is lost
    address.searchParams.set('robot', known.robot);
    history.replaceState(null, '', address);
  }
  // A line stays what it is while it is clicked; the focus stays at its robot when the order changes.
  const needing = known.robots.filter((robot) => robot.needs_operator).length;
  const unreachable = known.robots.filter((robot) => robot.urgency === 'unreachable').length;
  const told = [`robots: ${known.robots.length}, need you: ${needing}`, ...(unreachable ? [`unreachable: ${unreachable}`] : []), ...known.robots_left_out].join(', ');
  if (byId('robots-told').textContent !== told) byId('robots-told').textContent = told;
  const list = byId('robots');
  const lines = new Map([...list.children].map((line) => [line.firstElementChild.dataset.robot, line]));
  const shown = known.robots.map((robot) => {
    const line = lines.get(robot.name) ?? robotLine(robot.name);
    const button = line.firstElementChild;
    const text = `${{alarm: '! ', decision: '? ', failed: '✗ '}[robot.urgency] ?? (robot.link === 'live' ? '' : '✗ ')}${robot.name}: ${robot.link === 'stale' ? 'stale ' : ''}${robot.text}`;
    if (button.textContent !== text) button.textContent = text;
    button.className = robot.tone;
    button.setAttribute('aria-pressed', String(robot.name === known.robot));
    return line;
  });
  if (shown.length !== list.children.length || shown.some((line, index) => list.children[index] !== line)) {
    const focused = list.contains(document.activeElement) && document.activeElement;
    list.replaceChildren(...shown);
    if (focused) focused.focus();
  }
}

const robotLine = (name) => element('li', {}, element('button', {type: 'button', 'data-robot': name, onclick: () => goTo(name)}));

function drawObstacles() {
  byId('drop').hidden = !known.simulator;
  replace(byId('obstacles'), ...known.obstacles.map(([name]) => element('button', {type: 'button', onclick: () => send({remove_obstacle: name})}, `remove ${name}`)));
  if (!known.simulator) dropping = false;
}

function takeParts(parts) {
  heard = performance.now();
  Object.assign(known, parts);
  if (parts.log) for (const line of parts.log) addLog(line.text, line.tone);
  if (!past) {
    if (parts.driven) map.set('driven', parts.driven);
    for (const name of ON_MAP) if (parts[name]) map.set(name, parts[name]);
    if ('pose' in parts) map.setPose(parts.pose);
    if ('where' in parts || parts.active) drawWhere();
  }
  bar.show(known.decisions, known.times.now ?? 0);
  drawPlan();
  if (['machine', 'folded', 'active', 'decisions', 'status', 'link'].some((name) => name in parts)) drawMachine();
  if ('machine' in parts && !past && known.machine && foldedOf(`machine ${known.machine.behavior}`).size) foldMachine();
  if (parts.trees || parts.tree_states) drawTrees();
  if (parts.queue) {
    commands.means('queue-hold', parts.queue.hold ? `queue release --hold ${parts.queue.hold}` : 'queue hold');
    drawQueue();
  }
  for (const [action, {lines}] of Object.entries(parts.actions ?? {})) commands.means(action, lines.join('; '));
  if (parts.left_out) byId('left-out').textContent = seen().left_out.join('; ');
  if (parts.robots || parts.robots_left_out) drawRobots();
  if (parts.obstacles || 'simulator' in parts) drawObstacles();
  drawHead();
  choose();
}

// The past: the lanes of the time line, and the moment that is shown.
const ON_MAP = ['places', 'obstacles', 'scan', 'others'];
const drawWhere = () => { byId('pose').textContent = [seen().where ?? '', ...seen().active.states.map((state) => state.progress)].filter(Boolean).join('   '); };
const timeline = new Timeline(byId('timeline'), {moment: showMoment});
let lanesAsked = 0;

function askLanes() {
  if (performance.now() - lanesAsked < 5000 || !(timeline.isShown || wanted !== null)) return;  // that of before is on its way
  lanesAsked = send({lanes: timeline.revision, of: recording}) ? performance.now() : 0;
}

function showMoment(time) {
  if (time === null && recording) { openRecording(''); return; }
  const was = wanted;
  wanted = time;
  if (time === null) {
    if (was !== null) {
      send({moment: null});
      map.set('driven', []);  // the server sends both again, if there are any
      for (const name of ['map', 'image']) map.set(name, null);
    }
    past = asked = null;
    for (const name of ON_MAP) map.set(name, known[name] ?? []);
    map.set('pose', known.pose ?? null);
    if (was !== null) bar.returned();
    drawMoment();
  } else {
    if (asked === null) asking ??= setTimeout(askMoment, askedAt + MOMENT_MS - performance.now());
    drawHead();
    choose();
  }
}

function askMoment() {
  asking = null;
  if (wanted === null || asked !== null || !send({moment: wanted, of: recording})) return;
  asked = wanted;
  askedAt = performance.now();
}

function takeMoment(moment) {
  asked = null;
  if (wanted === null) return;
  if ((moment.of ?? recording) !== recording) { showMoment(wanted); return; }  // another one was opened meanwhile
  if (moment.problem) {
    tell(moment.problem, 'warning');
    timeline.go(null);
    return;
  }
  past = {...moment, others: [], obstacles: []};
  if (moment.time !== wanted) showMoment(wanted);
  if (!past.map) for (const name of ['map', 'image']) map.set(name, null);
  for (const name of [...ON_MAP, 'driven', 'pose']) map.set(name, past[name]);
  byId('past-log').replaceChildren(...past.log.map(({text, tone}) => element('div', {class: tone}, text)));
  drawMoment();
  byId('past-log').scrollTop = byId('past-log').scrollHeight;
}

function drawMoment() {
  map.set('isPast', past !== null);  // costmaps are of now
  byId('log').hidden = past !== null;
  byId('past-log').hidden = past === null;
  byId('left-out').textContent = seen().left_out.join('; ');
  drawHead();
  drawPlan();
  drawMachine();
  drawTrees();
  drawWhere();
  choose();
}

// Show a recording from its beginning, or the robot again.
function openRecording(name) {
  recording = name;
  timeline.clear();
  lanesAsked = 0;
  askLanes();
  if (name) { timeline.isLive = false; timeline.go(0); } else showMoment(null);
}

function chooseRecording(files) {
  const size = (bytes) => bytes < 1e6 ? `${Math.ceil(bytes / 1000)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
  const rows = files.map(({name, bytes, changed}) => ({text: name, names: [name], about: `${new Date(1000 * changed).toLocaleString()}  ${size(bytes)}`, run: () => openRecording(name)}));
  commands.read('Open a Recording', rows.length ? commands.list(rows) : 'There is no recording in ~/.ros/flexbt on the computer of this server. The program `recorder` makes one.');
}
byId('recordings').addEventListener('click', () => send({recordings: true}));
byId('past').addEventListener('click', () => timeline.go(null));
document.addEventListener('keydown', (event) => {
  if (event.key === 'Escape' && wanted !== null && !event.target.closest?.('input:not([type="range"]), select, textarea, dialog[open], canvas, [popover]')) timeline.go(null);
});
setInterval(askLanes, 1000);

function askName(asks) {
  if (byId('name-form').hidden) byId('your-name').value = remembered('operator', '');  // else it may be typed just now
  byId('name-form').hidden = !asks;
  byId('name-told').textContent = `until then: ${operator()}`;
}
byId('rename').addEventListener('click', () => { askName(true); byId('your-name').focus(); });
byId('name-form').addEventListener('submit', (event) => {
  event.preventDefault();
  const name = byId('your-name').value.trim();
  if (!name) return;
  remember('operator', name);
  askName(false);
  link.renew();
});

function takeMessage(message) {
  if (message.hello) {
    known.robot = message.hello.robot;
    known.operator = message.hello.operator;
    byId('rename').hidden = !message.hello.asks_name;
    byId('studio').hidden = !message.hello.studio;
    byId('studio').href = `studio/${location.hash}`;
    askName(message.hello.asks_name && !remembered('operator', ''));
    touched = undefined;
    commands.specs = message.hello.commands;
    byId('log').replaceChildren();
    openRecording('');
  } else if (message.drawing) {
    if (message.drawing.svg) {
      keep(message.drawing.key, message.drawing.svg);
      drawMachine();
    } else tell(`no picture: ${message.drawing.problem}`, 'warning');
  } else if (message.refused) {
    known.robots = message.refused.robots;
    drawRobots();
  } else if (message.told) tell(message.told.text, message.told.tone);
  else if (message.read && byId('dialog').matches('[open]:has(input, select, .primary)')) tell(`${message.read.title}:\n${message.read.text}`, 'plain');  // what is filled in or asked stays
  else if (message.read) commands.read(message.read.title, message.read.text);
  else if (message.past) takeMoment(message.past);
  else if (message.recordings) { if (!byId('dialog').open) chooseRecording(message.recordings); }  // something else is read by now
  else if (message.lanes) {
    lanesAsked = 0;
    if (message.lanes.problem) takeMoment(message.lanes);
    else if (message.lanes.of === recording) timeline.take(message.lanes);
    if (message.lanes.more) askLanes();
  } else if (message.candidates) commands.candidates(message.candidates);
}

const link = new ServerLink({
  parts: takeParts,
  message: takeMessage,
  map: (head, cells) => { map.setMap(head, cells); drawPlan(); },
  state: (open, word, text) => {
    server = {open, word, text};
    known.link = null;  // what was before is not live, also when the server is back, until it says so
    drawHead();
    choose();
  },
});
byId('reset').addEventListener('click', panels(byId('panels'), 'flexbt', {
  wide: [['machine-pane', 'queue-pane', 'timeline-pane'], ['map-pane', 'trees-pane', 'log-pane']],
  narrow: [['map-pane', 'machine-pane', 'trees-pane', 'queue-pane', 'timeline-pane', 'log-pane']],
}, '(max-width: 640px), (max-height: 520px)').reset);
new ResizeObserver(drawTrees).observe(byId('trees-pane'));
new ResizeObserver(drawMachine).observe(byId('machine'));
setInterval(drawHead, 500);
