// SPDX-License-Identifier: BSD-3-Clause
// What has changed between two versions of a file: on the graph, as a list to step through, and in both texts. And a change that
// is proposed, in hunks of which each is accepted or refused by itself.

import {fromEdits, hunks, inverse, placed, toEdits} from './changes.js';
import {choose} from './choice.js';
import {byId, html, svg} from './elements.js';
import {Graph, shortened, widthOf} from './graph.js';
import {drawMachine} from './machine_drawing.js';
import {sheet, textDifference} from './sheets.js';
import {drawTrees} from './tree_drawing.js';

const SIGNS = {added: '+', removed: '−', changed: '≠', moved: '↷'};
const FONT = '600 11px system-ui, sans-serif';
const MOST = 3_000_000;  // characters of both texts that are compared as a picture
const MANY = 60;  // nodes of a picture beyond which what has not changed is folded
const words = (kinds) => kinds.map((kind) => `${SIGNS[kind]} ${kind}`).join(', ');

// The picture of what has changed between two texts, with the list of changes. show(change) is called for the chosen one.
async function changePicture(link, file, before, after, show) {
  const told = html('p', {class: 'hint', role: 'status'});
  let found;
  try {
    if (before.length + after.length > MOST) throw new Error(`both texts have more than ${MOST} characters`);
    found = await link.request('compared', {file, before, after});
    if (found.view.states && !found.layout) throw new Error(found.problems[0] ?? 'no state is in either text');
  } catch (refusal) {
    told.textContent = `No picture: ${refusal.message}`;
    return {element: told, step() {}};
  }
  const {view, layout, marks, changes, problems} = found, nodes = view.nodes ?? [];
  for (const node of nodes) node.kind = (node.kind ?? '').toLowerCase();
  const parents = new Map([...nodes.map((one) => [one.path, one.parent ?? one.tree]), ...(view.states ?? []).map((one) => [one.path, one.parent])]);
  const above = (path) => { const all = []; for (let one = parents.get(path.split('#')[0]); one; one = parents.get(one)) all.push(one); return all; };
  const kept = new Set(Object.keys(marks).flatMap(above));  // what has a change inside
  const folded = new Set(nodes.length > MANY ? [...parents.values()].filter((one) => one !== null && !kept.has(one)) : []);
  const pane = html('div', {class: 'graph-body'}), image = svg('svg', {class: 'picture', role: 'tree', 'aria-label': 'what has changed'});
  const list = html('ol', {class: 'list', 'aria-label': 'changes'}), count = html('span', {class: 'hint'});
  let at = -1;
  pane.append(image);
  const draw = () => graph.draw(layout ? drawMachine(view, layout, new Set()) : drawTrees(view, folded));
  const paint = () => {
    for (const {path, element, isFolded, box: [x, y]} of graph.items) {
      const kinds = marks[path] ?? [], inside = isFolded ? Object.keys(marks).filter((one) => one.startsWith(`${path}/`)).length : 0;
      const text = [words(kinds), inside ? `${inside} inside` : ''].filter(Boolean).join(' · ');
      if (!text) continue;
      element.classList.add('change', ...kinds.map((kind) => `is-${kind}`));
      element.setAttribute('aria-description', text);
      element.append(svg('g', {class: 'run-status'}, svg('rect', {x: x + 10, y: y - 10, width: widthOf(text, FONT) + 12, height: 17, rx: 4}), svg('text', {x: x + 16, y: y + 2.5}, text)));
    }
    for (const way of image.querySelectorAll('.way[data-way]')) way.classList.add(...(marks[way.dataset.way] ?? []).map((kind) => `is-${kind}`));
  };
  const mark = (index) => {
    at = index;
    [...list.children].forEach((line, number) => line.setAttribute('aria-current', String(number === at)));
    list.children[at]?.scrollIntoView({block: 'nearest'});
    count.textContent = `${at + 1} of ${changes.length}`;
  };
  const go = (index) => {
    const change = changes[index];
    mark(index);
    const hidden = above(change.path).filter((one) => folded.delete(one));
    if (hidden.length) draw();
    if (graph.byPath.has(change.path)) graph.mark(change.path);
    told.textContent = [`${words(change.kinds)}: ${change.title}`, ...change.lines].join('; ');
    show(change);
  };
  const graph = new Graph({
    select(path) { graph.mark(path); graph.focus(); const index = changes.findIndex((one) => one.path === path); if (index >= 0) go(index); },
    fold(path) { if (!layout && !folded.delete(path)) folded.add(path); draw(); graph.mark(path); graph.focus(); },
    open() {}, drop() {}, zones: () => [], problem: () => '', drawn: paint,
  }, pane, image);
  list.append(...changes.map((one, index) => html('li', {}, html('button', {type: 'button', class: one.kinds.map((kind) => `is-${kind}`).join(' '), onclick: () => go(index)}, `${words(one.kinds)}: ${one.title}`, ...one.lines.map((line) => html('span', {class: 'hint', title: line}, shortened(line, 120)))))));
  draw();
  if (changes.length) graph.mark(changes[0].path);
  const step = (by) => { if (changes.length) go(((at < 0 && by < 0 ? 0 : at) + by + changes.length) % changes.length); };
  const sums = Object.keys(SIGNS).map((kind) => [kind, changes.filter((one) => one.kinds.includes(kind)).length]).filter(([, sum]) => sum);
  told.textContent = problems.length ? `Not all of a text can be read: ${problems[0]}` : changes.length ? sums.map(([kind, sum]) => `${sum} ${kind}`).join(', ') : before === after ? 'Both texts are the same.' : 'The graphs are the same; only the texts differ.';
  const button = (text, by, title) => html('button', {type: 'button', title, disabled: !changes.length, onclick: () => step(by)}, text);
  const steps = html('div', {class: 'buttons'}, button('‹ Previous', -1, 'Previous change (Shift+F8)'), button('Next ›', 1, 'Next change (F8)'), count, told);
  return {element: html('div', {class: 'versions'}, steps, html('div', {}, pane, list)), step};
}

