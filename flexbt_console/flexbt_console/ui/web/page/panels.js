// SPDX-License-Identifier: BSD-3-Clause
// Panels in columns: each can be folded to its head, enlarged, resized, and moved by drag or by keys. The browser remembers it.

import {html} from './elements.js';

const MOST_COLUMNS = 3;
const STEP = 0.1;  // of the two parts at a separator, for a key

// The panels are the children of root: sections with a .panel-head. usual is {wide, narrow}, each a list of columns of
// their identifiers; narrow is the media query of a page that scrolls, with one column. Returns {reset}.
export function panels(root, name, usual, narrow) {
  const all = new Map([...root.children].map((panel) => [panel.id, panel]));
  const query = matchMedia(narrow);
  let state;

  const mode = () => query.matches ? 'narrow' : 'wide';
  const key = () => `${name}-panels-${mode()}`;
  const save = () => { try { localStorage.setItem(key(), JSON.stringify(state)); } catch { /* it is not remembered then */ } };

  function load() {
    let saved = null;
    try { saved = JSON.parse(localStorage.getItem(key())); } catch { /* not ours */ }
    const isWhole = Array.isArray(saved?.columns) && saved.columns.every(Array.isArray) && saved.columns.flat().sort().join() === [...all.keys()].sort().join();
    state = {columns: (isWhole ? saved.columns : usual[mode()]).map((column) => [...column]), shares: {}, folded: []};
    if (!isWhole) return;
    for (const [id, share] of Object.entries(saved.shares ?? {})) if (share > 0 && share < 1000) state.shares[id] = share;
    state.folded = [...all.keys()].filter((id) => saved.folded?.includes?.(id));
  }

  // The share of a panel, or of the column that begins with it, which is called as the panel and a colon. Usually they
  // are data-share and data-column of the panel.
  const shareOf = (id) => state.shares[id] ?? (Number(id.endsWith(':') ? all.get(id.slice(0, -1)).dataset.column : all.get(id).dataset.share) || 1);

  // Fold the panels, which stay where they are, or give them their shares.
  function size() {
    for (const [id, panel] of all) {
      const isFolded = state.folded.includes(id);
      panel.classList.toggle('folded', isFolded);
      panel.style.flexGrow = isFolded ? 0 : shareOf(id);
      panel.querySelector('.fold').setAttribute('aria-expanded', String(!isFolded));
    }
  }

  function draw() {
    const focused = root.contains(document.activeElement) ? document.activeElement : null;
    const scrolled = [...root.querySelectorAll('*')].filter((one) => one.scrollTop || one.scrollLeft).map((one) => [one, one.scrollLeft, one.scrollTop]);
    const columns = state.columns.filter((column) => column.length);
    state.columns = columns;
    root.replaceChildren(...columns.flatMap((ids, at) => {
      const column = html('div', {class: 'column'});
      column.style.flexGrow = shareOf(`${ids[0]}:`);
      ids.forEach((id, row) => {
        if (row) column.append(separator('horizontal', ids[row - 1], id));
        column.append(all.get(id));
      });
      return at ? [separator('vertical', `${columns[at - 1][0]}:`, `${ids[0]}:`), column] : [column];
    }));
    size();
    for (const [one, left, top] of scrolled) one.scrollTo(left, top);  // it begins anew where a panel was moved
    if (focused && document.activeElement !== focused) focused.focus();
  }

  function separator(orientation, before, after) {
    const isRow = orientation === 'horizontal';
    const bar = html('div', {class: 'separator', role: 'separator', tabindex: '0', 'aria-orientation': orientation, 'aria-label': 'resize the panels beside it', 'aria-valuemin': '5', 'aria-valuemax': '95'});
    const set = (part) => {
      const sum = shareOf(before) + shareOf(after), share = Math.min(0.95, Math.max(0.05, part));
      state.shares[before] = sum * share;
      state.shares[after] = sum - sum * share;
      bar.previousElementSibling.style.flexGrow = state.shares[before];
      bar.nextElementSibling.style.flexGrow = state.shares[after];
      told();
    };
    const part = () => shareOf(before) / (shareOf(before) + shareOf(after));
    const told = () => bar.setAttribute('aria-valuenow', String(Math.round(100 * part())));
    told();
    bar.addEventListener('keydown', (event) => {
      const by = (isRow ? {ArrowUp: -STEP, ArrowDown: STEP} : {ArrowLeft: -STEP, ArrowRight: STEP})[event.key];
      if (!by) return;
      event.preventDefault();
      set(part() + by);
      save();
    });
    bar.addEventListener('pointerdown', (event) => { event.preventDefault(); bar.setPointerCapture(event.pointerId); });
    bar.addEventListener('pointermove', (event) => {
      if (!bar.hasPointerCapture(event.pointerId)) return;
      const from = bar.previousElementSibling.getBoundingClientRect(), to = bar.nextElementSibling.getBoundingClientRect();
      set(isRow ? (event.clientY - from.top) / (to.bottom - from.top) : (event.clientX - from.left) / (to.right - from.left));
    });
    bar.addEventListener('pointerup', save);
    return bar;
  }

  const where = (id) => { const at = state.columns.findIndex((ids) => ids.includes(id)); return [at, state.columns[at].indexOf(id)]; };

  function move(id, to, row) {
    const [from, at] = where(id);
    state.columns[from].splice(at, 1);
    (state.columns[to] ??= []).splice(Math.min(row, state.columns[to].length), 0, id);
    save();
    draw();
  }

  // One place on, for an arrow key; beyond the last column there is a new one.
  function step(id, arrow) {
    const [at, row] = where(id), count = state.columns[at].length;
    if (arrow === 'ArrowUp' && row > 0) move(id, at, row - 1);
    else if (arrow === 'ArrowDown' && row < count - 1) move(id, at, row + 1);
    else if (mode() === 'wide' && arrow === 'ArrowLeft' && at > 0) move(id, at - 1, row);
    else if (mode() === 'wide' && arrow === 'ArrowRight' && (at + 1 < state.columns.length || (count > 1 && at + 1 < MOST_COLUMNS))) move(id, at + 1, row);
  }

  function enlarge(panel) {
    const isFull = panel.classList.toggle('full');
    root.classList.toggle('enlarged', isFull);
    panel.querySelector('.enlarge').setAttribute('aria-pressed', String(isFull));
  }

  for (const [id, panel] of all) {
    const head = panel.querySelector('.panel-head'), title = panel.querySelector('h2').textContent;
    const button = (mark, text, kind) => html('button', {type: 'button', class: `quiet ${kind}`, 'aria-label': `${text}: ${title}`, title: text}, mark);
    const fold = button('▾', 'Fold the panel', 'fold'), full = button('⤢', 'Enlarge the panel, or show all', 'enlarge');
    const grip = button('✥', 'Move the panel: arrow keys, or drag', 'grip');
    head.append(html('span', {class: 'tools'}, grip, full, fold));
    fold.addEventListener('click', () => {
      state.folded = state.folded.includes(id) ? state.folded.filter((one) => one !== id) : [...state.folded, id];
      save();
      size();
    });
    full.addEventListener('click', () => enlarge(panel));
    grip.addEventListener('keydown', (event) => {
      if (!event.key.startsWith('Arrow')) return;
      event.preventDefault();
      step(id, event.key);
    });
    // Drop it on the upper or lower half of another one.
    let over = null;
    grip.addEventListener('pointerdown', (event) => { grip.setPointerCapture(event.pointerId); });
    grip.addEventListener('pointermove', (event) => {
      if (!grip.hasPointerCapture(event.pointerId)) return;
      over?.classList.remove('drop-before', 'drop-after');
      over = document.elementsFromPoint(event.clientX, event.clientY).find((one) => all.has(one.id) && one !== panel) ?? null;
      if (!over) return;
      const box = over.getBoundingClientRect();
      over.classList.add(event.clientY < box.top + box.height / 2 ? 'drop-before' : 'drop-after');
    });
    grip.addEventListener('pointerup', () => {
      if (!over) return;
      const isAfter = over.classList.contains('drop-after');
      over.classList.remove('drop-before', 'drop-after');
      const [from, at] = where(id), [to, row] = where(over.id);
      over = null;
      move(id, to, row + isAfter - (from === to && at < row));
    });
  }

  const begin = () => { load(); draw(); };
  query.addEventListener('change', begin);
  begin();
  return {reset: () => { try { localStorage.removeItem(key()); } catch { /* nothing is remembered */ } begin(); }};
}
