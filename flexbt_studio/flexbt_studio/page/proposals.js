// SPDX-License-Identifier: BSD-3-Clause
// What tools make for the open file: a tree for a goal by a plan, a machine by a synthesis, models of node types for other editors.

import {ask, choose} from './choice.js';
import {byId, html} from './elements.js';
import {propose} from './versions.js';

const MOST_BYTES = 3_000_000;  // of a file whose models are imported
const UNSAVED = {name: '', version: 0, settled: async () => {}};  // a job for a goal needs no file

// Why there is no machine, line by line.
function explained({text, conflict, never, steps, stuck, remedies}) {
  const part = (title, lines) => (lines.length ? [title, ...lines.map((line) => `  – ${line}`)] : []);
  return [`No machine can do that: ${text}.`, ...part('These demands conflict:', conflict), ...part('From the start:', never), ...part('One course of events:', steps.map((one) => [one.world, one.chosen && `then ${one.chosen}`].filter(Boolean).join('; '))), ...stuck, ...part('What may help:', remedies)].join('\n');
}

export class Goals {
  // jobs starts and ends the jobs; section(id, title, ...parts) and button(id, text, act) make parts of its panel.
  constructor(studio, jobs, section, button) {
    Object.assign(this, {studio, jobs, entries: new Map(), known: []});
    const row = (id, label, ...parts) => html('div', {class: 'field'}, html('label', {for: id}, label), ...parts);
    this.section = section('goal-job', 'Plan from a Goal',
      row('goal-source', 'From', html('select', {id: 'goal-source', onchange: () => this.take()})), row('goal-text', 'Goal', html('input', {id: 'goal-text', list: 'goal-words', maxlength: '10000', spellcheck: 'false', autocomplete: 'off', onkeydown: (event) => { if (event.key === 'Enter' && !event.isComposing) this.make(); }}), html('datalist', {id: 'goal-words'})),
      row('goal-start', 'At the start', html('textarea', {id: 'goal-start', rows: 2, maxlength: '10000', spellcheck: 'false', placeholder: 'as in the file; or one a line'})), row('goal-into', 'Into', html('select', {id: 'goal-into'})),
      html('div', {class: 'buttons'}, button('goal-make', 'Make', () => this.make()), button('goal-show', 'Show Proposal', () => this.propose()), button('goal-cancel', 'Cancel', () => jobs.cancel(this.entry))), html('p', {id: 'goal-told', class: 'hint', role: 'status'}));
  }

  get entry() { return this.entries.get(''); }
  get chosen() { return this.known[Number(byId('goal-source').value)]; }

  // Ask for a goal, of what the files of the project offer.
  async ask() {
    this.jobs.open('goal-job');
    try {
      this.known = await this.studio.link.request('goals');
      byId('goal-source').replaceChildren(...this.known.map((one, index) => html('option', {value: String(index)}, `${one.job === 'plan' ? 'tree' : 'machine'}: ${[one.source, one.request].filter(Boolean).join(', ')}`)));
      this.take();
      byId('goal-source').focus();
    } catch (refusal) {
      byId('goal-told').textContent = refusal.message;
      this.studio.told(refusal.message, 'warning');
    }
  }

  take() {
    const {goal, words} = this.chosen;
    byId('goal-text').value = goal;
    byId('goal-text').placeholder = words.length ? `such as ${words.at(-1)}` : 'such as at(cup, office) & !open(door)';
    byId('goal-words').replaceChildren(...words.map((word) => html('option', {value: word})));
    this.show();
  }

  // What of the open file a result can become a part of.
  get fits() { return {plan: 'xml', synthesize: 'yaml'}[this.chosen?.job] === this.studio.file?.language; }

  async make() {
    const one = this.chosen, lines = byId('goal-start').value.split('\n').map((line) => line.trim()).filter(Boolean);
    if (!one) { await this.ask(); return; }
    const into = byId('goal-into').value, file = into === 'new' ? null : this.studio.file;
    const entry = await this.jobs.start(this.entries, one.job, UNSAVED, {source: one.source, request: one.request, goal: byId('goal-text').value.trim(), start: lines, name: into.startsWith('tree ') ? into.slice(5) : ''});
    const found = this.entry?.event?.result?.[0];
    if (found?.explanation) this.entry.message = explained(found.explanation);
    if (entry) Object.assign(entry, {one, target: file, text: found.tree ?? found.machine});
    this.show();
    if (entry && document.querySelector('dialog[open]')) this.studio.told('The proposal is ready: Show Proposal in Proof and Runs', 'good');
    else if (entry) await this.propose();
    else if (this.entry?.message) this.studio.told(this.entry.message.split('\n')[0], 'warning');
  }