// Show a sheet with the picture; F8 and Shift+F8 step through it. Resolves as sheet() does.
async function pictureSheet(title, picture, parts, buttons) {
  const keys = new AbortController();
  byId('sheet').addEventListener('keydown', (event) => { if (event.key === 'F8') { event.preventDefault(); picture.step(event.shiftKey ? -1 : 1); } }, {signal: keys.signal});
  const value = await sheet(title, [picture.element, ...parts], buttons);
  keys.abort();
  return value;
}

// Choose an earlier version of the open file, and show what has changed since. Its parts can be taken back.
export async function compareVersions(studio) {
  const {file, link} = studio;
  if (!file) { studio.told('Open a file to compare it', 'warning'); return; }
  await file.settled();
  const found = await link.request('revisions', {file: file.name}).catch((refusal) => { if (refusal.kind === 'lost') throw refusal; return refusal.message; });
  const disk = {label: 'The version on disk', detail: 'what Save overwrites'}, isText = typeof found === 'string';
  const all = isText ? [] : found.map((one) => ({...one, label: `${one.revision.slice(0, 10)} ${one.subject}`, detail: `${one.author}, ${one.time.slice(0, 16).replace('T', ' ')}`, words: one.name}));
  const chosen = await choose(`Compare ${file.name} with`, [disk, ...all], {note: isText ? found : ''});
  if (!chosen) return;
  const before = chosen === disk ? (await link.request('on_disk', {file: file.name})).text : await link.request('text_at', {file: file.name, revision: chosen.revision, name: chosen.name});
  const taken = await file.rewrite('take back', async (after) => {
    const place = html('div', {class: 'merge'}), made = studio.pane.merge?.(place, before, after);
    const picture = await changePicture(link, file.name, before, after, (change) => made?.show(change.before, change.after));
    const title = `${file.name}: since ${chosen === disk ? 'it was saved' : chosen.label}`, told = made ? 'Left: then. Right: now, which you can edit; the arrows take a part from then.' : 'Removed lines were there then; added lines are there now.';
    const isTaken = await pictureSheet(title, picture, [html('p', {class: 'hint'}, told), made ? place : textDifference(before, after)], [['Close', null, 'primary'], ...(made ? [['Take the Right Side', true, '']] : [])]);
    return isTaken && made.text() !== after ? made.text() : null;
  });
  if (taken !== null) studio.told('The right side is the text now; Undo takes it back');
}

