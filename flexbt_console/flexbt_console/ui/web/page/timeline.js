// SPDX-License-Identifier: BSD-3-Clause
// The time line: lanes of states, nodes, decisions, commands, goals and faults; which moment is shown; and the way to others.

import {html, svg} from './elements.js';

const LANES = ['states', 'nodes', 'decisions', 'commands', 'goals', 'faults'];
const SIGNS = {states: '▶', decisions: '?', commands: '◆', goals: '◎', faults: '✗', success: '✓', failure: '✗', halted: '■'};
const ROW = 19, AXIS = 20, CHARACTER = 6.7, LEAST_TEXT = 26;
const USUAL_SPAN = 60, FIRST_SPAN = 5, LEAST_SPAN = 0.5, ZOOM = 1.5, SLOP = 4;
const MOST_ROWS = 200;
const MOST_ENTRIES = 3000;  // of a lane, as on the server
const RESTS = 3;            // times as long as a picture took, until what has come with time is drawn again
const STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400];

const cut = (text, width) => { const most = Math.floor(width / CHARACTER); return text.length <= most ? text : most > 2 ? `${text.slice(0, most - 1)}…` : ''; };
export const ago = (seconds) => { const whole = Math.round(seconds), [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60]; return h ? `${h} h ${m} min` : m ? `${m} min ${s} s` : seconds < 10 ? `${seconds.toFixed(1)} s` : `${s} s`; };

// on.moment(time): show a moment, or now where time is null.
export class Timeline {
  constructor(root, on) {
    this.on = on;
    this.root = root;
    const button = (mark, title, act) => html('button', {type: 'button', class: 'quiet', title, 'aria-label': title, onclick: act}, mark);
    this.range = html('input', {type: 'range', step: 'any', 'aria-label': 'moment that is shown'});
    this.told = html('span', {class: 'timeline-told', role: 'status'});
    this.svg = svg('svg', {class: 'lanes', role: 'img', 'aria-label': 'lanes of the time line'});
    this.body = html('div', {class: 'timeline-body', tabindex: '0', role: 'group', 'aria-label': 'time line: left and right go to the previous and next change, [ ] to failures, { } to decisions, + and - zoom, Escape goes to now'}, this.svg);
    this.live = button('Now', 'Back to now (Esc)', () => this.go(null));
    root.classList.add('timeline');
    root.append(html('div', {class: 'timeline-bar'},
      button('⇤✗', 'Previous failure, of the chosen row if one is chosen ([)', () => this.jump('failure', -1)), button('✗⇥', 'Next failure (])', () => this.jump('failure', 1)),
      button('⇤?', 'Previous decision ({)', () => this.jump('decision', -1)), button('?⇥', 'Next decision (})', () => this.jump('decision', 1)),
      button('−', 'Zoom out (-)', () => this.zoom(ZOOM)), button('⊡', 'Show all (0)', () => this.all()), button('+', 'Zoom in (+)', () => this.zoom(1 / ZOOM)),
      this.range, this.live), this.told, this.body);
    this.range.addEventListener('input', () => this.go(Number(this.range.value), true));
    root.addEventListener('keydown', (event) => this.key(event));
    this.svg.addEventListener('wheel', (event) => this.wheel(event), {passive: false});
    this.pointers = new Map();
    for (const [kind, act] of [['down', 'press'], ['move', 'drag'], ['up', 'release'], ['cancel', 'release']]) this.svg.addEventListener(`pointer${kind}`, (event) => this[act](event));
    new ResizeObserver(() => this.redraw()).observe(this.body);
    this.rested = 0;
    setInterval(() => { if (this.isLive && this.isShown && (this.now - this.drawn) * this.scale >= 1) this.isOld = true; this.refresh(); }, 1000);
    this.clear();
  }

