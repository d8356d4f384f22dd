// SPDX-License-Identifier: BSD-3-Clause
// A dialog that asks for one of many: type to search, arrows to choose, Enter to take it.

import {byId, html} from './elements.js';

const MOST_SHOWN = 200;

// How well a text answers a search: 0 not at all. All words have to be in it; a beginning counts most, then letters in order.
export function likeness(text, wanted) {
  const low = text.toLowerCase();
  let sum = 1;
  for (const word of wanted.toLowerCase().split(/\s+/).filter(Boolean)) {
    const at = low.indexOf(word);
    if (at === 0) sum += 30;
    else if (at > 0) sum += /\W/.test(low[at - 1]) ? 20 : 10;
    else {
      let from = 0;
      for (const letter of word) { from = low.indexOf(letter, from) + 1; if (!from) return 0; }
      sum += 1;
    }
  }
  return sum - text.length / 1000;
}

export function search(options, wanted) {
  if (!wanted.trim()) return options;
  return options.map((one) => [Math.max(likeness(one.label, wanted), 0.4 * likeness(`${one.label} ${one.detail ?? ''} ${one.words ?? ''}`, wanted)), one])
    .filter(([value]) => value > 0.4).sort(([a], [b]) => b - a).map(([, one]) => one);
}

let leave = () => {};  // the dialog that is open

// Ask for one of the options [{label, detail, keys, help}]. free(text) makes an option of what was typed, or null. Resolves to
// the option, or null if the dialog is left, or another one takes its place.
export function choose(title, options, {free = () => null, text = '', note = ''} = {}) {
  leave();
  const dialog = byId('choice'), field = byId('choice-field'), list = byId('choice-list'), help = byId('choice-help');
  let found = [], at = 0;
  byId('choice-title').textContent = title;
  byId('choice-note').textContent = note;
  field.value = text;

  function mark() {
    [...list.children].forEach((line, index) => line.setAttribute('aria-selected', String(index === at)));
    const line = list.children[at];
    field.setAttribute('aria-activedescendant', line?.id ?? '');
    line?.scrollIntoView({block: 'nearest'});
    help.textContent = found[at]?.help ?? '';
    help.hidden = !help.textContent;
  }
  function draw() {
    const own = field.value.trim() ? free(field.value.trim()) : null;
    found = search(options, field.value).slice(0, MOST_SHOWN);
    if (own && !found.some((one) => one.label === own.label)) found.push(own);
    at = 0;
    // A press of the mouse leaves the focus in the field.
    list.replaceChildren(...found.map((one, index) => html('li', {role: 'option', id: `choice-${index}`, onmousedown: (event) => event.preventDefault(), onclick: () => finish(one)},
      html('span', {}, one.label), html('span', {class: 'hint'}, one.detail ?? ''), ...(one.keys ? [html('kbd', {}, one.keys)] : []))));
    if (!found.length) list.append(html('li', {class: 'hint', role: 'option', 'aria-disabled': 'true'}, 'Nothing matches.'));
    mark();
  }
  let finish;
  return new Promise((resolve) => {
    finish = (one) => { leave = () => {}; field.oninput = field.onkeydown = dialog.onclose = null; dialog.close(); resolve(one); };
    field.oninput = draw;
    field.onkeydown = (event) => {
      event.stopPropagation();
      if (event.isComposing) return;
      const last = found.length - 1;
      const to = {ArrowDown: Math.min(at + 1, last), ArrowUp: Math.max(at - 1, 0), PageDown: Math.min(at + 10, last), PageUp: Math.max(at - 10, 0)}[event.key];
      if (to !== undefined) { at = to; mark(); event.preventDefault(); }
      if (event.key === 'Enter') { event.preventDefault(); if (found[at]) finish(found[at]); }
    };
    leave = () => finish(null);
    dialog.onclose = () => { if (!dialog.open) finish(null); };  // the event of an earlier dialog may come late
    draw();
    dialog.showModal();
    field.select();
  });
}

// Ask for a text. Resolves to it, or to null.
export async function ask(title, text, note = '') {
  const chosen = await choose(title, [], {free: (typed) => ({label: typed, detail: ''}), text, note});
  return chosen ? chosen.label : null;
}
