// SPDX-License-Identifier: BSD-3-Clause
// The graph pane: a tree of items for the eye, the keyboard and a screen reader, whichever way they are drawn.

import {likeness} from './choice.js';
import {byId, html, svg} from './elements.js';
import {viewport} from './viewport.js';

const FIND_MS = 900;   // letters that follow within this time search for one name
const MARGIN = 80;     // units of the picture around the pane in which texts are kept
const TINY = 0.4;      // pixels for a unit below which the second line of a node is left out
const SLOP = 5;        // pixels that the pointer moves before it drags an item

// An item is {path, parent, name, label, note, level, span, element, box: [x, y, width, height], isFolded, count}. They come parents
// first, in the order of the keys. on.select(path), on.fold(path), on.open(path), on.drop(from, to, zone), on.zones(from, to)
// with the zones at which it may be dropped, on.problem(path) → text, on.drawn().
export class Graph {
  constructor(on, pane = byId('graph-body'), picture = byId('picture')) {
    Object.assign(this, {on, pane, picture});
    this.items = [];
    this.view = viewport(this.picture, {changed: () => this.cull()});
    this.byPath = new Map();
    this.selected = null;
    this.found = '';
    this.foundAt = 0;
    this.picture.addEventListener('keydown', (event) => this.key(event));
    this.picture.addEventListener('click', (event) => {
      const path = this.at(event.target);
      if (path === null) return;
      if (event.target.closest('.fold-mark')) this.on.fold(path);
      else this.on.select(path);
    });
    this.picture.addEventListener('dblclick', (event) => { const path = this.at(event.target); if (path !== null) this.on.open(path); });
    this.picture.addEventListener('pointerdown', (event) => {
      const path = this.at(event.target);
      if (path === null || event.button || event.pointerType === 'touch') return;
      event.stopPropagation();
      this.drag(event, path, this.byPath.get(path).name);
    }, {capture: true});
  }

  at(target) { return target.closest?.('[data-path]')?.dataset.path ?? null; }

  // Show items with their drawing: {items, parts, box}.
  draw({items, parts, box}) {
    const hadFocus = this.picture.contains(document.activeElement);
    this.endDrag?.();
    this.items = items;
    this.byPath = new Map(items.map((one) => [one.path, one]));
    const places = new Map();
    for (const one of items) {
      const row = places.get(one.parent) ?? [];
      row.push(one);
      places.set(one.parent, row);
    }
    for (const row of places.values()) row.forEach((one, index) => {
      one.row = row;
      one.index = index;
    });
    for (const one of items) {
      one.children = places.get(one.path) ?? [];
      const set = (key, value) => one.element.setAttribute(key, value);
      set('role', 'treeitem');
      set('data-path', one.path);
      set('tabindex', '-1');
      set('aria-level', one.level);
      set('aria-posinset', one.index + 1);
      set('aria-setsize', one.row.length);
      if (one.count) set('aria-expanded', String(!one.isFolded));
      one.element.classList.toggle('away', one.isAway = true);  // until it is known what is in the pane
    }
    this.marks();
    this.on.drawn();
    this.picture.replaceChildren(...parts);  // when nothing of it changes any more: it is laid out once
    this.view.content(box);
    this.cull();
    this.mark(this.selected);
    if (hadFocus) this.focus();
  }

  // Problems on the items, and in what is folded.
  marks() {
    for (const one of this.items) {
      const problem = this.on.problem(one.path, one.isFolded);
      one.element.classList.toggle('bad', problem !== '');
      if (problem) one.element.setAttribute('aria-invalid', 'true'); else one.element.removeAttribute('aria-invalid');
      one.element.setAttribute('aria-label', `${one.label}${one.isFolded ? `, ${one.count} inside, folded` : ''}${one.note ? `, ${one.note}` : ''}${problem ? `, problem: ${problem}` : ''}`);
      one.element.querySelector('.flag')?.remove();
      if (problem && one.box) {
        const [x, y, width] = one.box;
        one.element.append(svg('g', {class: 'flag'}, svg('title', {}, problem), svg('circle', {cx: x + width, cy: y, r: 9}), svg('text', {x: x + width, y: y + 4.5, 'text-anchor': 'middle'}, '!')));
      }
    }
  }