  // Other lanes come: of another robot, or of a recording.
  clear() {
    Object.assign(this, {entries: new Map(), rows: new Map(), chosen: null, at: null, revision: 0, begin: 0, end: 0, heard: performance.now(), wall: 0, isLive: true, span: USUAL_SPAN, right: null, isGrowing: true});
    this.redraw();
  }

  take({entries, revision, begin, end, wall, live}) {  // those that are new since the last time
    if (revision < this.revision) this.entries.clear();
    Object.assign(this, {revision, begin, end, wall, isLive: live, heard: performance.now()});
    for (const entry of entries) this.entries.set(entry.number, entry);
    for (const lane of LANES) {
      const of = [...this.entries.values()].filter((one) => one.lane === lane);
      for (const {number} of of.slice(0, Math.max(0, of.length - MOST_ENTRIES))) this.entries.delete(number);
    }
    this.isOld = true;
    this.refresh();
  }

  get isShown() { return this.body.clientWidth > 0 && this.body.clientHeight > 0; }
  get now() { return this.isLive ? this.end + (performance.now() - this.heard) / 1000 : this.end; }
  clock(time) { return this.wall === null ? `${time.toFixed(1)} s` : new Date(1000 * (this.wall + time)).toISOString().slice(11, 19); }

  // What the badge says: how far the moment that is shown is from now, or from the beginning of a recording.
  get label() { return this.at === null ? '' : this.isLive ? `−${ago(Math.max(0, this.now - this.at))}` : `${ago(this.at - this.begin)} of ${ago(this.end - this.begin)}`; }

  go(time, isKept = false) {
    this.at = time === null ? null : Math.min(Math.max(time, this.begin), this.now);
    if (!isKept) this.reveal();
    this.redraw();
    this.on.moment(this.at);
  }

  reveal() {
    if (this.at === null) this.right = null;
    else if (this.at < this.from || this.at > this.to) this.right = Math.min(this.now, this.at + this.span / 2);
  }

  get to() { return this.right ?? this.now + 0.03 * this.span; }
  get from() { return this.to - this.span; }

  zoom(by, around = this.at ?? this.to) {
    this.isGrowing = false;
    const part = (this.to - around) / this.span;
    this.span = Math.min(Math.max(by * this.span, LEAST_SPAN), Math.max(USUAL_SPAN, 1.1 * (this.now - this.begin)));
    const right = around + part * this.span;
    this.right = this.isLive && right >= this.now ? null : right;
    this.redraw();
  }

  all() {
    this.isGrowing = false;
    this.span = Math.max(LEAST_SPAN, 1.04 * (this.now - this.begin));
    this.right = this.isLive ? null : this.end + 0.02 * this.span;
    this.redraw();
  }

  // Times at which there is something of a kind.
  stops(kind) {
    const all = [...this.entries.values()], ended = (one) => one.end ?? one.begin;
    const times = {
      failure: () => all.filter((one) => one.tone === 'error' && (this.chosen ? this.rowOf(one) === this.chosen : one.lane !== 'nodes')).map((one) => one.lane === 'faults' ? one.begin : ended(one)),
      decision: () => all.filter((one) => one.lane === 'decisions').map((one) => one.begin),
      change: () => all.filter((one) => (!this.chosen || this.rowOf(one) === this.chosen)).flatMap((one) => [one.begin, ended(one)]),
    }[kind]();
    return [...new Set(times)].sort((one, other) => one - other);
  }

  jump(kind, by) {
    const from = this.at ?? this.now, stops = this.stops(kind);
    const to = by < 0 ? stops.findLast((one) => one < from - 1e-6) : stops.find((one) => one > from + 1e-6);
    if (to === undefined) this.tell(`no ${by < 0 ? 'earlier' : 'later'} ${kind}${this.chosen ? ` of ${this.chosen.split('\n').at(-1)}` : ''}`);
    else { this.go(to); this.tell(this.text(to)); }
  }

