// SPDX-License-Identifier: BSD-3-Clause
// Proofs, comparisons with what is on disk, and dry runs: they are started here, and what they find is told and played.

import {byId, html} from './elements.js';
import {outcomePath} from './machine_drawing.js';
import {placeOf, statusesAt} from './player.js';
import {exportModels, Goals, importModels} from './proposals.js';
import {remember, remembered} from './server_link.js';
import {compareVersions} from './versions.js';

const SHOWN = 100;  // lines of a dry run before and after the one that is shown
const DOES = {
  succeeds: ['succeeds', (one) => [{gives: 'SUCCESS', after: one.after}]], fails: ['fails', (one) => [{gives: 'FAILURE', after: one.after}]],
  recovers: ['fails N times, then succeeds', (one) => [...Array(one.n).fill({gives: 'FAILURE', after: one.after}), {gives: 'SUCCESS', after: one.after}]],
  nth: ['fails the N-th time', (one) => [...Array(one.n - 1).fill({gives: 'SUCCESS', after: one.after}), {gives: 'FAILURE', after: one.after}, {gives: 'SUCCESS', after: one.after}]],
  hangs: ['never ends', () => ['RUNNING']], passes: ['only ticks its child', () => 'pass'],
};

// The plan of a dry run as bt_tool run --mock takes it. rows: [{pattern, does, n, after}]; board: lines KEY: VALUE.
export function planText(rows, board) {
  const lines = [...new Map(rows.map((one) => [one.pattern, DOES[one.does][1](one)]))].map(([pattern, does]) => `  ${JSON.stringify(pattern)}: ${JSON.stringify(does)}`);
  const keys = board.split('\n').filter((line) => line.trim());
  return [...(lines.length ? ['mocks:', ...lines] : ['mocks: {}']), ...(keys.length ? ['blackboard:', ...keys.map((line) => `  ${line.trim()}`)] : []), ''].join('\n');
}

// A change of a dry run as bt_tool run prints it.
export const lineOf = (one) => `${one.time.toFixed(3).padStart(10)}  ${one.before.padEnd(7)} -> ${one.after.padEnd(7)}  ${one.path}`;
export const counted = (count, thing) => `${count} ${thing}${count === 1 ? '' : 's'}`;