  async propose() {
    if (this.isProposing) return;
    const {entry, studio} = this, {target, text} = entry, [found] = entry.event.result;
    const notes = [found.actions && `Cost ${found.cost}: ${found.actions.join(', ') || 'nothing to do'}`, ...(found.hopeless ?? []).slice(0, 5).map((way) => `No way to the goal after: ${way.join(', ')}`), ...(found.notes ?? [])].filter(Boolean);
    const title = entry.job === 'plan' ? 'A tree for the goal' : 'A machine for the goal';
    this.isProposing = true;
    try {
      if (target) {
        await studio.go(target.name);
        await studio.file.settled();
        await propose(studio, title, target.name, studio.link.request('with_result', {file: target.name, result: text}), notes);
        return;
      }
      const stem = entry.one.source.replace(/\.\w+$/, ''), name = await ask('Name of the new file', entry.job === 'plan' ? `${stem}.xml` : `${stem}_machine.yaml`, 'It is on disk when it is saved.');
      if (name) await propose(studio, title, name, text, notes);
    } finally {
      this.isProposing = false;
    }
  }

  show() {
    const {entry, studio: {file}} = this, isRunning = entry?.state === 'running', into = byId('goal-into');
    const trees = this.fits && this.chosen.job === 'plan' ? file.view.trees.filter((one) => one.id && one.id !== 'Plan').map((one) => [`tree ${one.id}`, `${file.name}, in place of the tree ${one.id}`]) : [];
    const places = [...(this.fits ? [['file', this.chosen.job === 'plan' ? `${file.name}, as the tree Plan` : file.name]] : []), ...trees, ['new', 'a new file']];
    if ([...into.options].map((one) => one.text).join() !== places.map(([, text]) => text).join()) into.replaceChildren(...places.map(([value, text]) => html('option', {value}, text)));
    byId('goal-make').disabled = isRunning || !this.chosen;
    byId('goal-cancel').hidden = !isRunning;
    byId('goal-show').hidden = entry?.state !== 'done';
    byId('goal-job-state').textContent = isRunning ? 'running…' : entry?.state === 'done' ? 'proposed' : entry?.state === 'failed' ? 'no result' : '';
    if (entry || this.chosen) byId('goal-told').textContent = entry?.state === 'failed' ? entry.message : '';
  }
}

// Models of node types (<TreeNodesModel>), for Groot2 and other editors, and from them.

export async function exportModels(studio) {
  const {file} = studio, isTree = file?.language === 'xml';
  const places = [...(isTree ? [{label: 'Models of its node types, into this file', file: file.name, into: true}, {label: 'Models of the node types of this file, into a new one', file: file.name, into: false}] : []), {label: 'Models of all installed node types, into a new file', file: '', into: false}];
  const chosen = await choose('Export', places, {note: 'As <TreeNodesModel>; those of BehaviorTree.CPP itself are left out, every editor knows them.'});
  if (!chosen) return;
  await file?.settled();
  const asked = studio.link.request('models', {file: chosen.file, into: chosen.into});
  if (chosen.into) { await propose(studio, 'Models of its node types', file.name, asked, []); return; }
  const text = await asked, name = await ask('Name of the new file', 'models.xml', 'It is on disk when it is saved.');
  if (name) await studio.create(name, text);
}

export async function importModels(studio) {
  const field = html('input', {type: 'file', accept: '.xml,.btproj'});
  field.addEventListener('change', async () => {
    const [source] = field.files;
    if (source.size > MOST_BYTES) { studio.told(`${source.name} has more than ${MOST_BYTES} bytes; take the part with <TreeNodesModel>`, 'error'); return; }
    const name = await ask('Name of the new file', `palette_${source.name.replace(/\.\w+$/, '')}.xml`, 'It has the models alone. The studio knows their node types as long as it is in the project.');
    if (!name) return;
    const {model, types, added, problems} = await studio.link.request('import_models', {file: name, text: await source.text()});
    for (const one of types) studio.types.set(one.id, {...one, kind: one.kind.toLowerCase()});
    studio.show(studio.added(model));
    studio.file.saved = '';
    studio.told(problems[0] ?? `${added.length} node types added: ${added.slice(0, 8).join(', ')}`, problems.length ? 'warning' : 'good');
  });
  field.click();
}