  // What begins, ends or goes on at a time.
  text(time) {
    const at = [...this.entries.values()].filter((one) => one.lane !== 'nodes' && (Math.abs(one.begin - time) < 1e-6 || Math.abs((one.end ?? -1) - time) < 1e-6));
    return `${this.clock(time)}  ${at.map((one) => this.name(one)).join('; ')}`;
  }

  name(one) { return `${one.label}${one.word && one.word !== one.label ? ` ${one.word}` : ''}${one.count > 1 ? ` ×${one.count}` : ''}`; }
  tell(text) { this.told.textContent = text; }
  rowOf(one) { return `${one.lane}\n${one.key}`; }

  choose(entry) {
    const row = this.rowOf(entry);
    this.chosen = this.chosen === row ? null : row;
    this.tell(this.chosen ? `${entry.label}: [ and ] go to its failures, left and right to its changes` : '');
    this.redraw();
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const act = {ArrowLeft: () => this.jump('change', -1), ArrowRight: () => this.jump('change', 1), '[': () => this.jump('failure', -1), ']': () => this.jump('failure', 1), '{': () => this.jump('decision', -1), '}': () => this.jump('decision', 1),
      '+': () => this.zoom(1 / ZOOM), '=': () => this.zoom(1 / ZOOM), '-': () => this.zoom(ZOOM), 0: () => this.all(), Home: () => this.go(this.begin), End: () => this.go(this.isLive ? null : this.end), Escape: this.at !== null ? () => this.go(null) : null}[event.key];
    if (!act) return;
    event.preventDefault();
    event.stopPropagation();
    act();
  }

