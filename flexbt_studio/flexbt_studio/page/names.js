// SPDX-License-Identifier: BSD-3-Clause
// Names: where one is used in all files, and another name for it everywhere, which is taken back in one step.

import {mapOffset} from './changes.js';
import {ask, choose} from './choice.js';
import {html} from './elements.js';
import {Refusal} from './session_link.js';
import {sheet, unifiedDifference} from './sheets.js';

const KINDS = {userdata: 'userdata key', key: 'blackboard key'};

export class Names {
  // studio has file, open, link, pane, part, added, go, told.
  constructor(studio) {
    this.studio = studio;
    this.groups = [];  // renamings: the depth of the history of each file behind it
  }

  // Where the name stands that is meant: at the cursor if the text has the focus, else that of the selected item.
  place() {
    const {pane, file} = this.studio, part = this.studio.part(file.selected);
    return pane.hasFocus() || !part ? pane.offset() : this.placeOf(part);
  }

  // Where the name of an item stands; that of the tree for a sub-tree without a name.
  placeOf({file, kind, parent, data, open}) {
    const {attributes = []} = data, named = attributes.find((one) => one.name === 'name') ?? attributes.find((one) => one.name === 'ID');
    const head = kind === 'state' && !parent ? file.view.behavior?.name_span : null;
    return file.now(head ?? named?.span ?? open)[0];
  }

  // Rename what stands at an offset of an open file. Whether it was done; null if the user has left it.
  async rename({file = this.studio.file, offset = this.place(), name = null} = {}) {
    const {studio} = this, {link} = studio;
    return file.watching(async (watch) => {
      await this.settled();
      const here = () => mapOffset(watch.change, offset), meant = await link.request('name', {file: file.name, offset: here()});
      const wanted = name ?? await ask(`Rename the ${KINDS[meant.kind] ?? meant.kind} ${meant.name}`, meant.name, 'It is renamed in all files of the project.');
      if (wanted === null || wanted === meant.name) return null;
      for (;;) {
        const plan = await link.request('rename', {file: file.name, offset: here(), new: wanted});
        if (!plan.files.length) throw new Refusal({kind: 'refused', message: `nothing names ${meant.name}`});
        const isPlain = plan.files.length === 1 && plan.files[0].file === file.name && !plan.notes.length;
        if (!isPlain && !await this.agreed(plan, wanted)) return null;
        const files = await Promise.all(plan.files.map(async (one) => studio.open.get(one.file) ?? studio.added(await link.request('open', {file: one.file}))));
        if (files.every((one, index) => one.version === plan.files[index].version && !one.sent && !one.pending)) { this.apply(plan, files, wanted); return true; }
        studio.told('A file was edited meanwhile: here are the edits again', 'warning');
        await this.settled();
      }
    });
  }

  settled() { return Promise.all([...this.studio.open.values()].map((one) => one.settled())); }

  agreed({kind, name, files, notes}, wanted) {
    const count = files.reduce((sum, one) => sum + one.edits.length, 0);
    const places = notes.map((one) => html('li', {}, html('code', {}, `${one.file}:${one.line}`), ` ${one.text}: `, html('code', {}, one.source.slice(0, 120))));
    return sheet(`Rename the ${KINDS[kind] ?? kind} ${name} to ${wanted}`, [
      html('p', {}, `${count} ${count === 1 ? 'edit' : 'edits'} in ${files.length} ${files.length === 1 ? 'file' : 'files'}. Nothing is saved; Ctrl+Z takes all of it back.`),
      ...(notes.length ? [html('details', {open: notes.length < 6}, html('summary', {}, `Look at ${notes.length === 1 ? 'this place' : `these ${notes.length} places`}: they may mean it, and stay as they are`), html('ul', {class: 'places'}, ...places))] : []),
      html('div', {class: 'merge'}, ...files.flatMap((one) => [html('h3', {}, one.file), unifiedDifference(one.lines)])),
    ], [['Rename', true, 'primary'], ['Cancel', null, '']]);
  }

  // Nothing else runs in between: all files have the new name, or none.
  apply({files, notes}, opened, wanted) {
    opened.forEach((one, index) => one.apply(files[index].edits, 'rename'));
    this.groups = this.groups.filter((one) => ![...one.keys()].some((file) => opened.includes(file)));
    this.groups.push(new Map(opened.map((one) => [one, one.buffer.depth])));
    this.studio.told(`renamed to ${wanted}${opened.length > 1 ? ` in ${opened.length} files` : ''}${notes.length ? `; look at ${notes.slice(0, 5).map((one) => `${one.file}:${one.line}`).join(', ')}${notes.length > 5 ? ', …' : ''}` : ''}`);
  }

  // A file was edited, not taken back or done again: what comes before it in its history is no longer where it was.
  edited(file) { this.groups = this.groups.filter((one) => !(file.buffer.depth <= one.get(file))); }

  // The files that are taken back (or done again) together with the open one; null if one of them was edited since.
  together(file, isRedo) {
    const group = this.groups.find((one) => one.has(file) && file.buffer.depth === one.get(file) - Number(isRedo));
    if (!group) return [file];
    const later = [...group].find(([one, depth]) => this.studio.open.get(one.name) !== one || one.buffer.depth !== depth - Number(isRedo));
    if (!later) return [...group.keys()];
    this.groups.splice(this.groups.indexOf(group), 1);
    this.studio.told(`${later[0].name} was edited after it was renamed: press again to take it back in ${file.name} alone`, 'warning');
    return null;
  }

  // All uses of a name, in all files, to go to one of them.
  async uses({offset = this.place()} = {}) {
    const {studio} = this, {file} = studio;
    await this.settled();
    const {kind, name, uses} = await studio.link.request('uses', {file: file.name, offset});
    const chosen = await choose(`${uses.length} uses of the ${KINDS[kind] ?? kind} ${name}`, uses.map((one) => ({...one, label: `${one.file}:${one.line}`, detail: `${one.text} – ${one.source.slice(0, 160)}`})));
    if (!chosen) return;
    const opened = await studio.go(chosen.file, null, {isJump: true});
    const part = studio.innermost(opened, chosen.span[0]);
    if (part) studio.select(part.path);
    studio.pane.select(...chosen.span);
  }
}