export class Jobs {
  // studio has link, file, treeFiles, told, select, part and pathOf.
  constructor(studio, player) {
    Object.assign(this, {studio, player, waiting: new Map(), proofs: new Map(), changes: new Map(), runs: new Map(), decisions: new Map(), rows: [], coverage: new Map()});
    player.on.moved = (at) => this.showLines(player.owner, at);
    this.isOnSave = remembered('prove-on-save', true);
    const option = (id, text, isOn, set) => html('label', {}, html('input', {type: 'checkbox', id, checked: isOn, onchange: (event) => { set(event.target.checked); studio.graph.on.drawn(); this.show(); }}), ` ${text}`);
    const field = (id, label, hint, name) => html('div', {}, html('label', {for: id}, label), html('textarea', {id, rows: 2, spellcheck: 'false', placeholder: hint, onchange: (event) => remember(`${name}-${studio.pathOf(studio.file)}`, event.target.value)}));
    const button = (id, text, act) => html('button', {type: 'button', id, onclick: act}, text);
    const section = (id, title, ...parts) => html('details', {id, name: 'job'}, html('summary', {}, title, html('span', {id: `${id}-state`, class: 'hint'})), ...parts);
    this.goals = new Goals(studio, this, section, button);
    byId('runs').append(
      section('prove-job', 'Proof', html('div', {class: 'buttons'}, button('prove', 'Prove', () => this.prove()), option('prove-on-save', 'on each save', this.isOnSave, (isOn) => { this.isOnSave = isOn; remember('prove-on-save', isOn); }), option('tint-never', 'tint what is never reached', this.tintsNever = true, (isOn) => { this.tintsNever = isOn; })),
        html('p', {id: 'proof-told', class: 'hint'}), html('ul', {id: 'proof-list', class: 'list'}), field('requirements', 'Requirements, one a line', 'never =FAILURE', 'require')),
      section('compare-job', 'What This Change Does', html('div', {class: 'buttons'}, button('compare', 'Compare with Disk', () => this.compare())), html('div', {id: 'compare-told'})),
      section('run-job', 'Dry Run', html('div', {class: 'buttons'}, html('select', {id: 'run-tree', 'aria-label': 'tree', onchange: () => { this.rowsOf = null; this.show(); }}), button('run', 'Run', () => this.dryRun()), button('copy-plan', 'Copy Plan', () => studio.copyText(this.plan(), 'Plan copied: bt_tool run FILE --mock mocks.yaml does the same')), option('tint-dry', 'tint what no run has reached', this.tintsDry = false, (isOn) => { this.tintsDry = isOn; })),
        html('div', {id: 'mocks'}), field('board', 'Blackboard, one KEY: VALUE a line', 'speed: 0.5', 'board'), html('p', {id: 'run-told', class: 'hint'}), html('ol', {id: 'run-lines', class: 'list mono'})), this.goals.section);
    for (const one of byId('runs').querySelectorAll('details')) one.addEventListener('toggle', () => this.show());
    byId('proof').addEventListener('click', () => (this.proofs.has(studio.file?.name) ? this.open('prove-job') : this.prove()));
    byId('requirements').addEventListener('change', () => {  // a proof of others is old
      const entry = this.proofs.get(studio.file?.name);
      if (!entry || String(entry.more.require) === String(this.required(entry.file))) return;
      if (entry.state === 'running') this.cancel(entry); else entry.state = 'old';
      this.show();
    });
    byId('proof-cancel').addEventListener('click', () => this.cancel(this.proofs.get(studio.file.name)));
  }

  commands(page) { return [page('prove', 'Prove this file', ['F9'], () => this.prove()), page('compare', 'Show what this change does', ['Shift+F9'], () => this.compare()), page('dry_run', 'Dry run', ['F10'], () => this.dryRun()),
    page('goal', 'Make a tree or machine for a goal (plan, synthesize)', null, () => this.goals.ask()), page('versions', 'Compare with an earlier version (disk, git)', ['Alt+F9'], () => compareVersions(this.studio)),
    page('export_models', 'Export models of node types (TreeNodesModel, Groot2)', null, () => exportModels(this.studio)), page('import_models', 'Import a palette of another project (TreeNodesModel, Groot2)', null, () => importModels(this.studio))]; }

  open(id) {
    byId(id).open = true;
    if (byId('runs-pane').classList.contains('folded')) byId('runs-pane').querySelector('.fold').click();
    byId(id).scrollIntoView({block: 'nearest'});
  }

  // Start a job of the server for the text as it is now. Resolves to its entry {job, file, version, state, number, event, ...} when
  // read(entry) has read its result, or to null if it has failed or was cancelled.
  async start(entries, job, file, more, read = () => {}) {
    if (file.language === 'python' && !await this.studio.allowCode()) return null;
    this.cancel(entries.get(file.name));
    const entry = {job, file, more, state: 'running', number: null, files: new Set([file.name])};
    entries.set(file.name, entry);
    this.show();
    try {
      await file.settled();
      if (entry.state !== 'running') return null;
      entry.version = file.version;
      const {number, files} = await this.studio.link.request('start_job', {job, file: file.name, version: entry.version, ...more});
      Object.assign(entry, {number, files: new Set([file.name, ...files])});
      if (entry.state !== 'running') this.studio.link.request('cancel_job', {number: entry.number}).catch(() => {});  // it was cancelled meanwhile
      else entry.event = await new Promise((done) => this.waiting.set(entry.number, done));
    } catch (refusal) {
      entry.event = {state: refusal.kind === 'lost' ? 'canceled' : 'failed', message: refusal.message};
    }
    if (entry.state !== 'running') return null;
    const refused = entry.event.result?.[0]?.findings?.length && !entry.event.result[0].proofs ? entry.event.result[0].findings : null;
    const state = refused ? 'failed' : entry.event.state;
    entry.message = refused ? refused.map((one) => `${one.line ? `${one.file}:${one.line}: ` : ''}${one.message}`).join('\n') : entry.event.message;
    if (state === 'done') await read(entry);
    if (entry.state !== 'running') return null;
    entry.state = state;
    if (state === 'canceled') entries.delete(file.name);
    return entry.state === 'done' ? entry : null;
  }