  wheel(event) {
    const pages = document.scrollingElement.scrollHeight > document.scrollingElement.clientHeight || this.body.scrollHeight > this.body.clientHeight + 1;
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY) || event.shiftKey) this.pan((event.deltaX || event.deltaY) / 2);
    else if (event.ctrlKey || !pages) this.zoom(Math.exp(event.deltaY * (event.deltaMode ? 16 : 1) / 400), this.timeAt(event.offsetX));
    else return;
    event.preventDefault();
  }

  pan(pixels) {
    const right = this.to + pixels / this.scale;
    this.right = this.isLive && right >= this.now ? null : Math.min(Math.max(this.begin + 0.1 * this.span, right), this.now + 0.9 * this.span);  // some of it stays
    this.redraw();
  }

  timeAt(x) { return this.from + (x - this.left) / this.scale; }

  press(event) {
    if (event.button) return;
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.grabbed = {x: event.offsetX, isMoved: this.pointers.size > 1, scrubs: event.offsetY > this.svg.clientHeight - AXIS || event.offsetY < AXIS};
    this.svg.setPointerCapture(event.pointerId);
  }

  drag(event) {
    if (!this.pointers.has(event.pointerId)) return;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1], [x] = this.pointers.get(event.pointerId);
    if (other) this.zoom(Math.max(8, Math.abs(x - other[0])) / Math.max(8, Math.abs(event.offsetX - other[0])), this.timeAt((event.offsetX + other[0]) / 2));
    else if (Math.abs(event.offsetX - this.grabbed.x) > SLOP || this.grabbed.isMoved) {
      this.grabbed.isMoved = true;
      if (this.grabbed.scrubs) this.go(this.timeAt(event.offsetX), true); else this.pan(x - event.offsetX);
    }
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
  }

  release(event) {
    if (!this.pointers.delete(event.pointerId) || event.type === 'pointercancel' || this.grabbed.isMoved) return;
    const target = document.elementFromPoint(event.clientX, event.clientY)?.closest?.('[data-number]'), entry = this.entries.get(Number(target?.dataset.number));
    if (entry && event.offsetX < this.left) { this.choose(entry); return; }
    if (event.offsetX < this.left) return;
    this.go(entry && (entry.end ?? this.now) - entry.begin < LEAST_TEXT / this.scale ? entry.end ?? entry.begin : this.timeAt(event.offsetX));
    if (entry) this.tell(`${this.clock(entry.begin)}  ${this.name(entry)}  ${entry.end === null ? '' : ago(entry.end - entry.begin)}  ${entry.text}`);
  }

  redraw() {
    if (this.isPlanned) return;
    this.isPlanned = true;
    requestAnimationFrame((began) => { this.isPlanned = false; this.draw(); requestAnimationFrame((now) => { this.rested = now + RESTS * (now - began); }); });
  }

  // Draw what has come with time, which a great picture must not keep the page from all else for.
  refresh() { if (this.isOld && performance.now() >= this.rested) this.redraw(); }

  // Entries of one lane without overlaps, as few rows as it takes; each has its width with its text.
  pack(entries, x) {
    const rows = [];
    for (const entry of entries) {
      const begin = x(entry.begin), end = Math.max(x(entry.end ?? this.now), begin + 3);
      const hides = rows.find(({entries: shown}) => shown.at(-1).begin >= begin - 2 && shown.at(-1).end >= end - 1);  // it would not be seen
      if (hides && (entry.tone !== 'error' || hides.entries.at(-1).entry.tone === 'error')) continue;
      const text = this.isPoint(entry) ? end + 14 + Math.min(150, CHARACTER * this.name(entry).length) : end;
      let row = rows.find((one) => one.free <= begin + 1) ?? (rows.length < 4 ? null : rows.reduce((one, other) => other.free < one.free ? other : one));
      if (!row) rows.push(row = {free: 0, entries: []});
      row.entries.push({entry, begin, end, text: Math.min(text, begin + 170)});
      row.free = this.isPoint(entry) ? text : x(entry.end ?? this.now);
    }
    return rows;
  }

  isPoint(one) { return ['commands', 'faults', 'decisions'].includes(one.lane); }

  draw() {
    const width = this.body.clientWidth;
    Object.assign(this, {isOld: false, drawn: this.now});
    this.range.min = this.begin;
    this.range.max = this.now;
    this.range.value = this.at ?? this.now;
    this.range.setAttribute('aria-valuetext', this.label || 'now');
    this.live.disabled = this.at === null;
    this.live.hidden = this.wall === null;
    if (!this.isShown) return;
    if (this.isGrowing) this.span = Math.min(USUAL_SPAN, Math.max(FIRST_SPAN, 1.05 * (this.now - this.begin)));  // a short run has the whole width
    this.left = width < 480 ? 70 : 120;
    this.scale = (width - this.left - 6) / this.span;
    const {from, to, left} = this, x = (time) => left + (time - from) * this.scale;
    const seen = [...this.entries.values()].filter((one) => (one.end ?? this.now) >= from && one.begin <= to).sort((one, other) => one.begin - other.begin);
    for (const one of this.entries.values()) if (one.lane === 'nodes' && !this.rows.has(one.key)) this.rows.set(one.key, this.rows.size);
    const rows = LANES.flatMap((lane) => {
      const of = seen.filter((one) => one.lane === lane), groups = new Map();
      const key = (one) => lane === 'states' ? one.key.split('/').length : lane === 'nodes' ? this.rows.get(one.key) : 0;
      for (const one of of) { if (!groups.has(key(one))) groups.set(key(one), []); groups.get(key(one)).push(one); }
      const made = [...groups].sort(([one], [other]) => one - other).slice(0, MOST_ROWS).flatMap(([, group]) => this.pack(group, x).map((row, at) => ({...row, lane, label: lane === 'nodes' ? (at ? '' : group[0].label) : '', first: group[0]})));
      return made.map((row, at) => ({...row, title: lane === 'nodes' ? row.label : at ? '' : lane[0].toUpperCase() + lane.slice(1)}));
    });
    const height = Math.max(this.body.clientHeight, 2 * AXIS + rows.length * ROW), parts = [];
    this.svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
    this.svg.setAttribute('width', width);
    this.svg.setAttribute('height', height);
    const step = STEPS.find((one) => one * this.scale >= 90) ?? STEPS.at(-1) * Math.ceil(90 / this.scale / STEPS.at(-1));
    for (let tick = Math.ceil((from + (this.wall ?? 0)) / step) * step - (this.wall ?? 0); tick <= to; tick += step) {
      if (tick < this.begin - step) continue;
      const text = step < 1 && this.wall !== null ? `${this.clock(tick)}.${Math.round(10 * ((this.wall + tick) % 1))}` : this.clock(tick);
      parts.push(svg('line', {class: 'tick', x1: x(tick), x2: x(tick), y1: 0, y2: height}), ...(x(tick) + CHARACTER * text.length + 6 < width ? [svg('text', {class: 'axis', x: x(tick) + 3, y: 13}, text)] : []));
    }
    if (x(this.begin) > left) parts.push(svg('rect', {class: 'before', x: left, y: AXIS, width: x(this.begin) - left, height: height - AXIS}));
    rows.forEach((row, at) => {
      const y = AXIS + at * ROW, chosen = this.rowOf(row.first) === this.chosen;
      if (row.title && row.lane !== 'nodes' && at || row.lane === 'nodes' && rows[at - 1]?.lane !== 'nodes') parts.push(svg('line', {class: 'between', x1: 0, x2: width, y1: y, y2: y}));
      for (const one of row.entries) parts.push(this.bar(one, y, row.entries[row.entries.indexOf(one) + 1]?.begin ?? width));
      const head = svg('g', {class: `row-name${chosen ? ' chosen' : ''}`, 'data-number': row.lane === 'nodes' ? row.first.number : null}, svg('rect', {x: 0, y: y + 1, width: left - 4, height: ROW - 2}), svg('text', {x: 4, y: y + 14}, cut(row.title, left - 22)));
      if (row.lane === 'nodes') head.append(svg('title', {}, row.first.key.replace('\n', ' ')));
      parts.push(head);
    });
    for (const [time, kind] of [[this.isLive ? this.now : null, 'now'], [this.at, 'at']]) if (time !== null && time >= from && time <= to) parts.push(svg('line', {class: kind, x1: x(time), x2: x(time), y1: 0, y2: height}));
    if (!rows.length) parts.push(svg('text', {class: 'axis', x: left + 8, y: AXIS + 24}, this.entries.size ? 'nothing in this time' : 'nothing has happened yet'));
    this.svg.replaceChildren(...parts);
  }

  bar({entry, begin, end, text}, y, next) {
    const from = Math.max(begin, this.left), wide = Math.max(3, end - from), sign = entry.end === null && entry.lane !== 'decisions' && entry.lane !== 'faults' && entry.lane !== 'goals' ? '▶' : SIGNS[entry.word] ?? (entry.tone === 'error' ? '✗' : entry.tone === 'warning' ? '!' : SIGNS[entry.lane] ?? '·');
    const words = entry.lane === 'nodes' ? [entry.word, entry.count > 1 ? `×${entry.count}` : ''].filter(Boolean).join(' ') : this.name(entry);
    const outside = this.isPoint(entry) && wide < LEAST_TEXT, room = outside ? Math.min(next, text) - end : wide;
    const shown = outside ? cut(`${sign} ${words}`, room - 4) || (next - end > 9 ? sign : '') : wide >= LEAST_TEXT ? cut(`${sign} ${words}`, wide - 4) : wide >= 9 ? sign : '';
    return svg('g', {class: `entry ${entry.lane} ${entry.tone}${entry.end === null ? ' open' : ''}`, 'data-number': entry.number},
      svg('rect', {x: from, y: y + 2, width: wide, height: ROW - 4, rx: 2}), ...(shown ? [svg('text', {class: outside ? 'outside' : '', x: (outside ? end : from) + 2, y: y + 14}, shown)] : []),
      svg('title', {}, `${this.clock(entry.begin)}  ${this.name(entry)}  ${entry.end === null ? 'goes on' : ago(entry.end - entry.begin)}\n${entry.text}`));
  }
}
