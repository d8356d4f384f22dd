// SPDX-License-Identifier: BSD-3-Clause
// Data flow: the keys of the selected tree or machine in a list beside the graph, and who writes and reads one of them over it.

import {byId, html, svg} from './elements.js';

const MOST_KEYS = 500;  // that are listed
const SIGNS = {writes: 'W', reads: 'R', 'reads and writes': 'RW', removes: '×', 'hands over': '→', uses: '?'};

export class Flow {
  // on has file(), link, graph, select(path), rename(key) and uses(key) of one of the keys.
  constructor(on) {
    this.on = on;
    this.keys = this.rows = [];
    this.chosen = null;      // the key whose ways are drawn
    this.list = html('ul', {role: 'listbox', tabindex: '0', 'aria-label': 'keys', onkeydown: (event) => this.press(event)});
    this.places = html('ul', {class: 'list', 'aria-label': 'uses of the key'});
    this.title = html('h3', {id: 'flow-title'});
    this.pane = html('aside', {id: 'flow', hidden: true, 'aria-labelledby': 'flow-title'}, this.title, this.list, this.places);
    byId('graph-body').append(this.pane);
  }

  get isShown() { return !this.pane.hidden; }

  toggle() {
    this.pane.hidden = this.isShown;
    byId('flow-button')?.setAttribute('aria-pressed', String(this.isShown));
    this.chosen = null;
    if (!this.isShown) { this.paint(); this.on.graph.focus(); return; }
    this.update().then(() => this.list.focus());
  }

  // Ask for the keys of the open file; after each new graph of it.
  async update() {
    const file = this.on.file();
    if (!this.isShown || !file) return;
    const keys = await this.on.link.request('flow', {file: file.name}).catch(() => null);
    if (!keys || file !== this.on.file()) return;
    this.keys = keys;
    this.show();
  }

  // The scope that the selected item is in: its tree, or the container of its state.
  scope() {
    const file = this.on.file(), scopes = new Set(this.keys.map((one) => one.scope));
    const selected = file?.parts.get(file.selected);
    for (let part = selected?.kind === 'outcome' ? selected.parent : selected; part; part = part.parent) if (scopes.has(part.path)) return part.path;
    return this.keys[0]?.scope ?? null;
  }

  // What is wrong with a key: what the checker has found, and a read before the first write.
  faults(key) {
    const found = this.on.file().findings.filter((one) => (one.message.includes(`[${key.key}]`) || one.message.includes(`'${key.key}'`)) && key.uses.some((use) => use.path === one.path));
    return [...(key.early ? ['read before it is written'] : []), ...new Set(found.map((one) => one.rule.replaceAll('-', ' ')))];
  }

  show() {
    const scope = this.scope(), all = this.keys.filter((one) => one.scope === scope), rows = all.slice(0, MOST_KEYS);
    this.rows = rows;
    this.shown = scope;
    if (!rows.some((one) => one.key === this.chosen)) this.chosen = null;
    this.title.textContent = `Keys of ${this.on.file().parts.get(scope)?.title ?? 'this file'}${all.length > rows.length ? ` (${rows.length} of ${all.length})` : ''}`;
    this.list.replaceChildren(...rows.map((one, index) => {
      const count = (word) => one.uses.filter((use) => use.role.includes(word)).length, faults = this.faults(one);
      const told = [`${count('writes')} W`, `${count('reads')} R`, ...(one.given ? [`from ${one.given}`] : []), ...faults];
      return html('li', {role: 'option', id: `flow-${index}`, class: faults.length ? 'warning' : '', 'aria-selected': String(one.key === this.chosen), onclick: () => this.choose(index)}, html('code', {}, one.key), html('span', {class: 'hint'}, told.join(' · ')));
    }));
    if (!rows.length) this.list.replaceChildren(html('li', {class: 'empty'}, 'No keys are used here.'));
    this.showPlaces();
    this.paint();
  }

  // After another selection, and a new picture.
  refresh() { if (!this.isShown) return; if (this.scope() === this.shown) this.paint(); else this.show(); }

  choose(index) {
    const one = this.rows[index];
    if (!one) return;
    this.chosen = one.key;
    [...this.list.children].forEach((line, at) => line.setAttribute('aria-selected', String(at === index)));
    this.list.setAttribute('aria-activedescendant', `flow-${index}`);
    this.list.children[index].scrollIntoView({block: 'nearest'});
    this.showPlaces();
    this.paint();
    const shown = one.uses.map((use) => this.on.graph.byPath.get(use.path)).find(Boolean);
    if (shown) this.on.graph.bring(shown);
  }

