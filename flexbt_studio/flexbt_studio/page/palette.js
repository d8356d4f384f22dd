// SPDX-License-Identifier: BSD-3-Clause
// The palette: node types and states by kind and package, with a search and help.

import {search} from './choice.js';
import {byId, html} from './elements.js';

const KINDS = ['control', 'decorator', 'action', 'condition', 'subtree'];

// An entry is {label, kind, package, detail, help, ...}: what is chosen is given to on.add(entry); on.drag(event, entry).
export class Palette {
  constructor(on) {
    this.on = on;
    this.entries = [];
    this.list = byId('palette');
    this.field = byId('palette-filter');
    this.field.addEventListener('input', () => this.draw());
    this.field.addEventListener('keydown', (event) => {
      if (event.key === 'ArrowDown') { event.preventDefault(); this.list.focus(); }
      if (event.key === 'Enter') { event.preventDefault(); if (this.shown[this.at]) on.add(this.shown[this.at]); }
    });
    this.list.addEventListener('keydown', (event) => {
      const to = {ArrowDown: this.at + 1, ArrowUp: this.at - 1, Home: 0, End: this.shown.length - 1, PageDown: this.at + 10, PageUp: this.at - 10}[event.key];
      if (to !== undefined) { event.preventDefault(); this.mark(Math.max(0, Math.min(to, this.shown.length - 1))); }
      if (event.key === 'Enter' && this.shown[this.at]) { event.preventDefault(); on.add(this.shown[this.at]); }
    });
    this.list.addEventListener('pointerdown', (event) => {
      const line = event.target.closest('[role="option"]');
      if (!line) return;
      this.mark(Number(line.dataset.index));
      if (!event.button && event.pointerType !== 'touch') on.drag(event, this.shown[this.at]);
    });
    this.list.addEventListener('dblclick', (event) => { if (event.target.closest('[role="option"]')) on.add(this.shown[this.at]); });
  }

  show(entries) {
    this.entries = entries;
    this.draw();
  }

  draw() {
    const found = search(this.entries, this.field.value), groups = new Map();
    for (const one of found) {
      const name = `${one.kind} · ${one.package}`;
      if (!groups.has(name)) groups.set(name, []);
      groups.get(name).push(one);
    }
    const rank = ([name]) => { const at = KINDS.indexOf(name.split(' ')[0]); return at < 0 ? KINDS.length : at; };
    const sorted = [...groups].sort((a, b) => rank(a) - rank(b));
    this.shown = sorted.flatMap(([, list]) => list);
    let index = -1;
    this.list.replaceChildren(...sorted.map(([name, list]) => html('div', {role: 'group', 'aria-label': name}, html('h3', {role: 'presentation'}, name), ...list.map((one) => {
      index += 1;
      return html('div', {role: 'option', id: `palette-${index}`, 'data-index': index, title: one.detail}, one.label);
    }))));
    this.mark(0);
  }

  mark(index) {
    this.list.querySelector('[aria-selected="true"]')?.removeAttribute('aria-selected');
    this.at = index;
    const line = byId(`palette-${index}`);
    line?.setAttribute('aria-selected', 'true');
    this.list.setAttribute('aria-activedescendant', line?.id ?? '');
    if (document.activeElement === this.list || document.activeElement === this.field) line?.scrollIntoView({block: 'nearest'});
    const one = this.shown[index];
    byId('palette-help').replaceChildren(...(one ? helpOf(one) : [this.entries.length ? 'Nothing matches.' : '']));
  }
}

// What is known about an entry, as elements.
export function helpOf({label, kind, detail, documentation, ports = [], example, installed = true}) {
  return [
    html('strong', {}, label), ` ${kind}\n${documentation || detail || ''}`, ...(installed ? [] : [html('p', {class: 'warning'}, 'Not installed here: it is checked, but runs only where its package is.')]),
    ...(ports.length ? [html('dl', {}, ...ports.flatMap((port) => [html('dt', {}, port.name), html('dd', {}, portHelp(port))]))] : []),
    ...(example ? [html('pre', {}, example.trim())] : []),
  ];
}

export function portHelp({direction = '', type, default: usual, required, description}) {
  return [[direction, type, usual !== null && usual !== undefined ? `default ${usual || "''"}` : '', required ? 'required' : ''].filter(Boolean).join(', '), description].filter(Boolean).join('. ');
}
