// SPDX-License-Identifier: BSD-3-Clause
// The player: moments of a way, of a dry run or of a robot, one after the other, and the statuses of the nodes at each on the graph.

import {byId, html, svg} from './elements.js';
import {widthOf} from './graph.js';
import {Timeline} from './timeline.js';

const SIGNS = {RUNNING: '▶', SUCCESS: '✓', FAILURE: '✗', SKIPPED: '»', IDLE: '■', NEVER: '∅'};
const WORDS = {IDLE: 'HALTED', NEVER: 'never'};
const FONT = '600 12px system-ui, sans-serif';
const STEP_MS = 900, LEAST_MS = 60, PACE = 0.1;  // while it plays: for a moment without a time; at least; for each second of a run
const RING_S = 300;                              // how much of a robot's past is kept

export const placeOf = (file, path) => `${file}\n${path}`;

// Statuses by place, from those by the path of a node in a run. places(path) → [file, path in the view], or nothing. Where one
// sub-tree is used several times, what runs counts; of a state that is active the containers are, too.
export function statusesAt(entries, places) {
  const found = new Map();
  for (const [run, status] of entries) {
    const place = places(run);
    if (!place) continue;
    const key = placeOf(...place);
    if (found.get(key) !== 'RUNNING') found.set(key, status);
    if (run.startsWith('/')) for (let path = place[1]; path !== '/'; ) { path = path.slice(0, path.lastIndexOf('/')) || '/'; found.set(placeOf(place[0], path), status); }
  }
  return found;
}

// Lanes of a run of which the statuses of nodes are known at each moment: a part for each time that a node ran.
function lanesOf(moments, name) {
  const entries = [], open = new Map();
  const close = (place, end, word) => { Object.assign(open.get(place), {end, word: word.toLowerCase(), tone: {FAILURE: 'error', SUCCESS: 'good'}[word] ?? ''}); open.delete(place); };
  let before = new Map();
  for (const {time, statuses} of moments) {
    const now = statuses();
    for (const [place, status] of now) {
      if (status === before.get(place)) continue;
      if (status !== 'RUNNING' && !open.has(place) && !['SUCCESS', 'FAILURE'].includes(status)) continue;
      if (!open.has(place)) { const entry = {number: entries.length + 1, lane: 'nodes', key: place, label: name(...place.split('\n')), begin: time, end: null, word: '', tone: '', text: '', count: 1}; entries.push(entry); open.set(place, entry); }
      if (status !== 'RUNNING') close(place, time, status === 'IDLE' ? 'HALTED' : status);
    }
    for (const place of [...open.keys()]) if (!now.has(place)) close(place, time, 'HALTED');
    before = now;
  }
  return entries;
}

// A moment is {title, lines, time, statuses()}: time in seconds, or null where only the order counts; statuses() returns a map by
// placeOf. on.follow(file, path) brings a node into view, on.paint() draws the statuses, on.name(file, path) → name of a node.
export class Player {
  constructor(on) {
    this.on = on;
    this.moments = [];
    this.wanted = null;
    this.at = 0;
    this.statuses = new Map();
    const button = (id, mark, title, act) => html('button', {type: 'button', id: `player-${id}`, title, 'aria-label': title, onclick: act}, mark);
    this.line = html('input', {id: 'player-line', type: 'range', min: '0', step: 'any'});
    this.pause = button('play', '▶', 'Play or pause (Space)', () => this.toggle());
    this.count = html('span', {id: 'player-count', class: 'hint'});
    this.title = html('strong', {id: 'player-title'});
    this.told = html('p', {id: 'player-told', 'aria-live': 'polite'});
    this.lanes = html('div', {id: 'player-lanes', hidden: true});
    this.timeline = new Timeline(this.lanes, {moment: (time) => this.show(time)});
    setInterval(() => this.askLanes(), 1000);
    this.isFollowing = html('input', {id: 'player-follow', type: 'checkbox', checked: true});
    this.bar = html('div', {id: 'player', role: 'group', 'aria-label': 'player', hidden: true},
      html('div', {}, this.title, html('span', {class: 'seg'}, button('first', '⇤', 'First moment (Home)', () => this.first()), button('back', '‹', 'Step back (, or ←)', () => this.step(-1)), this.pause, button('next', '›', 'Step (. or →)', () => this.step(1)), button('last', '⇥', 'Last moment, or now (End)', () => this.last())), this.count, html('label', {}, this.isFollowing, ' Follow'), button('end', '×', 'End (Esc)', () => this.end())),
      html('div', {}, this.line), this.lanes, this.told);
    byId('graph-body').after(this.bar);
    this.line.addEventListener('input', () => { const value = Number(this.line.value); this.go(this.isTimed ? this.moments.findLastIndex((one) => one.time - this.moments[0].time <= value + 1e-9) : Math.round(value)); });
    addEventListener('keydown', (event) => this.key(event), {capture: true});
  }