// Show a text that is proposed for a file, or for a new one of this name. asked is the text, or a promise of it for the file as it is
// now. What is accepted is one edit. Resolves to whether it was.
export async function propose(studio, title, name, asked, notes) {
  const file = studio.open.get(name) ?? null, before = file?.text ?? '';
  const judge = async (watch) => judged(studio, title, name, file, before, await asked, watch, notes);
  return file ? file.watching(judge) : judge({change: []});
}

async function judged(studio, title, name, file, before, proposed, watch, notes) {
  const found = hunks(before, proposed);
  if (!found.length) { studio.told(`${title}: ${name} has that already`); return false; }
  const boxes = found.map((one, index) => html('input', {type: 'checkbox', checked: true, 'aria-label': `Hunk ${index + 1} of ${found.length}, line ${one.line}`}));
  const rows = (one) => one.rows.map(([kind, line]) => html('div', {class: kind === '-' ? 'removed' : 'added'}, `${kind} ${line.replace(/\n$/, '')}`));
  const list = html('div', {class: 'hunks', role: 'group', 'aria-label': 'hunks: Space accepts or refuses, arrows go on'}, ...found.map((one, index) => html('label', {}, html('span', {}, boxes[index], ` Hunk ${index + 1} of ${found.length}, line ${one.line}`), html('span', {class: 'difference'}, ...rows(one)))));
  list.addEventListener('keydown', (event) => {
    const to = boxes[boxes.indexOf(event.target) + ({ArrowDown: 1, ArrowUp: -1}[event.key] ?? 0)];
    if (to && to !== event.target) { event.preventDefault(); to.focus(); }
  });
  const picture = await changePicture(studio.link, name, before, proposed, (change) => {
    const line = change.after && proposed.slice(0, change.after[0]).split('\n').length;
    const index = change.before ? found.findIndex((one) => one.end > change.before[0]) : found.findIndex((one) => one.after + one.text.split('\n').length > line);
    boxes[index]?.closest('label').scrollIntoView({block: 'nearest'});
  });
  const isAccepted = await pictureSheet(title, picture, [...notes.map((note) => html('p', {class: 'hint'}, note)), list], [[file ? 'Accept the Checked Hunks' : `Make ${name}`, true, 'primary'], ['Refuse All', null, '']]);
  const chosen = found.filter((_, index) => boxes[index].checked);
  if (!isAccepted || !chosen.length) { studio.told(`${title}: nothing was changed`); return false; }
  if (!file) {
    await studio.create(name, chosen.map((one) => one.text).join(''));
    if (studio.file?.name === name) studio.told(`${name} is made; Save writes it`);
    return true;
  }
  studio.graph.focus();
  await accept(studio, file, chosen, watch.change);
  return true;
}

// Put hunks into a text that has changed since. Those whose lines have changed are refused, and all if another page has changed the
// same lines at the same time.
async function accept(studio, file, chosen, change) {
  const edits = chosen.map((one) => placed(one, change, file.text)).filter(Boolean), lost = chosen.length - edits.length;
  const before = file.text, made = fromEdits(edits);
  const refused = lost ? `; ${lost} refused: their lines have changed since` : '';
  if (!edits.length) { studio.told(`nothing was changed${refused}`, 'warning'); return; }
  file.apply(made, 'proposal', true);
  const later = await file.watching(async (watch) => { await file.synced(); return watch; });
  let shift = 0;
  const ranges = edits.map(([start, end, text]) => { const range = [start + shift, start + shift + text.length]; shift += text.length - (end - start); return range; });
  if (toEdits(later.change).some(([start, end]) => ranges.some(([from, to]) => start <= to && from <= end))) {
    file.apply(later.over(inverse(before, made)), 'proposal', true);
    studio.told('another page has changed the same lines at the same time; nothing of the proposal was taken', 'warning');
  } else studio.told(`${edits.length} of ${chosen.length} hunks accepted${refused}`, lost ? 'warning' : 'good');
}