  take(event) { this.waiting.get(event.number)?.(event); this.waiting.delete(event.number); }
  lost() { for (const done of this.waiting.values()) done({state: 'canceled'}); this.waiting.clear(); }

  cancel(entry) {
    if (entry?.state !== 'running') return;
    entry.state = 'canceled';
    this.take({number: entry.number, state: 'canceled'});
    for (const entries of [this.proofs, this.changes, this.runs, this.decisions, this.goals.entries]) if (entries.get(entry.file.name) === entry) entries.delete(entry.file.name);
    if (entry.number !== null) this.studio.link.request('cancel_job', {number: entry.number}).catch(() => {});
    this.show();
  }

  // A text has changed, or only that on disk (isSaved): what was found out about it is old, and what is being found out would be.
  edited(name, isSaved = false) {
    const concerns = (entry) => (!isSaved || entry.job === 'compare') && (entry.files?.has(name) || (entry.state === 'running' && entry.number === null));  // or it is not known yet
    for (const entries of [this.proofs, this.changes, this.runs, this.decisions]) {
      for (const entry of [...entries.values()]) {
        if (!concerns(entry)) continue;
        if (entry.state === 'running') this.cancel(entry); else entry.state = 'old';
      }
    }
    if (this.player.owner && concerns(this.player.owner)) { this.player.end(); this.studio.told('What was played is about an older text; run it again to play it', 'warning'); }
    this.show();
  }

  // The place in views of each node of a run of a tree; of a machine without tree.
  async placesOf(file, tree) {
    if (file.language !== 'xml' && !tree) return {of: (path) => [file.name, path], all: null};
    const owner = file.view.trees?.some((one) => one.id === tree) ? file.name : this.studio.treeFiles[tree] ?? file.name;
    const nodes = await this.studio.link.request('run_nodes', {file: owner, tree}).catch(() => ({}));
    return {of: (path) => nodes[path], all: nodes};
  }

  async play(title, entry, tree, steps, last = []) {
    if (entry.state !== 'done') return;
    const places = await this.placesOf(entry.file, tree);
    const moments = steps.map((one, at) => ({title: one.step, time: null, lines: at === steps.length - 1 ? [...one.lines, ...last] : one.lines, statuses: () => statusesAt(Object.entries(one.statuses), places.of)}));
    if (entry.state === 'done') this.player.play(title, moments, {owner: entry});
  }

  // Proofs.

  saved(file) {
    this.edited(file.name, true);
    if (this.isOnSave && (file.language !== 'python' || this.studio.runsCode)) this.prove(file, true);
  }

  // The requirements of a file, one a line.
  required(file) {
    const text = file === this.studio.file ? byId('requirements').value : remembered(`require-${this.studio.pathOf(file)}`, '');
    return text.split('\n').map((line) => line.trim()).filter(Boolean);
  }