  // What is spoken of an item besides its label: its status, and what others that paint on it say.
  describe(item, by, text) {
    item.spoken = {status: '', ...item.spoken, [by]: text};
    const spoken = Object.values(item.spoken).filter(Boolean).join(' · ');
    if (spoken) item.element.setAttribute('aria-description', spoken); else item.element.removeAttribute('aria-description');
  }

  mark(path) {
    this.byPath.get(this.selected)?.element.setAttribute('tabindex', '-1');
    this.byPath.get(this.selected)?.element.setAttribute('aria-selected', 'false');
    this.selected = path;
    const item = this.byPath.get(path) ?? this.items[0];
    if (!item) return;
    item.element.setAttribute('tabindex', '0');
    if (item.path === path) {
      item.element.setAttribute('aria-selected', 'true');
      this.bring(item);
    }
  }

  // Bring an item into the pane; a container by its title, the outermost by where it begins.
  bring(item) {
    let first = item;
    while (item.parent === null && first.element.matches('.container')) first = first.children.find((one) => one.state.initial && !one.way) ?? {element: first.element.querySelector('.type')};
    const target = first.element.matches('.container') ? first.element.querySelector('.type') : first.element;
    this.view.reveal(target);
    const outer = this.picture.getBoundingClientRect(), inner = target.getBoundingClientRect();
    if (this.view.moved && outer.width && (inner.right < outer.left + 8 || inner.left > outer.right - 8 || inner.bottom < outer.top + 8 || inner.top > outer.bottom - 8)) this.view.fit();
  }

  // Leave out the texts that are not in the pane, or too small to be read: to lay them out is most of the cost of a move.
  cull() {
    const [x, y, width, height] = this.picture.getAttribute('viewBox').split(' ').map(Number);
    for (const one of this.items) {
      const [left, top, wide, high] = one.box, isAway = left > x + width + MARGIN || left + wide < x - MARGIN || top > y + height + MARGIN || top + high < y - MARGIN;
      if (isAway !== one.isAway) { one.isAway = isAway; one.element.classList.toggle('away', isAway); }
    }
    this.picture.classList.toggle('tiny', this.picture.clientWidth < TINY * width);
  }

