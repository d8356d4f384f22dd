// SPDX-License-Identifier: BSD-3-Clause
// Dialogs to read: the difference that Save writes, a file that was changed on disk, the keys.

import {compareLines} from './changes.js';
import {byId, html} from './elements.js';

const CONTEXT = 3;  // lines around a change

let leave = () => {};  // the sheet that is open

// Show a sheet with buttons [[text, value, class]]. Resolves to the value of the one that was pressed, or null, also when another
// one takes its place.
export function sheet(title, parts, buttons = [['Close', null, '']]) {
  leave();
  const dialog = byId('sheet');
  byId('sheet-title').textContent = title;
  byId('sheet-body').replaceChildren(...parts);
  return new Promise((resolve) => {
    const finish = (value) => { leave = () => {}; dialog.onclose = null; dialog.close(); resolve(value); };
    byId('sheet-buttons').replaceChildren(...buttons.map(([text, value, kind]) => html('button', {type: 'button', class: kind, onclick: () => finish(value)}, text)));
    leave = () => finish(null);
    dialog.onclose = () => { if (!dialog.open) finish(null); };
    dialog.showModal();
    byId('sheet-buttons').querySelector('.primary, button')?.focus();
  });
}

const row = (kind, text) => html('div', {class: {'-': 'removed', '+': 'added', '@': 'place'}[kind] ?? ''}, `${kind === '@' ? '' : kind} ${text}`);

// The lines of a unified diff, without its head.
export function unifiedDifference(lines) {
  return html('div', {class: 'difference', tabindex: '0', role: 'group', 'aria-label': 'difference'}, ...lines.slice(2).map((line) => (line.startsWith('@') ? row('@', line) : row(line[0], line.slice(1)))));
}

// Two texts line by line, with some lines around each change.
export function textDifference(before, after) {
  const rows = compareLines(before, after), near = new Set();
  rows.forEach(([kind], at) => { if (kind !== ' ') for (let one = at - CONTEXT; one <= at + CONTEXT; one += 1) near.add(one); });
  const shown = rows.flatMap(([kind, line], at) => (near.has(at) ? [row(kind, line.replace(/\n$/, ''))] : near.has(at - 1) ? [row('@', '…')] : []));
  return html('div', {class: 'difference', tabindex: '0', role: 'group', 'aria-label': 'difference'}, ...shown);
}

// The file was changed on disk. Resolves to {text} to save, or to null.
export async function conflictSheet(file, mine, theirs, merge) {
  const place = html('div', {class: 'merge'});
  const made = merge?.(place, theirs, mine);
  const parts = [html('p', {}, `${file} was changed on disk by another program. Nothing is written until you choose.`), html('p', {class: 'hint'}, made ? 'Left: on disk. Right: yours, which you can edit; the arrows take a part from disk.' : 'Removed lines are on disk only; added lines are yours.'), made ? place : textDifference(theirs, mine)];
  const value = await sheet(`${file}: changed on disk`, parts, [[made ? 'Save the Right Side' : 'Save Mine', 'mine', 'primary'], ['Take the Version on Disk', 'theirs', ''], ['Cancel', null, '']]);
  return value === 'mine' ? {text: made ? made.text() : mine} : value === 'theirs' ? {text: theirs} : null;
}

// Whether the code of behaviors may be run. Resolves to true, or to null.
export const codeSheet = (folder) => sheet('Run the code of behaviors?', [
  html('p', {}, 'Behaviors in Python are only read so far. The checker and proofs import them, as the robot does: that runs their code on this computer.'),
  html('p', {}, 'It runs on copies, in a process with limits of time and memory that writes no other files, starts no other programs and has no connection. This stops mistakes; it is no protection from code that was written to do harm.'),
  html('p', {class: 'hint'}, `Applies to ${folder} until you close this tab.`),
], [['Only Read', null, ''], ['Run Code of This Project', true, '']]);

export function keySheet(commands, place) {
  const groups = [['graph', 'In the Graph'], ['page', 'Everywhere'], ['live', 'While Live Is On']];
  const nav = [['↓ ↑', 'Next, previous item'], ['← →', 'Parent, first child; → opens a folded item'], ['Home End', 'First, last of its siblings'], ['Space', 'Fold or unfold'], ['+ − 0', 'Zoom, fit']];
  return html('div', {class: 'key-table'}, ...groups.map(([where, title]) => html('section', {},
    html('h3', {}, `${title}${place === where ? ' (you are here)' : ''}`), ...(where === 'graph' ? nav : []).flatMap(([keys, text]) => [html('kbd', {}, keys), html('span', {}, text)]),
    ...commands.filter((one) => one.where === where && one.keys).flatMap((one) => [html('kbd', {}, shownKeys(one.keys)), html('span', {}, one.title)]),
  )));
}

export const shownKeys = ([keys]) => keys.replace('ArrowUp', '↑').replace('ArrowDown', '↓').replace('ArrowLeft', '←').replace('ArrowRight', '→').replace(/^([A-Z])$/, 'Shift+$1').replace(/\+([a-z])$/, (_, letter) => `+${letter.toUpperCase()}`);