  async prove(file = this.studio.file, isQuiet = false) {
    if (!file) return;
    if (!isQuiet) this.open('prove-job');
    const require = this.required(file);
    const read = async (entry) => {
      const [{proofs, findings}] = entry.event.result, places = await Promise.all(proofs.map((one) => this.placesOf(file, treeOf(one))));
      // One sub-tree may be used by several trees: never reached is what none of them reaches.
      const reached = new Set(proofs.flatMap((one, at) => Object.entries(places[at].all ?? {}).filter(([run]) => !one.never.includes(run)).map(([, place]) => placeOf(...place))));
      const never = proofs.flatMap((one, at) => one.never.map((run) => { const [state, outcome] = run.split(' > '); return outcome ? [file.name, outcomePath(state, outcome)] : places[at].of(run); })).filter(Boolean).map((place) => placeOf(...place));
      entry.never = new Set(never.filter((place) => !reached.has(place)));
      entry.wrong = proofs.flatMap((proof) => proof.wrong.map((one) => ({...one, proof}))).map((one, at) => ({...one, fix: findings[at]?.fix ?? ''}));
      entry.covered = proofs.reduce((sum, one) => sum + one.covered, 0);
      entry.coverable = proofs.reduce((sum, one) => sum + one.coverable, 0);
      entry.cut = proofs.find((one) => !one.complete)?.stopped_by;
      entry.notes = proofs.flatMap((one) => one.notes).filter((one) => !one.includes('--anew'));
    };
    const entry = await this.start(this.proofs, 'prove', file, {require}, read);
    if (entry) this.studio.told(`${file.name}: ${this.verdict(entry)[0]}`, this.verdict(entry)[1]);
    this.studio.graph.on.drawn();
    this.show();
  }

  verdict(entry) {
    if (!entry) return ['not proved', ''];
    if (entry.state === 'running') return ['proving…', ''];
    if (entry.state === 'old') return ['not proved since the change', ''];
    if (entry.state === 'failed') return ['cannot be proved', 'warning'];
    if (entry.wrong.length) return [`not proven: ${entry.wrong.length} wrong`, 'error'];
    return entry.cut !== undefined ? ['nothing wrong as far as it was followed', 'warning'] : [`proved: nothing wrong (${entry.covered} of ${entry.coverable} reached)`, 'good'];
  }

  async choose(entry, one) {
    if (one.steps.length > 1) { await this.play(one.text, entry, treeOf(one.proof), one.steps, [`✗ ${one.text}`]); return; }
    const place = (await this.placesOf(entry.file, treeOf(one.proof))).of(one.where);
    if (place) await this.studio.go(place[0], () => place[1]);
  }

  showProof(file, entry) {
    const [text, tone] = this.verdict(entry), isDone = entry?.state === 'done', isOld = entry?.state === 'old';
    byId('proof').textContent = entry ? text : 'Prove';
    byId('proof').className = `badge ${tone}`;
    byId('proof').disabled = !file;
    byId('proof-cancel').hidden = entry?.state !== 'running';
    byId('prove-job-state').textContent = text;
    byId('proof-told').textContent = !entry ? 'A proof tries everything that can happen: any result of each leaf, at any time.' : entry.state === 'failed' ? entry.message
      : isDone ? [`${entry.covered} of ${entry.coverable} reached${entry.never.size ? `; never: ${entry.never.size}` : ''}`, entry.cut ? `stopped by ${entry.cut}` : '', ...entry.notes].filter(Boolean).join('. ') : isOld ? 'Of the text before the change:' : '';
    const key = [file?.name, entry?.number, entry?.state].join();
    if (this.listed === key) return;  // the focus may be there
    this.listed = key;
    byId('proof-list').replaceChildren(...(entry?.wrong ?? []).map((one) => html('li', {}, html('button', {type: 'button', class: 'error', disabled: isOld, onclick: () => this.choose(entry, one)}, `✗ ${one.text}${one.steps.length > 1 ? ` – play ${counted(one.steps.length - 1, 'step')}` : ''}`), html('span', {class: 'hint'}, one.text.includes(one.fix) ? '' : one.fix))));
  }

  // What a change does.

  async compare(file = this.studio.file, isQuiet = false) {
    if (!file) return;
    if (!isQuiet) this.open('compare-job');
    await this.start(this.changes, 'compare', file, {});
    this.show();
  }