  get isOpen() { return !this.bar.hidden; }
  // Whether the line is of seconds; one that takes no time is of moments.
  get isTimed() { return this.moments.length > 0 && this.moments.at(-1).time > this.moments[0].time; }
  // Whether the robot is shown as it was. Nothing may be sent to it then but a stop.
  get showsPast() { return this.isLive && (this.wanted !== null || !this.isAtEnd && this.moments.length > 0); }
  // Whether it is a recording, which has no now.
  get isRecorded() { return this.isLive && this.hasPast && !this.timeline.isLive; }
  get isAtEnd() { return this.at === this.moments.length - 1; }

  key(event) {
    if (!this.isOpen || document.querySelector('dialog[open]') || event.ctrlKey || event.altKey || event.metaKey) return;
    const inBar = this.bar.contains(event.target), isField = event.target.closest?.('input, textarea, select, .cm-editor, #text, [role="application"], [role="listbox"]');
    const act = (inBar ? {ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1), ArrowDown: () => this.step(-1), ArrowUp: () => this.step(1), Home: () => this.first(), End: () => this.last(), ' ': event.target === this.line ? () => this.toggle() : null}[event.key] : null)
      ?? (inBar || !isField ? {',': () => this.step(-1), '.': () => this.step(1), Escape: () => { if (this.past) this.timeline.go(null); else this.end(); }}[event.key] : null);
    if (!act) return;
    event.preventDefault();
    event.stopPropagation();
    act();
  }

  // Show moments. For those of a robot, which go on, isLive is true. owner is what they are of.
  play(title, moments, {isLive = false, owner = null, at = 0, ended = () => {}} = {}) {
    this.stop();
    if (!this.isOpen) this.before = document.activeElement;
    else this.ended();
    Object.assign(this, {moments, isLive, owner, ended, at: 0, statuses: new Map(), past: null, wanted: null, hasPast: false, isAsking: false, isFetching: false});
    this.timeline.clear();
    this.askLanes();
    this.lanes.hidden = true;
    if (!isLive && this.isTimed) this.showLanes({entries: lanesOf(moments, this.on.name), revision: 1, begin: moments[0].time, end: moments.at(-1).time, wall: null, live: false});
    this.title.textContent = title;
    this.bar.hidden = false;
    this.line.focus();
    this.go(at);
  }

  // Add a moment of a robot. Whoever looks at an earlier one goes on to do so.
  push(moment) {
    const wasAtEnd = this.isAtEnd || !this.moments.length;
    this.moments.push(moment);
    const old = this.hasPast ? this.moments.length - 1 : this.moments.findIndex((one) => one.time >= moment.time - RING_S);
    this.moments.splice(0, old);
    const isGone = old > this.at;
    this.at = Math.max(0, this.at - old);
    if (wasAtEnd || isGone) this.go(wasAtEnd ? Infinity : 0); else this.showLine();
  }

  // The past of the robot is gone with the server that has kept it.
  forget() {
    Object.assign(this, {past: null, wanted: null});
    this.timeline.clear();
    this.go(Infinity);
  }

  end() {
    if (!this.isOpen) return;
    this.stop();
    const hadFocus = this.bar.contains(document.activeElement);
    this.bar.hidden = true;
    Object.assign(this, {moments: [], statuses: new Map(), owner: null, isLive: false, past: null, wanted: null, hasPast: false});
    this.ended();
    this.on.paint();
    if (hadFocus) if (this.before?.isConnected && this.before.getClientRects().length) this.before.focus(); else byId('picture').querySelector('[tabindex="0"]')?.focus();
  }

  stop() {
    clearTimeout(this.timer);
    this.timer = null;
    this.pause.textContent = '▶';
  }

  first() { if (this.hasPast) this.timeline.go(this.timeline.begin); else this.go(0); }
  last() { if (this.hasPast) this.timeline.go(this.isRecorded ? this.timeline.end : null); else this.go(Infinity); }
  step(count) { this.stop(); if (this.hasPast) this.timeline.jump('change', Math.sign(count)); else this.go(this.at + count); }

  // Lanes of a robot come from the server, as far as that keeps its past.
  async askLanes() {
    const {owner, isLive, moments} = this;
    if (!isLive || !owner?.lanes || this.isAsking) return;
    this.isAsking = true;
    const lanes = await owner.lanes(this.timeline.revision).catch(() => null);  // the server is away; it is asked again
    if (this.moments !== moments) return;
    this.isAsking = false;
    if (lanes) { this.hasPast = true; this.showLanes(lanes); }
    if (lanes?.more) this.askLanes();
  }

  showLanes(lanes) {
    this.lanes.classList.toggle('has-past', this.hasPast);
    this.lanes.classList.toggle('is-recorded', !lanes.live);
    const isFirst = this.lanes.hidden;
    this.lanes.hidden = false;
    this.timeline.take(lanes);
    if (isFirst && !lanes.live) this.timeline.all();
    if (isFirst && this.isRecorded) this.timeline.go(lanes.begin);
  }

  // What was chosen on the lanes; null is now.
  async show(time) {
    if (!this.hasPast) { this.stop(); this.go(time === null ? Infinity : this.moments.findLastIndex((one) => one.time <= time + 1e-9), true); return; }
    if (time === null && this.isRecorded) { this.end(); return; }
    this.wanted = time;
    if (time === null) this.past = null;
    else if (!this.isFetching) {
      this.isFetching = true;
      const {owner, moments} = this;  // another robot has other moments
      try { const past = await owner.at(time); if (this.moments === moments && this.wanted !== null) this.past = past; } catch (refusal) { this.timeline.tell(refusal.message); }
      if (this.moments !== moments) return;
      this.isFetching = false;
      if (this.wanted !== null && this.wanted !== time) { this.show(this.wanted); return; }
    }
    this.go(this.at);
  }

  toggle() {
    if (this.timer) { this.stop(); return; }
    if (this.isRecorded) {
      const {timeline} = this, play = () => { if (timeline.at >= timeline.end) this.stop(); else { timeline.go(timeline.at + STEP_MS / 1000); this.timer = setTimeout(play, STEP_MS); } };
      this.pause.textContent = '‖';
      play();
      return;
    }
    if (this.hasPast) { if (this.past) this.timeline.go(null); else this.timeline.jump('change', -1); return; }
    if (this.isLive) { this.go(this.isAtEnd ? this.at - 1 : Infinity); return; }
    if (this.isAtEnd) this.go(0);
    const next = () => {
      if (this.isAtEnd) { this.stop(); return; }
      const wait = this.isTimed ? Math.min(STEP_MS, Math.max(LEAST_MS, 1000 * PACE * (this.moments[this.at + 1].time - this.moments[this.at].time))) : STEP_MS;
      this.timer = setTimeout(() => { this.go(this.at + 1); next(); }, wait);
    };
    next();
    if (this.timer) this.pause.textContent = '‖';
  }

  go(index, isFromLanes = false) {
    if (!this.moments.length) return;
    this.at = Math.max(0, Math.min(index, this.moments.length - 1));
    const moment = this.past ?? this.moments[this.at], before = this.statuses;
    this.statuses = moment.statuses();
    if (!this.isLive && !this.lanes.hidden && !isFromLanes) Object.assign(this.timeline, {at: moment.time}).redraw();
    this.told.setAttribute('aria-live', (this.isLive && this.isAtEnd && !this.past) || this.timer ? 'off' : 'polite');
    this.told.replaceChildren(html('b', {}, moment.title), ...moment.lines.map((line) => html('span', {class: line.startsWith('✗') ? 'error' : null}, line)));
    this.showLine();
    this.on.paint();
    if (!this.isFollowing.checked) return;
    const changed = [...this.statuses].filter(([place, status]) => before.get(place) !== status && status !== 'IDLE');
    const [place] = changed.findLast(([, status]) => status === 'RUNNING') ?? changed.at(-1) ?? [];
    if (place) this.on.follow(...place.split('\n'));
  }

  // Statuses that are known only now, such as after the places of the nodes have arrived.
  again() { if (this.isOpen && this.moments.length) this.go(this.at); }

  showLine() {
    const {moments, at} = this, first = moments[0], last = moments.at(-1), moment = moments[at];
    this.line.max = this.isTimed ? last.time - first.time : moments.length - 1;
    this.line.value = this.isTimed ? moment.time - first.time : at;
    const when = this.past ? `${this.isRecorded ? '' : 'PAST '}${this.timeline.label}` : this.isLive ? (this.isAtEnd ? 'now' : `${(last.time - moment.time).toFixed(1)} s ago`) : moment.time === null ? '' : `${moment.time.toFixed(3)} s`;
    this.count.textContent = this.isLive ? when : [when, `${at + 1} of ${moments.length}`].filter(Boolean).join(' · ');
    this.line.setAttribute('aria-label', `moments of ${this.title.textContent}`);
    this.line.setAttribute('aria-valuetext', this.count.textContent);
    if (this.isLive && !this.timer) this.pause.textContent = this.isAtEnd && !this.past ? '‖' : '▶';
    this.on.moved?.(at);
  }

  // Draw on each item of a graph its status, and on what is folded also what is in it. tint has places that are never reached.
  paint(graph, file, tint) {
    for (const item of graph.items) {
      const place = placeOf(file, item.path), status = this.statuses.get(place) ?? (tint.has(place) ? 'NEVER' : '');
      const text = [status && `${SIGNS[status] ?? '•'} ${WORDS[status] ?? status}`, item.isFolded ? this.sum(file, item.path) : ''].filter(Boolean).join(' · ');
      if ((item.shown ?? '') === text) continue;
      item.shown = text;
      const {element, box: [x, y]} = item;
      element.querySelector(':scope > .run-status')?.remove();
      element.classList.remove(...[...element.classList].filter((one) => one.startsWith('st-')));
      graph.describe(item, 'status', text.replace(/[▶✓✗»■∅•] ?/gu, ''));
      if (!text) continue;
      if (status) element.classList.add(`st-${status.toLowerCase()}`);
      element.append(svg('g', {class: 'run-status'}, svg('rect', {x: x + 4, y: y - 14, width: widthOf(text, FONT) + 12, height: 17, rx: 4}), svg('text', {x: x + 10, y: y - 1.5}, text)));
    }
  }

  // What is in a folded item: what runs there, or else how many ended how.
  sum(file, path) {
    const within = placeOf(file, path === '/' ? '' : path) + (path === '/' ? '' : '/');
    const inside = [...this.statuses].filter(([place]) => place.startsWith(within) && place !== placeOf(file, path));
    const running = inside.filter(([place, status]) => status === 'RUNNING' && !inside.some(([other, its]) => its === 'RUNNING' && other.startsWith(`${place}/`)));
    if (running.length) return `inside RUNNING: ${running.map(([place]) => this.on.name(...place.split('\n'))).join(', ')}`;
    const counts = ['SUCCESS', 'FAILURE'].map((status) => [SIGNS[status], inside.filter(([, one]) => one === status).length]).filter(([, count]) => count);
    return counts.length ? `inside ${counts.map(([sign, count]) => `${count} ${sign}`).join(' ')}` : '';
  }
}