  showPlaces() {
    const one = this.rows.find((row) => row.key === this.chosen), parts = this.on.file().parts;
    this.places.replaceChildren(...(one?.uses ?? []).map((use) => html('li', {}, html('button', {type: 'button', onclick: () => this.on.select(use.path)}, `${SIGNS[use.role] ?? '?'} ${parts.get(use.path)?.title ?? use.path}`), html('span', {class: 'hint'}, `${use.role}${use.name === one.key ? '' : ` as ${use.name}`}`))));
  }

  press(event) {
    const at = this.rows.findIndex((one) => one.key === this.chosen), last = this.rows.length - 1;
    const to = {ArrowDown: Math.min(at + 1, last), ArrowUp: Math.max(at - 1, 0), Home: 0, End: last}[event.key];
    if (to !== undefined) this.choose(to);
    else if (event.key === 'Enter') this.places.querySelector('button')?.focus();
    else if (event.key === 'Escape') this.on.graph.focus();
    else if (event.key === 'F2' && at >= 0) this.on.rename(this.rows[at]);
    else if (event.key === 'F12' && event.shiftKey && at >= 0) this.on.uses(this.rows[at]);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  // Mark writers and readers of the chosen key in the graph, with arcs by way of the key.
  paint() {
    const {graph} = this.on;
    graph.picture.querySelectorAll('.flow-mark, .flow-way').forEach((one) => one.remove());
    for (const item of graph.items) graph.describe(item, 'keys', '');
    const one = this.isShown && this.rows?.find((row) => row.key === this.chosen);
    if (!one) return;
    const ends = new Map();
    for (const use of one.uses) {
      let path = use.path, item = graph.byPath.get(path);
      while (!item && path.includes('/')) { path = path.slice(0, path.lastIndexOf('/')); item = graph.byPath.get(path); }  // it is in a folded one
      if (!item) continue;
      const known = ends.get(item) ?? new Set();
      use.role.split(' and ').forEach((role) => known.add(role));
      ends.set(item, known);
    }
    if (!ends.size) return;
    const boxes = [...ends.keys()].map((item) => item.box), middle = (values) => (Math.min(...values) + Math.max(...values)) / 2;
    const x = middle(boxes.map(([left, , width]) => left + width / 2)), y = Math.max(...boxes.map(([, top, , height]) => top + height)) + 40;
    const half = 14 + 4 * Math.min(one.key.length, 30), ways = svg('g', {class: 'flow-way'});
    for (const [item, roles] of ends) {
      const [left, top, width, height] = item.box, at = left + width / 2, bottom = top + height;
      const isWriter = roles.has('writes'), isReader = !isWriter || roles.has('reads');
      const curve = (shift) => `M${at + shift} ${bottom}C${at + shift} ${bottom + 30} ${x + shift} ${y - 40} ${x + shift} ${y - 12}`;
      if (isWriter) ways.append(svg('path', {class: 'writes', d: curve(-4), 'marker-end': 'url(#flow-arrow)'}));
      if (isReader) ways.append(svg('path', {class: 'reads', d: curve(4), 'marker-start': 'url(#flow-arrow)'}));
      const word = isWriter && isReader ? 'RW' : isWriter ? 'W' : roles.has('reads') ? 'R' : '?';
      const mark = svg('g', {class: 'flow-mark'}, svg('title', {}, `${[...roles].join(' and ')} ${one.key}`));
      mark.append(isWriter ? svg('rect', {x: left - 11, y: top + height / 2 - 10, width: 22, height: 20}) : svg('circle', {cx: left, cy: top + height / 2, r: 11}), svg('text', {x: left, y: top + height / 2 + 4, 'text-anchor': 'middle'}, word));
      item.element.append(mark);
      graph.describe(item, 'keys', `${[...roles].join(' and ')} key ${one.key}`);
    }
    ways.append(
      svg('defs', {}, svg('marker', {id: 'flow-arrow', viewBox: '0 0 8 8', refX: 7, refY: 4, markerWidth: 7, markerHeight: 7, orient: 'auto-start-reverse'}, svg('path', {d: 'M0 0L8 4L0 8z'}))),
      svg('rect', {x: x - half, y: y - 12, width: 2 * half, height: 24, rx: 12}), svg('text', {x, y: y + 4, 'text-anchor': 'middle'}, one.key.length > 30 ? `${one.key.slice(0, 29)}…` : one.key),
    );
    graph.picture.append(ways);
  }
}