  // What is known about the change of a file, for a sheet or the panel. played() is called before a way is played.
  difference(file, played = () => {}) {
    const entry = this.changes.get(file.name), told = (text, tone = null) => html('p', {class: tone}, text);
    if (!entry || entry.state === 'old') return [told(entry ? 'The text, or that on disk, has changed since the comparison.' : 'Not compared yet.', 'hint')];
    if (entry.state === 'running') return [told('comparing with what is on disk…'), html('button', {type: 'button', onclick: () => this.cancel(entry)}, 'Cancel')];
    if (entry.state === 'failed') return [told(`cannot be compared: ${entry.message}`, 'warning')];
    return entry.event.result[0].comparisons.flatMap((one) => [
      told(one.only ? `${one.name}: it is there only ${one.only === 'now' ? 'now' : 'on disk'}` : one.differences.length ? `${one.name}: ${counted(one.differences.length + one.more, 'difference')}` : `${one.name}: behaves the same${one.complete ? '' : ' as far as it was followed'}`, one.only || one.differences.length ? 'warning' : 'good'),
      ...one.differences.map((other) => html('div', {class: 'way-told'}, html('button', {type: 'button', onclick: () => { played(); this.play(`${one.name}: a difference`, entry, treeOf(one), other.steps, [`✗ on disk: ${other.before.join('; ')}`]); }}, `Play ${counted(other.steps.length - 1, 'step')}`),
        html('dl', {}, html('dt', {}, 'on disk'), html('dd', {}, other.before.join('; ')), html('dt', {}, 'now'), html('dd', {}, other.now.join('; '))))),
    ]);
  }

  // The same for the sheet that shows what a save writes, compared at once if need be.
  sheetPart(file, close) {
    const entry = this.changes.get(file.name), place = html('div', {id: 'sheet-change'});
    this.sheet = () => place.replaceChildren(html('h3', {}, 'What this change does'), ...this.difference(file, close));
    if ((!entry || entry.state === 'old') && (file.language !== 'python' || this.studio.runsCode)) this.compare(file, true);
    this.sheet();
    return place;
  }

  // Dry runs.

  plan() { return planText(this.rows, byId('board').value); }

  async dryRun() {
    const {file} = this.studio;
    if (file?.language !== 'xml') { this.studio.told('A dry run is of a tree', 'warning'); return; }
    this.open('run-job');
    const tree = byId('run-tree').value || file.view.main || file.view.trees[0]?.id;
    const board = byId('board').value, plan = planText(await this.loadRows(file, tree), board);
    const read = (entry) => {
      entry.events = entry.event.result.filter((one) => one.event === 'transition');
      entry.end = entry.event.result.find((one) => one.event === 'result');
      entry.lines = [...entry.events.map(lineOf), `${entry.end.result} after ${entry.end.time.toFixed(3)} s and ${counted(entry.end.ticks, 'tick')}`, ...(entry.end.reason ? [`  reason: ${entry.end.reason}`] : []), ...entry.end.reasons.slice(1).map((one) => `  so ${one}`)];
    };
    const entry = await this.start(this.runs, 'run', file, {tree, plan}, read);
    if (entry) {
      this.cover(entry.event.nodes, entry.events.filter((one) => !['IDLE', 'SKIPPED'].includes(one.after)).map((one) => one.path));
      this.player.play(`Dry run of ${tree}`, this.momentsOf(entry), {owner: entry});
    }
    this.show();
  }

  // A moment for each change, and one for the end. A result stays until a node above begins again.
  momentsOf({events, end, event, lines}) {
    const frames = [], every = 64, now = new Map();
    const change = (map, one) => {
      const place = event.nodes[one.path];
      if (!place || (one.after === 'IDLE' && one.before !== 'RUNNING')) return;
      const key = placeOf(...place);
      if (one.after === 'RUNNING') for (const other of [...map.keys()]) if (other.startsWith(`${key}/`)) map.delete(other);
      map.delete(key);
      map.set(key, one.after);
    };
    events.forEach((one, at) => { if (at % every === 0) frames.push(new Map(now)); change(now, one); });
    const moments = events.map((one, at) => ({title: `${one.path}: ${one.before} → ${one.after}`, lines: [], time: one.time, statuses: () => { const map = new Map(frames[Math.floor(at / every)]); for (let next = at - at % every; next <= at; next += 1) change(map, events[next]); return map; }}));
    const board = Object.entries(end.blackboard).flatMap(([path, entries]) => Object.entries(entries).map(([key, value]) => `${path ? `${path}: ` : ''}${key} = ${JSON.stringify(value)}`));
    return [...moments, {title: lines[events.length], lines: [...lines.slice(events.length + 1), ...board], time: end.time, statuses: () => new Map(now)}];
  }