  focus() { (this.byPath.get(this.selected) ?? this.items[0])?.element.focus({preventScroll: true}); }
  get hasFocus() { return this.picture.contains(document.activeElement); }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const item = this.byPath.get(this.at(event.target));
    if (!item) return;
    const at = this.items.indexOf(item);
    const go = {
      ArrowDown: () => this.items[at + 1], ArrowUp: () => this.items[at - 1], ArrowLeft: () => this.byPath.get(item.parent),
      ArrowRight: () => { if (!item.isFolded) return item.children[0]; this.on.fold(item.path); return null; },
      Home: () => item.row[0], End: () => item.row.at(-1),
      PageDown: () => this.items[Math.min(at + 10, this.items.length - 1)], PageUp: () => this.items[Math.max(at - 10, 0)],
    }[event.key];
    if (go) {
      event.preventDefault();
      event.stopPropagation();
      this.found = '';
      const to = go();
      if (to) this.on.select(to.path);
    } else if (event.key === ' ' && item.count) {
      event.preventDefault();
      event.stopPropagation();
      this.on.fold(item.path);
    }
  }

  // Find the next item whose name begins with the letters that were typed. Whether there is one.
  find(letter) {
    const now = performance.now();
    this.found = now - this.foundAt < FIND_MS ? this.found + letter : letter;
    this.foundAt = now;
    const at = this.items.findIndex((one) => one.path === this.selected), isNew = this.found.length === 1;
    const order = [...this.items.slice(at + Number(isNew)), ...this.items.slice(0, at + Number(isNew))];
    const hit = order.find((one) => one.name.toLowerCase().startsWith(this.found.toLowerCase())) ?? order.find((one) => likeness(one.name, this.found) > 10);
    if (hit) this.on.select(hit.path);
    return Boolean(hit);
  }
  get isFinding() { return this.found !== '' && performance.now() - this.foundAt < FIND_MS; }

  // Drag an item, or something of the palette with path null, until the pointer is up. what is shown beside the pointer.
  drag(event, path, what) {
    const begin = [event.clientX, event.clientY];
    let label = null, over = null;
    const leave = () => { over?.end?.classList.remove('drop-into'); over?.item.element.classList.remove('drop-into'); over?.mark?.remove(); over = null; };
    const move = (now) => {
      if (!label && Math.hypot(now.clientX - begin[0], now.clientY - begin[1]) < SLOP) return;
      if (!label) {
        label = html('div', {class: 'dragged'}, what);
        document.body.append(label);
      }
      label.style.left = `${now.clientX + 12}px`;
      label.style.top = `${now.clientY + 12}px`;
      leave();
      const below = document.elementFromPoint(now.clientX, now.clientY) ?? document.body, end = path === null ? null : below.closest('[data-end]');
      if (end && this.on.zones(path, end.dataset.of, what, end.dataset.end).length) {
        end.classList.add('drop-into');
        over = {item: this.byPath.get(end.dataset.of), zone: 'end', end};
        return;
      }
      const to = this.at(below);
      const zones = to === null ? [] : this.on.zones(path, to, what);
      if (!zones.length) return;
      const box = this.byPath.get(to).element.querySelector('.box').getBoundingClientRect(), part = (now.clientX - box.left) / box.width;
      const wanted = part < 0.3 ? 'before' : part > 0.7 ? 'after' : 'into';
      over = {item: this.byPath.get(to), zone: zones.includes(wanted) ? wanted : zones.includes('into') ? 'into' : part < 0.5 ? zones[0] : zones.at(-1)};
      if (over.zone === 'into') over.item.element.classList.add('drop-into');
      else {
        const [x, y, width, height] = over.item.box, at = over.zone === 'before' ? x - 9 : x + width + 9;
        over.mark = svg('path', {class: 'drop-mark', d: `M${at} ${y - 4}V${y + height + 4}`});
        this.picture.append(over.mark);
      }
    };
    const end = (now) => {
      for (const [kind, one] of listeners) removeEventListener(kind, one, true);
      label?.remove();
      const target = over;
      leave();
      this.endDrag = null;
      if (target && now.type === 'pointerup') this.on.drop(path, target.item.path, target.zone, target.end?.dataset.end ?? what);
    };
    const escape = (now) => { if (now.key === 'Escape' && label) { now.stopPropagation(); end(now); } };
    const listeners = [['pointermove', move], ['pointerup', end], ['pointercancel', end], ['keydown', escape]];
    for (const [kind, one] of listeners) addEventListener(kind, one, true);
    this.endDrag = () => end({type: 'redrawn'});  // its items are of another picture then
  }
}

// Width of a text on the picture.
const pen = document.createElement('canvas').getContext('2d');
const widths = new Map();
export function widthOf(text, font) {
  const key = `${font} ${text}`;
  let width = widths.get(key);
  if (width === undefined) {
    pen.font = font;
    width = pen.measureText(text).width;
    if (widths.size > 20000) widths.clear();
    widths.set(key, width);
  }
  return width;
}
export const BOLD = '600 13px system-ui, sans-serif', SMALL = '12px system-ui, sans-serif';
export const shortened = (text, most) => text.length > most ? `${text.slice(0, most - 1)}…` : text;