  // Note a run or recording of a tree with these nodes, their places by path, in which these paths were reached.
  cover(nodes, paths) {
    const files = new Set(Object.values(nodes).map(([file]) => file));
    for (const name of files) {
      const open = this.studio.open.get(name), known = (open ? this.covered(open) : this.coverage.get(name)) ?? {all: new Set(), reached: new Set(), runs: 0};
      known.runs += 1;
      this.coverage.set(name, known);
    }
    for (const place of Object.values(nodes)) this.coverage.get(place[0]).all.add(placeOf(...place));
    for (const path of paths) if (nodes[path]) this.coverage.get(nodes[path][0]).reached.add(placeOf(...nodes[path]));
  }

  // What is known to have been reached in a file, as long as it has the same nodes.
  covered(file) {
    const known = this.coverage.get(file?.name), shape = (file?.view.nodes ?? []).map((one) => `${one.path} ${one.type}`).join('\n');
    return !known || (known.shape ??= shape) === shape ? known : undefined;
  }

  rowsKey(file, tree) { return `${file.name} ${file.viewVersion} ${tree}`; }

  // The rows of a tree, which are asked for once, and shown unless others are wanted by then.
  loadRows(file, tree) {
    const key = this.rowsKey(file, tree);
    if (this.rowsOf !== key) Object.assign(this, {rowsOf: key, asked: this.askRows(file, tree, key)});
    return this.asked;
  }

  async askRows(file, tree, key) {
    const kept = remembered(`mocks-${this.studio.pathOf(file)}`, {});
    const needs = await this.studio.link.request('mocks', {file: file.name, tree}).catch(() => []);
    const rows = needs.map((one) => ({...one, does: one.passes ? 'passes' : 'succeeds', n: 2, after: 0, ...(DOES[kept[one.run]?.does] ? kept[one.run] : {})})).map((one) => (one.instant || one.passes ? {...one, after: 0} : one));
    if (this.rowsOf !== key) return rows;
    this.rows = rows;
    const set = (row, part, value) => { row[part] = value; remember(`mocks-${this.studio.pathOf(file)}`, Object.fromEntries(this.rows.map(({run, does, n, after}) => [run, {does, n, after}]))); };
    byId('mocks').replaceChildren(...this.rows.map((row) => {
      const number = html('input', {type: 'number', min: '1', max: '99', value: row.n, 'aria-label': `${row.run}: N`, hidden: !['recovers', 'nth'].includes(row.does), onchange: (event) => set(row, 'n', Math.max(1, Math.min(99, Math.round(Number(event.target.value)) || 1)))});
      const seconds = html('input', {type: 'number', min: '0', step: 'any', value: row.after, 'aria-label': `${row.run}: seconds`, title: 'how long it runs, s', hidden: row.instant || row.passes, onchange: (event) => set(row, 'after', Math.max(0, Number(event.target.value) || 0))});
      const choices = Object.keys(DOES).filter((one) => (row.passes ? true : one !== 'passes') && !(row.instant && one === 'hangs'));
      const does = html('select', {'aria-label': `what ${row.run} does`, onchange: (event) => { set(row, 'does', event.target.value); number.hidden = !['recovers', 'nth'].includes(row.does); }}, ...choices.map((one) => html('option', {value: one, selected: one === row.does}, DOES[one][0])));
      return html('div', {class: 'mock'}, html('button', {type: 'button', title: row.run, onclick: () => this.studio.go(row.file, () => row.path)}, row.name || row.type), does, number, html('span', {}, seconds, row.instant || row.passes ? '' : ' s'));
    }));
    if (!needs.length) byId('mocks').replaceChildren(html('p', {class: 'hint'}, file.problem ? 'The text cannot be read; mend it first.' : 'No leaf of this tree needs a robot; what it does is real.'));
    return rows;
  }

  showRun(file, entry) {
    const ids = file?.language === 'xml' ? file.view.trees.map((one) => one.id).filter(Boolean) : [], list = byId('run-tree'), {value} = list;
    if ([...list.options].map((one) => one.value).join() !== ids.join()) list.replaceChildren(...ids.map((id) => html('option', {value: id}, id)));
    list.value = ids.includes(value) && this.treesOf === file?.name ? value : file?.view?.main || ids[0] || '';
    this.treesOf = file?.name;
    list.hidden = ids.length < 2;
    byId('run').disabled = !ids.length;
    if (byId('run-job').open && ids.length) this.loadRows(file, list.value);
    if (!ids.length) { this.rowsOf = null; byId('mocks').replaceChildren(html('p', {class: 'hint'}, 'Open a file with a tree.')); }
    const known = this.covered(file);
    byId('run-told').textContent = [entry?.state === 'running' ? 'running…' : entry?.state === 'failed' ? entry.message : entry?.state === 'old' ? 'The text has changed since the last run.' : '', known ? `${counted(known.runs, 'run')} reached ${known.reached.size} of ${known.all.size} nodes` : ''].filter(Boolean).join(' ');
    byId('run-job-state').textContent = entry?.state === 'done' ? entry.end.result : entry?.state === 'running' ? 'running…' : '';
    this.showLines(entry?.state === 'done' ? entry : null, this.player.owner === entry ? this.player.at : 0);
  }

  showLines(entry, at) {
    if (entry && !entry.events) return;
    const from = Math.max(0, at - SHOWN), lines = entry?.lines.slice(from, at + SHOWN) ?? [];
    byId('run-lines').replaceChildren(...lines.map((line, row) => html('li', {'aria-current': from + row === at && this.player.owner === entry ? 'true' : null, onclick: () => { const to = Math.min(from + row, entry.events.length); if (this.player.owner === entry) this.player.go(to); else this.player.play('Dry run', this.momentsOf(entry), {owner: entry, at: to}); }}, line)));
    const list = byId('run-lines'), row = list.querySelector('[aria-current]');
    if (row) list.scrollTop = row.offsetTop - list.offsetTop - list.clientHeight / 2;
  }

  // What is tinted as never reached: by proofs, or, where that is wanted, by the runs and recordings of this session.
  tint(file) {
    const proof = this.proofs.get(file.name), known = this.covered(file);
    return new Set([...(this.tintsNever && proof?.state === 'done' ? proof.never : []), ...(this.tintsDry && known ? [...known.all].filter((place) => !known.reached.has(place)) : [])]);
  }

  show() {
    const {file} = this.studio;
    if (this.shown !== file?.name) {
      this.shown = file?.name;
      for (const [id, name] of [['requirements', 'require'], ['board', 'board']]) byId(id).value = file ? remembered(`${name}-${this.studio.pathOf(file)}`, '') : '';
    }
    this.showProof(file, this.proofs.get(file?.name));
    byId('compare').disabled = byId('prove').disabled = !file;
    const change = this.changes.get(file?.name), key = [file?.name, change?.number, change?.state].join();
    if (this.compared !== key) byId('compare-told').replaceChildren(...(file ? this.difference(file) : []));
    this.compared = key;
    byId('compare-job-state').textContent = change?.state === 'done' ? (change.event.result[0].comparisons.some((one) => one.only || one.differences.length) ? 'differs' : 'the same') : change?.state === 'running' ? 'comparing…' : '';
    this.showRun(file, this.runs.get(file?.name));
    this.goals.show();
    if (byId('sheet-change')?.isConnected) this.sheet?.();
  }
}

const treeOf = ({name}) => (name.startsWith('tree ') ? name.slice(5) : '');
