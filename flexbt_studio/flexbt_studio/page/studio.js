// SPDX-License-Identifier: BSD-3-Clause
// The studio: files, panes, selection, problems, saving, and the commands that keys, buttons and the command list share.

import {Actions} from './actions.js';
import {mapOffset} from './changes.js';
import {choose} from './choice.js';
import {Debugger} from './debugger.js';
import {byId, html, pressedOnce, replace} from './elements.js';
import {Flow} from './flow.js';
import {Form} from './form.js';
import {Graph} from './graph.js';
import {counted, Jobs} from './jobs.js';
import {Live} from './live.js';
import {drawMachine, outcomePath} from './machine_drawing.js';
import {Names} from './names.js';
import {OpenFile} from './open_file.js';
import {Palette} from './palette.js';
import {panels} from './panels.js';
import {plainPane} from './plain_text.js';
import {Player} from './player.js';
import {Recordings} from './recordings.js';
import {remember, remembered} from './server_link.js';
import {Refusal, SessionLink} from './session_link.js';
import {codeSheet, conflictSheet, keySheet, sheet, shownKeys, unifiedDifference} from './sheets.js';
import {Simulator} from './simulator.js';
import {drawTrees} from './tree_drawing.js';

const PANES = ['files-pane', 'palette-pane', 'graph-pane', 'text-pane', 'form-pane', 'problems-pane', 'runs-pane'];
const KEY = /\{(@?[A-Za-z_][\w./-]*)\}/g;

const lowered = (one) => Object.assign(one, {kind: one.kind?.toLowerCase() ?? ''});

class Studio {
  constructor(pane) {
    this.pane = pane;
    this.open = new Map();
    this.file = null;
    this.files = [];
    this.types = new Map();
    this.states = [];
    this.treeFiles = {};
    this.back = [];
    this.clipboard = '';
    this.picks = 0;  // how often somebody has selected something
    this.letters = remembered('letters', true);
    this.actions = new Actions(this);
    this.graph = new Graph({
      select: (path) => this.select(path), fold: (path) => this.fold(path), open: (path) => this.enter(path), problem: (path, isFolded) => this.problemAt(path, isFolded),
      drop: (from, to, zone, what) => this.actions.drop(from, to, zone, what), zones: (from, to, what, end = null) => (this.file ? this.actions.zones(from, to, end) : []),
      drawn: () => { if (this.file) { this.player.paint(this.graph, this.file.name, this.jobs.tint(this.file)); this.debugger.paint(this.graph, this.file.name); } },
    });
    this.player = new Player({follow: (file, path) => this.follow(file, path), paint: () => this.graph.on.drawn(), name: (file, path) => this.open.get(file)?.parts.get(path)?.title ?? path});
    this.jobs = new Jobs(this, this.player);
    this.live = new Live(this, this.player);
    this.debugger = new Debugger(this, this.live);
    this.simulator = new Simulator(this);
    this.recordings = new Recordings(this);
    this.form = new Form({
      gesture: (part, name, args) => this.actions.change(part, name, args), now: (part) => this.now(part), can: (name) => this.file.gestures.includes(name), isPython: () => this.file.language === 'python', act: (id) => this.run(id), typeOf: (data) => this.typeOf(data), keys: () => this.keys(),
      trees: () => Object.keys(this.treeFiles), rename: (part, name) => this.actions.renameTo(part, name), target: (path, outcome) => this.actions.target(path, outcome), leave: () => this.graph.focus(),
    });
    this.palette = new Palette({add: (entry) => this.actions.add('after', entry).then(() => this.graph.focus()), drag: (event, entry) => this.graph.drag(event, null, entry)});
    this.names = new Names(this);
    this.flow = new Flow({file: () => this.file, link: {request: (...words) => this.link.request(...words)}, graph: this.graph, select: (path) => this.select(path), rename: (key) => this.names.rename({offset: this.file.now(key.span)[0]}), uses: (key) => this.names.uses({offset: this.file.now(key.span)[0]})});
    this.commands = this.makeCommands();
    this.link = new SessionLink({event: (event) => this.take(event), state: (isOpen, text) => this.connected(isOpen, text)});
    this.listen();
  }

  told(text, tone = '') {
    const line = byId('told');
    line.textContent = '';
    line.className = tone;
    line.textContent = text;
  }

  // Put a text on the clipboard. Browsers give none to a page without HTTPS; then the text is shown.
  async copyText(text, told) {
    if (await navigator.clipboard?.writeText(text).then(() => true, () => false)) this.told(told);
    else await sheet('The browser lets this page copy nothing: copy it here', [html('pre', {tabindex: '0'}, text)], [['Close', null, 'primary']]);
  }

  // The server.

  connected(isOpen, text) {
    if (!isOpen) { this.jobs.lost(); this.live.lost(text); }
    byId('link').textContent = isOpen ? 'CONNECTED' : 'NO SERVER';
    byId('link').className = `badge ${isOpen ? 'good' : 'error'}`;
    byId('alarm').textContent = isOpen ? '' : `Not connected: ${text}. You can go on writing in the text; it is sent when the studio is back.`;
  }

  async take(event) {
    const file = this.open.get(event.file);
    if (event.event === 'welcome') await this.welcome(event);
    else if (event.event === 'model' && file) { file.takeModel(event); this.showHead(); }
    else if (event.event === 'findings' && file) file.takeFindings(event.version, event.findings);
    else if (event.event === 'edited' && file) { file.takeEdited(event.version, event.edits, event.key); this.told(`${event.file} was edited in another page`); }
    else if (event.event === 'edited' || (event.event === 'disk' && !file)) this.jobs.edited(event.file);
    else if (event.event === 'files_changed') this.filesChanged(event, file);
    else if (event.event === 'disk' && file) this.diskChanged(file);
    else if (event.event === 'pages') byId('pages').textContent = event.count > 1 ? `${event.count} pages open` : '';
    else if (event.event === 'job') this.jobs.take(event);
    else if (event.event === 'live') { this.live.take(event); this.debugger.taken(event); }
    else if (event.event === 'simulator') this.simulator.take(event);
    else if (event.event === 'note') this.told(event.message, 'warning');
  }

  async welcome({page, instance, robots, folder}) {
    if (this.folder && folder !== this.folder) {
      this.link.close();
      byId('alarm').textContent = `Another project, ${folder}, is at this address now. What was not saved is still in this page: copy what you need, then load the page again.`;
      return;
    }
    this.live.welcome(robots, Boolean(this.instance) && instance !== this.instance);
    this.simulator.welcome();
    Object.assign(this, {page, instance});
    const recovered = Promise.all([...this.open.values()].map((file) => file.recover(instance)));  // at once: until then nothing of them is sent
    try {
      const hello = await this.link.request('hello');
      byId('project').textContent = hello.project;
      this.folder = hello.folder;
      if (this.runsCode = sessionStorage.getItem(`studio-code-${hello.folder}`) !== null) await this.link.request('allow_code');
      document.title = `${hello.project} – FlexBT Studio`;
      this.types = new Map(hello.node_types.map((one) => [one.id, lowered(one)]));
      this.states = hello.states.map((one) => ({...one, outcomes: one.outcomes.map((outcome) => outcome.name), keyNames: [...one.inputs, ...one.outputs].map((key) => key.name)}));
      this.showFiles(hello.files);
      await recovered;
      this.palette.show(this.entries());
      if (hello.notes.length) this.told(hello.notes[0], 'warning');
      if (!this.open.size) await this.openLink();
    } catch (refusal) {
      if (refusal.kind !== 'lost') throw refusal;
    }
  }

  async filesChanged({file: name, what, by, saved, version}, file) {
    if (by !== this.page && ['save', 'take_disk'].includes(what)) this.jobs.edited(name, true);
    if (file && by !== this.page) {
      if (what === 'take_disk') { file.saved = saved; this.showHead(); }
      if (what === 'close') { file.instance = null; file.recover(this.instance); }  // with its unsaved edits, as by a new server
      if (what === 'save') { file.takeSaved(version); this.showHead(); this.told(`${file.name} was saved in another page`); }
    }
    if (!name) this.learnTrees(true);
    try { this.showFiles(await this.link.request('files')); } catch { /* it comes with the next welcome */ }
  }

  // Another program has written a file. Take its text, or tell it if there are changes here.
  async diskChanged(file) {
    this.jobs.edited(file.name, true);
    file.isOld = file.isChanged;
    this.showHead();
    if (file.isOld) { this.told(`${file.name} was changed on disk by another program`, 'warning'); return; }
    const text = await file.rewrite('disk', async () => {
      const taken = await this.link.request('take_disk', {file: file.name});
      if (taken !== null) file.saved = taken;
      return taken;
    });
    if (text !== null) this.told(`${file.name} was changed on disk; this is its text now, and Undo takes it back`);
  }

  // Files.

  showFiles(files) {
    this.files = files;
    const wanted = byId('files-filter').value.toLowerCase(), shown = files.filter((one) => one.file.toLowerCase().includes(wanted));
    replace(byId('files'), ...shown.map((one) => html('li', {'aria-current': one.file === this.file?.name ? 'true' : null}, html('button', {type: 'button', title: one.file, onclick: () => this.go(one.file)}, this.open.get(one.file)?.isChanged ?? one.changed ? '● ' : '', html('span', {class: 'folder dim'}, one.file.slice(0, one.file.lastIndexOf('/') + 1)), html('span', {}, ...one.file.split('/').at(-1).split(/(?<=_)/).flatMap((part) => [html('wbr'), part]))), html('span', {class: 'hint'}, one.kind))));
    byId('files-count').textContent = shown.length === files.length ? `${files.length}` : `${shown.length} of ${files.length}`;
    if (!files.length) byId('files').append(html('li', {class: 'empty'}, 'No trees or machines are in this folder yet. Make one with New.'));
  }

  // Open a file if need be, show it, and select what find(view) returns, a path.
  async go(name, find = null, {isJump = false} = {}) {
    const file = this.open.get(name) ?? await this.asked('open', name);
    if (isJump) this.back.push([this.file.name, this.file.selected]);
    this.show(file);
    const path = find?.(file.view) ?? null;
    if (path) this.select(path);
    return file;
  }

  added(model) {
    const before = this.open.get(model.file);
    if (before) return before;  // it was asked for twice
    const buffer = this.pane.buffer(model.text, model.file, model.language);
    const file = new OpenFile(this.link, model, buffer, {
      changed: (one, isRemote) => { this.jobs.edited(one.name); if (!isRemote && !this.isStepping) this.names.edited(one); if (one === this.file) this.showHead(); }, viewed: (one) => this.viewed(one), found: (one) => this.found(one), told: (text, tone) => this.told(text, tone),
    });
    file.instance = this.instance;
    this.open.set(model.file, file);
    return file;
  }

  // A file as the server answers, to be shown; refused if another one was asked for or shown since.
  async asked(method, name, more = {}) {
    this.wanted = name;
    const file = this.added(await this.link.request(method, {file: name, ...more}));
    if (this.wanted !== name) throw new Refusal({kind: 'refused', message: `${name} is open now; another file was shown or asked for since`});
    return file;
  }

  async create(name, text) {
    this.show(await this.asked('create', name, {text}));
    this.file.saved = '';
    this.showHead();
  }

  show(file) {
    this.wanted = file.name;
    if (this.file !== file) {
      if (byId('runs').contains(document.activeElement)) document.activeElement.blur();  // what is typed there is of the file before
      this.file = file;
      this.pane.show(file.buffer);
      this.pane.mark(file.buffer, file.findings);
      byId('text-hint').textContent = this.pane.isPlain ? 'plain: studio --get-editor installs CodeMirror' : file.language;
      this.palette.show(this.entries());
      this.showFiles(this.files);
      const list = byId('files'), row = list.querySelector('[aria-current]');
      if (row) list.scrollTop += row.getBoundingClientRect().top - list.getBoundingClientRect().top - (list.clientHeight - row.offsetHeight) / 2;
      this.viewed(file);
      this.found(file);
    }
    if (this.graph.items.length) this.graph.focus(); else document.activeElement?.blur();  // the picture gets the focus when it is there
  }

  async close(name) {
    const file = this.open.get(name);
    if (!this.link.isOpen && (file.sent || file.pending)) { this.told(`${name} has edits that the studio has not got yet; close it when it is connected again`, 'warning'); return; }
    if (this.open.size === 1 && this.simulator.state.state !== 'ended') { this.told(`The simulated robot would end with ${name}, the last open file; stop it first, or open another file`, 'warning'); return; }
    if (file.isChanged && await sheet(`${name} has unsaved changes`, [html('p', {}, 'If you close it, this page forgets it; the studio keeps the changes until they are saved or discarded.')], [['Close', true, 'primary'], ['Cancel', null, '']]) === null) return;
    this.open.delete(name);
    this.link.request('leave', {file: name}).catch(() => {});  // a new connection has only what is opened on it
    if (file !== this.file) { this.showHead(); return; }
    this.file = null;
    const [next] = [...this.open.values()].slice(-1);
    if (next) this.show(next); else location.replace(this.address(null));
    if (!next) location.reload();
  }

  // The graph.

  viewed(file) {
    this.live.viewed();
    this.learnTrees();
    for (const node of file.view.nodes ?? []) lowered(node);
    this.outline(file);
    if (file.folded === null) {
      const saved = remembered(`folded-${this.pathOf(file)}`, null);
      file.folded = new Set(saved ?? (file.view.nodes ?? []).filter((node) => node.collapsed).map((node) => node.path));
    }
    // The selection stays at what begins where the selected part began, wherever that is in the graph now.
    const at = file.anchor, begins = (part) => part && mapOffset(file.sinceView, part.span[0]) === at;
    const kept = file.parts.get(file.selected);
    if (!begins(kept) || !kept) {
      const found = [...file.parts.values()].find(begins);
      if (found && kept?.kind !== 'outcome') file.selected = found.path;
      else if (!kept) file.selected = (this.innermost(file, at) ?? file.parts.values().next().value)?.path ?? null;
    }
    if (file !== this.file) return;
    this.draw();
    this.flow.update();
  }

  // The trees of the project and what else can be added: asked for when a file is shown, when an open file has others, and when
  // another program may have made others (isAgain).
  async learnTrees(isAgain = false) {
    const {file} = this, own = ({view: {trees = [], models = [], states = []}}) => [...[...trees, ...models].map((one) => one.id), ...states.map((one) => one.type)];
    const known = [file?.name, ...[...this.open.values()].flatMap(own)].join('\n');
    if (!file || (known === this.learnt && !isAgain)) return;
    this.learnt = known;
    this.treeFiles = await this.link.request('trees', {file: file.name}).catch(() => { this.learnt = null; return this.treeFiles; });
    this.palette.show(this.entries());
  }

  // What the graph has, by path: {file, path, kind, title, span, open, data, parent, children}.
  outline(file) {
    const {view} = file, parts = new Map();
    const put = (part, parent) => {
      Object.assign(part, {file, parent, children: []});
      parent?.children.push(part);
      parts.set(part.path, part);
    };
    for (const tree of view.trees ?? []) put({path: tree.path, kind: 'tree', title: tree.id || 'tree', span: tree.span, open: tree.id_span, data: tree, note: tree.note}, null);
    for (const node of view.nodes ?? []) put({path: node.path, kind: 'node', title: node.name || node.type, span: node.span, open: node.open, data: node, note: node.note}, parts.get(node.parent ?? node.tree));
    for (const state of view.states ?? []) {
      const part = {path: state.path, kind: 'state', title: state.label || view.behavior?.name || 'machine', span: state.span, open: state.label_span, data: state, note: state.comments.join('\n'), locked: state.locked};
      put(part, parts.get(state.parent) ?? null);
      for (const way of state.transitions) put({path: outcomePath(state.path, way.outcome), kind: 'outcome', title: way.outcome, span: way.span, open: way.span, data: state, way, note: ''}, part);
    }
    // What begins with the letter with which something of its kind began is the same: what was asked for that, or typed, is for this.
    const key = (part, since) => [part.kind, mapOffset(since, part.span[0] + 1, true) - 1, part.kind === 'outcome' ? part.title : ''].join();
    const begins = new Map([...parts.values()].map((one) => [key(one, file.sinceView), one]));
    for (const one of file.parts?.values() ?? []) one.later = begins.get(key(one, file.sinceBefore)) ?? null;
    file.parts = parts;
  }

  // What a part of an earlier graph of a file has become; null if it is gone, or its file is closed.
  now(part) {
    let one = part;
    while (one?.later) one = one.later;
    return one && this.open.get(one.file.name)?.parts.get(one.path) === one ? one : null;
  }

  part(path) { return this.file?.parts.get(path) ?? null; }

  async draw() {
    const {file} = this;
    byId('unreadable').hidden = !file.problem;
    byId('unreadable').textContent = file.problem ? `Text not readable at ${file.problem.line}:${file.problem.column}: ${file.problem.message}` : '';
    this.graph.picture.classList.toggle('stale', Boolean(file.problem));
    this.graph.selected = file.selected;
    if (this.drawn !== file) this.graph.draw({items: [], parts: [], box: {x: 0, y: 0, width: 1, height: 1}});  // keys and clicks are for what is seen
    this.drawn = file;
    if (file.language === 'xml') this.graph.draw(drawTrees(file.view, file.folded));
    else {
      const number = this.drawing = (this.drawing ?? 0) + 1;
      try {
        const layout = await this.link.request('layout', {file: file.name, folded: [...file.folded]});
        if (number !== this.drawing || file !== this.file) return;
        this.graph.draw(drawMachine(file.view, layout, file.folded));
        if (document.activeElement === document.body) this.graph.focus();
      } catch (refusal) {
        if (refusal.kind !== 'lost') this.told(refusal.message, 'warning');
      }
    }
    byId('graph-empty').hidden = file.parts.size > 0;
    byId('graph-empty').textContent = 'This file has no tree or machine that can be shown. Write one in the text.';
    this.showSelection();
    this.showHead();
  }

  // Select a part. Its text is shown, and the focus goes to it in the graph.
  select(path, {isMoved = false, isFromText = false} = {}) {
    const {file} = this, part = this.part(path);
    if (!part) return;
    if (!isMoved) this.picks += 1;
    const isNew = file.selected !== path;
    file.selected = path;
    file.anchor = mapOffset(file.sinceView, part.span[0]);
    let isHidden = false;
    for (let one = part.parent; one; one = one.parent) isHidden = file.folded.delete(one.path) || isHidden;
    if (isHidden) { this.rememberFolded(); this.draw(); } else this.graph.mark(path);
    if (!isFromText) {
      this.graph.focus();
      if (isNew || isMoved) this.revealText(part.open);
    }
    this.showSelection();
  }

  revealText(span) { this.pane.select(...this.file.now(span)); }

  showSelection() {
    const {file} = this, part = this.part(file.selected);
    const shown = part && {...part, part, behavior: file.view.behavior, problems: file.findings.filter((one) => one.path === part.path && one.severity !== 'info').map((one) => one.message)};
    this.form.show(shown, file.name + this.keys().join() + Object.keys(this.treeFiles).join());
    const crumbs = [];
    for (let one = part; one; one = one.parent) crumbs.unshift(one);
    byId('crumbs').replaceChildren(...[[file.name.split('/').at(-1), file.parts.keys().next().value], ...crumbs.map((one) => [one.title, one.path])].map(([text, path]) => html('button', {type: 'button', onclick: () => this.select(path)}, text)));
    for (const way of this.graph.picture.querySelectorAll('.way')) way.classList.toggle('lit', [way.dataset.way, way.dataset.from].includes(file.selected));
    this.flow.refresh();
    history.replaceState(null, '', this.address(file));
  }

  address(file) {
    const words = new URLSearchParams(location.hash.slice(1));
    for (const [key, value] of [['file', file?.name], ['node', file?.selected]]) if (value) words.set(key, value); else words.delete(key);
    return `#${words}`;
  }

  async openLink() {
    const words = new URLSearchParams(location.hash.slice(1)), file = words.get('file'), node = words.get('node');
    if (!file) { if (document.activeElement === document.body) byId('files-filter').focus(); return; }
    const opened = await this.go(file, () => node);
    if (node && !opened.parts.has(node)) this.told(`${file} has no ${node} now; it was renamed, moved or removed`, 'warning');
  }

  fold(path) {
    const {file} = this, part = this.part(path);
    if (!part?.children.length || part.kind === 'outcome' || (part.kind === 'state' && ['state', 'behavior'].includes(part.data.kind))) return;
    if (!file.folded.delete(path)) file.folded.add(path);
    this.rememberFolded();
    for (let one = this.part(file.selected)?.parent; one; one = one.parent) if (one.path === path) { file.selected = path; file.anchor = mapOffset(file.sinceView, one.span[0]); }
    this.draw();
    this.told(`${part.title} ${file.folded.has(path) ? 'folded' : 'unfolded'}`);
  }

  rememberFolded() { remember(`folded-${this.pathOf(this.file)}`, [...this.file.folded]); }
  // What the browser remembers of a file is of this project.
  pathOf(file) { return `${this.folder}/${file.name}`; }

  // Bring a node that runs into view, in another file, too; of a robot only in this one.
  async follow(name, path) {
    if (name !== this.file?.name && !this.player.isLive) {
      const before = document.activeElement;
      await this.go(name);
      before?.focus();
    }
    if (name !== this.file?.name) return;
    let item = null;
    for (let part = this.part(path); part && !item; part = part.parent) item = this.graph.byPath.get(part.path);
    if (item) this.graph.bring(item);
  }

  // Enter or a double click: the target of an outcome, or the properties.
  enter(path) {
    const part = this.part(path);
    if (part?.kind === 'outcome') this.actions.target(part.data.path, part.way.outcome);
    else this.form.focus();
  }

  keys() { return [...new Set([...(this.file?.text.matchAll(KEY) ?? [])].map((match) => match[1]))].sort(); }
  typeOf(data) { return this.file.language === 'xml' ? this.types.get(data.type) ?? this.modelOf(data.type) : this.states.find((one) => one.id === data.type); }
  modelOf(id) { const found = this.file.view.models.find((one) => one.id === id); return found && {...found, kind: found.kind.toLowerCase(), ports: found.ports}; }

  // What can be added to this file.
  entries(language = this.file?.language ?? 'xml') {
    if (language === 'xml') {
      const own = (this.file?.view.models ?? []).filter((one) => !this.types.has(one.id)).map((one) => ({...one, kind: one.kind.toLowerCase(), package: 'this file'}));
      const types = [...this.types.values(), ...own].filter((one) => one.kind !== 'subtree').map((one) => ({...one, label: one.id, detail: one.summary || one.kind, help: one.documentation}));
      return [...types, ...Object.entries(this.treeFiles).map(([id, file]) => ({label: id, kind: 'subtree', package: 'this project', detail: `sub-tree, ${file}`}))];
    }
    const used = new Map();
    for (const file of this.open.values()) for (const state of file.view.states ?? []) if (state.kind === 'state' && state.type) used.set(state.type, {label: state.type, kind: 'state', package: 'used in open files', detail: 'state', outcomes: state.transitions.map((way) => way.outcome), parameters: state.parameters.map((one) => ({name: one.name}))});
    for (const one of this.states) used.set(one.id, {...one, label: one.id, kind: 'state', detail: one.summary});
    const containers = ['machine', 'concurrency', 'priority'].map((kind) => ({label: kind, kind: 'container', package: 'flexbt_core', detail: 'a state with states inside', stateKind: kind, outcomes: ['done']}));
    return [...used.values(), ...containers];
  }

  // Problems.

  found(file) {
    if (file !== this.file) return;
    this.pane.mark(file.buffer, file.findings);
    this.graph.marks();
    if (this.flow.isShown) this.flow.show();
    this.showSelection();
    const list = file.findings, errors = list.filter((one) => one.severity === 'error').length, others = list.length - errors;
    byId('problems-count').textContent = [errors && counted(errors, 'error'), others && counted(others, 'note')].filter(Boolean).join(', ') || 'none';
    replace(byId('problems'), ...list.map((one) => html('li', {}, html('button', {type: 'button', class: {error: 'error', warning: 'warning'}[one.severity] ?? 'dim', onclick: () => this.goProblem(one)}, `${one.message}${one.line ? ` (${one.line}:${one.column})` : ''}`), ...one.fixes.map((fix) => html('button', {type: 'button', class: 'fix', onclick: () => this.fix(one, fix)}, fix.title)), ...(one.rule === 'not-run' ? [html('button', {type: 'button', class: 'fix', id: 'allow-code', onclick: () => this.allowCode()}, 'Run Its Code…')] : []))));
    if (!list.length) byId('problems').append(html('li', {class: 'empty'}, 'No problems found.'));
  }

  problemAt(path, isFolded) {
    const hit = (one) => one.path === path || (isFolded && one.path.startsWith(`${path}/`));
    return (this.file?.findings ?? []).filter((one) => one.severity !== 'info' && one.path && hit(one)).map((one) => one.message).join('; ');
  }

  goProblem(one) {
    const {file} = this;
    file.problemAt = file.findings.indexOf(one);
    if (one.path && this.part(one.path)) this.select(one.path);
    this.pane.select(...one.span);
    this.told(`Problem ${file.problemAt + 1} of ${file.findings.length}: ${one.message}${one.fixes.length ? '. Alt+Enter fixes it' : ''}`, one.severity === 'error' ? 'error' : 'warning');
  }

  nextProblem(step) {
    const {file} = this;
    if (!file?.findings.length) { this.told('No problems found'); return; }
    const count = file.findings.length;
    this.goProblem(file.findings[(((file.problemAt ?? (step > 0 ? -1 : count)) + step) % count + count) % count]);
  }

  async fixNow() {
    const {file} = this;
    const near = file.findings.filter((one) => one.fixes.length && (this.pane.hasFocus() ? one.span[0] <= this.pane.offset() && this.pane.offset() <= one.span[1] : one.path === file.selected));
    const last = file.findings[file.problemAt];
    const all = (near.length ? near : last?.fixes.length ? [last] : []).flatMap((one) => one.fixes.map((fix) => ({label: fix.title, one, fix})));
    const chosen = all.length > 1 ? await choose('Fix', all) : all[0];
    if (chosen) this.fix(chosen.one, chosen.fix); else this.told('There is no fix for a problem here', 'warning');
  }

  fix(one, fix) {
    const {file} = this;
    if (!file.findings.includes(one) || !file.isChecked) { this.told('The text has changed since; the problem is checked again', 'warning'); return; }
    file.apply(fix.edits, 'fix');
    this.told(fix.title);
  }

  // Ask whether the code of behaviors may be run: once for each project and browser session. Resolves to whether it may.
  async allowCode() {
    if (this.runsCode || await codeSheet(this.folder) === null) return Boolean(this.runsCode);
    this.runsCode = true;
    sessionStorage.setItem(`studio-code-${this.folder}`, 'yes');
    await this.link.request('allow_code').catch(() => {});  // when it is connected again, it is told
    return true;
  }

  // Saving.

  showHead() {
    const {file} = this, isChanged = Boolean(file?.isChanged);
    this.jobs.show();
    byId('save').disabled = !isChanged;
    byId('on-disk').hidden = !file?.isOld;
    byId('difference').disabled = !isChanged;
    byId('difference').textContent = isChanged ? 'Unsaved changes' : 'No changes';
    byId('difference').classList.toggle('changed', isChanged);
    replace(byId('tabs'), ...[...this.open.values()].map((one) => html('span', {class: 'tab'},
      html('button', {type: 'button', 'aria-current': one === file ? 'page' : null, title: one.name, onclick: () => this.show(one)}, `${one.isChanged ? '● ' : ''}${one.name.split('/').at(-1)}`),
      html('button', {type: 'button', 'aria-label': `Close ${one.name}`, onclick: () => this.close(one.name)}, '×'))));
    byId('tabs').querySelector('[aria-current]')?.scrollIntoView({block: 'nearest', inline: 'nearest'});
  }

  async showDifference() {
    const {file} = this;
    if (!file) return;
    await file.settled();
    const lines = await this.link.request('difference', {file: file.name});
    const isSaving = await sheet(`${file.name}: what Save writes`, lines.length ? [unifiedDifference(lines), this.jobs.sheetPart(file, () => byId('sheet-buttons').lastElementChild.click())] : [html('p', {}, 'The text is as it is on disk.')], lines.length ? [['Save', true, 'primary'], ['Close', null, '']] : [['Close', null, 'primary']]);
    if (isSaving) await this.save('', file);
  }

  async save(over = '', file = this.file) {
    if (!file) return;
    let version;
    try {
      await file.settled();
      const {text} = file;
      ({version} = file);
      await this.link.request('save', {file: file.name, version, over});
      file.saved = text;
      file.changed = file.isOld = false;
      this.showHead();
      this.told(`${file.name} saved`, 'good');
      this.jobs.saved(file);
    } catch (refusal) {
      if (refusal.kind !== 'conflict') this.told(refusal.message, 'error');
      else if ((await this.link.request('model', {file: file.name})).version !== version) await this.save(over, file);  // another page has edited it just now
      else await this.resolve(file);
    }
  }

  async resolve(file) {
    const {text, disk} = await this.link.request('on_disk', {file: file.name});
    if (text === file.text) { await this.save(disk, file); return; }
    const merged = await file.rewrite('merge', async (mine) => (await conflictSheet(file.name, mine, text, this.pane.merge))?.text ?? null);
    if (merged === null) { this.told(`${file.name} is not saved: it was changed on disk`, 'warning'); return; }
    await this.save(disk, file);
  }

  // Commands.

  makeCommands() {
    const at = this.actions, ofFile = (run) => () => (this.file ? run() : this.told('Open a file first', 'warning')), inGraph = (id, title, keys, run) => ({id, title, keys, run, where: 'graph'}), page = (id, title, keys, run) => ({id, title, keys, run, where: 'page'});
    return [
      inGraph('add_after', 'Add after', ['a'], () => at.add('after')), inGraph('add_child', 'Add child', ['A'], () => at.add('into')),
      inGraph('properties', 'Properties, or target of an outcome', ['Enter'], () => this.enter(this.file.selected)), inGraph('rename', 'Rename', ['F2'], () => at.rename()),
      inGraph('move_up', 'Move before its sibling', ['Alt+ArrowUp'], () => at.move(-1)), inGraph('move_down', 'Move after its sibling', ['Alt+ArrowDown'], () => at.move(1)),
      inGraph('move_out', 'Move out of its parent; at a tree: back', ['Alt+ArrowLeft'], () => (this.isAtTree() ? this.goBack() : at.move('out'))), inGraph('move_into', 'Move into the sibling before it', ['Alt+ArrowRight'], () => at.move('into')),
      inGraph('wrap', 'Wrap in a control or decorator; a state in a machine', ['w'], () => at.wrap()), inGraph('unwrap', 'Unwrap: its children take its place', ['u'], () => at.unwrap()),
      inGraph('set_type', 'Change the type', ['t'], () => at.setType()), inGraph('cut', 'Cut', ['x'], () => at.cut()), inGraph('copy', 'Copy', ['c'], () => at.copy()), inGraph('paste', 'Paste after', ['v'], () => at.paste('after')),
      inGraph('paste_child', 'Paste as child', ['V'], () => at.paste('into')), inGraph('remove', 'Remove', ['Delete', 'Backspace'], () => at.remove()), inGraph('extract', 'Extract into a tree', ['e'], () => at.extract()), inGraph('inline', 'Inline a sub-tree', ['i'], () => at.inline()),
      inGraph('define', 'Go to the definition of a sub-tree', ['F12'], () => at.define()), inGraph('find', 'Find a node or state', ['/'], () => this.find()), inGraph('set_initial', 'Make a state the initial one', null, () => at.setInitial()), inGraph('add_outcome', 'Add an outcome to a container', null, () => at.addOutcome()),
      inGraph('remove_outcome', 'Remove an outcome of a container', null, () => at.removeOutcome()), inGraph('include', 'Include a file of trees', null, () => at.include()),
      inGraph('remove_include', 'No longer include a file', null, () => at.removeListed('remove_include', 'File that is not included any more', 'path', 'includes')), inGraph('remove_model', 'Remove the model of a node type', null, () => at.removeListed('remove_model', 'Model to remove', 'id', 'models')),
      inGraph('fold_all', 'Fold or unfold all', null, () => this.foldAll()), inGraph('flow', 'Data flow: who writes and reads the keys', ['k'], () => this.flow.toggle()),
      page('rename_name', 'Rename what is at the cursor, in all files', ['F2'], ofFile(() => this.names.rename())), page('uses', 'All uses of a name, in all files', ['Shift+F12'], ofFile(() => this.names.uses())),
      page('save', 'Save', ['Ctrl+s'], () => this.save()), page('difference', 'Show what Save writes', ['Ctrl+Shift+S'], () => this.showDifference()), page('undo', 'Undo', ['Ctrl+z'], () => this.undo()), page('redo', 'Redo', ['Ctrl+y', 'Ctrl+Shift+Z'], () => this.redo()),
      page('commands', 'All commands', ['Ctrl+k'], () => this.chooseCommand()), page('open', 'Open a file', ['Ctrl+p'], () => this.chooseFile()), page('new', 'New file', ['Alt+n'], () => at.create()), page('back', 'Back to where F12 was pressed', ['Ctrl+Alt+ArrowLeft'], () => this.goBack()),
      page('next_problem', 'Next problem', ['F8'], () => this.nextProblem(1)), page('previous_problem', 'Previous problem', ['Shift+F8'], () => this.nextProblem(-1)), page('fix', 'Fix the problem here', ['Alt+Enter'], ofFile(() => this.fixNow())),
      page('next_pane', 'Next pane', ['F6'], () => this.nextPane(1)), page('previous_pane', 'Previous pane', ['Shift+F6'], () => this.nextPane(-1)), page('keys', 'Keys of this place', ['?'], () => this.showKeys()),
      ...this.jobs.commands(page), ...this.live.commands(page), ...this.simulator.commands(page), ...this.recordings.commands(page), ...this.debugger.commands(),
      page('letters', 'Single letters as keys in the graph: on or off', null, () => { this.letters = !this.letters; remember('letters', this.letters); this.told(`Single letters ${this.letters ? 'are keys' : 'only find names'} in the graph`); }),
      page('link', 'Copy a link to the selected item', null, () => this.copyText(location.href.replace(/token=[^&]*&?/, ''), 'Link copied, without the token')), page('reset', 'Reset the panels', null, () => this.panels.reset()),
    ];
  }

  run(id) { return this.commands.find((one) => one.id === id).run(); }
  isAtTree() { const part = this.part(this.file?.selected); return this.back.length > 0 && (part?.kind === 'tree' || part?.parent?.kind === 'tree'); }
  goBack() { const last = this.back.pop(); if (last) this.go(last[0], () => last[1]); else this.told('There is nothing to go back to'); }
  undo() { this.step('undo'); }
  redo() { this.step('redo'); }
  step(what) {  // what renamed in several files is taken back in all of them
    const files = this.file ? this.names.together(this.file, what === 'redo') : null;
    this.isStepping = true;
    if (files && !files.map((one) => one.buffer[what]()).some(Boolean)) this.told(`Nothing to ${what}`);
    this.isStepping = false;
  }
  foldAll() { const {file} = this; file.folded = file.folded.size ? new Set() : new Set([...file.parts.values()].filter((one) => one.kind === 'node' && one.children.length && one.parent.kind !== 'tree').map((one) => one.path)); this.rememberFolded(); this.select(file.parts.keys().next().value); this.draw(); }

  async find() {
    const all = [...this.file.parts.values()].filter((one) => one.kind !== 'outcome');
    const chosen = await choose('Find', all.map((one) => ({label: one.title, detail: one.kind === 'node' ? `${one.data.type} ${one.path}` : one.path, words: one.data.attributes?.map((port) => port.value).join(' '), path: one.path})));
    if (chosen) this.select(chosen.path);
  }

  async chooseCommand() {
    const isInGraph = Boolean(this.file);
    const chosen = await choose('Commands', this.commands.filter((one) => (one.where === 'live' ? this.debugger.isOn : isInGraph || one.where === 'page')).map((one) => ({label: one.title, keys: one.keys ? shownKeys(one.keys) : '', run: one.run, detail: ''})));
    chosen?.run();
  }

  async chooseFile() {
    const chosen = await choose('Open a file', this.files.map((one) => ({label: one.file, detail: `${one.kind}${one.changed ? ', unsaved' : ''}`})));
    if (chosen) this.go(chosen.label);
  }

  showKeys() { sheet('Keys', [keySheet(this.commands, this.graph.hasFocus ? 'graph' : 'page'), html('p', {class: 'hint'}, 'Other letters find an item by its name. In a field: Ctrl+Space completes, Esc goes back to the item.')]); }

  nextPane(step) {
    const now = PANES.findIndex((id) => byId(id).contains(document.activeElement));
    for (let count = 1; count <= PANES.length; count += 1) {
      const id = PANES[(now + step * count + PANES.length * 2) % PANES.length];
      const goal = {'graph-pane': () => this.graph.items.length && this.graph.focus(), 'text-pane': () => this.file && this.pane.focus()}[id];
      if (goal) goal(); else byId(id).querySelector('.panel-body :is(input, button, select, textarea, [tabindex="0"])')?.focus();
      if (byId(id).contains(document.activeElement)) { this.told(byId(id).querySelector('h2').textContent); return; }
    }
  }

  listen() {
    // A refusal ends what was asked for, and is told; it is caught only where something else is done then.
    addEventListener('unhandledrejection', (event) => { if (event.reason instanceof Refusal) { event.preventDefault(); this.told(event.reason.message, 'error'); } });
    addEventListener('keydown', (event) => {
      if (document.querySelector('dialog[open]') || event.defaultPrevented) return;
      const inGraph = this.graph.hasFocus, isField = event.target.closest?.('input, textarea, select') || this.pane.hasFocus();
      const key = event.key.length > 1 ? event.key : event.shiftKey ? event.key.toUpperCase() : event.key.toLowerCase();  // whatever caps lock makes of it
      const name = `${event.ctrlKey || event.metaKey ? 'Ctrl+' : ''}${event.altKey ? 'Alt+' : ''}${event.shiftKey && (event.key.length > 1 || event.ctrlKey || event.metaKey) ? 'Shift+' : ''}${key}`;
      const isLetter = event.key.length === 1 && !event.ctrlKey && !event.altKey && !event.metaKey;
      if (isLetter && isField) return;
      if (inGraph && isLetter && (this.graph.isFinding || !this.letters) && /[\p{L}\p{N}_]/u.test(event.key)) { event.preventDefault(); this.graph.find(event.key); return; }
      if (isField && !this.pane.hasFocus() && /^Ctrl\+(Shift\+)?[zyZ]$/.test(name) && event.target.value !== (event.target.dataset.was ?? '')) return;  // in a field: what is typed there
      if (this.pane.hasFocus() && !this.pane.isPlain && /^Ctrl\+(Shift\+)?[zyZ]$/.test(name)) return;  // the editor's own keys, with the same history
      const found = this.commands.find((one) => one.keys?.includes(name) && (one.where === 'page' || (one.where === 'live' ? this.debugger.isOn && (inGraph || !isLetter) : inGraph)));
      if (found) { event.preventDefault(); if (event.repeat && found.where === 'live') return; if (this.file || found.where === 'live' || ['commands', 'open', 'new', 'keys', 'next_pane', 'previous_pane'].includes(found.id)) found.run(); } 
      else if (inGraph && isLetter && /[\p{L}\p{N}_]/u.test(event.key)) { event.preventDefault(); this.graph.find(event.key); }
    });
    for (const [kind, act] of [['copy', () => this.actions.copy()], ['cut', () => this.actions.cut()], ['paste', (event) => this.actions.paste('after', event.clipboardData.getData('text/plain') || this.clipboard)]]) {
      document.addEventListener(kind, (event) => { if (this.graph.hasFocus && this.file) { event.preventDefault(); act(event); } });
    }
    pressedOnce('#held button, #debug button, #simulator button, #choice-list li, #choice-field, #sheet-buttons button', (...words) => this.told(...words));
    document.querySelector('.skip').addEventListener('click', (event) => { event.preventDefault(); this.graph.focus(); });  // the address keeps token and file
    byId('merge').addEventListener('click', () => this.resolve(this.file));
    byId('files-filter').addEventListener('input', () => this.showFiles(this.files));
    byId('files-filter').addEventListener('keydown', (event) => { if (event.key === 'Enter') byId('files').querySelector('button')?.click(); });
    for (const id of ['save', 'undo', 'redo', 'new', 'commands', 'keys', 'difference']) byId(id).addEventListener('click', () => this.run(id));
    byId('flow-button').addEventListener('click', () => { if (this.file) this.flow.toggle(); });
    addEventListener('hashchange', () => this.openLink());
    addEventListener('beforeunload', (event) => { if ([...this.open.values()].some((file) => file.sent || file.pending)) event.preventDefault(); });
  }

  // The cursor in the text selects the innermost part around it.
  cursor(offset) {
    const {file} = this;
    const part = file && !file.problem ? this.innermost(file, offset) : null;
    if (part && part.path !== file.selected) this.select(part.path, {isFromText: true});
  }

  innermost(file, offset) {
    let best = null;
    for (const part of file.parts.values()) {
      const [start, end] = file.now(part.span);
      if (start <= offset && offset <= end && part.kind !== 'outcome') best = part;
    }
    return best;
  }

  async complete(name, offset, isExplicit) {
    const file = this.open.get(name);
    if (!file || file.language === 'python' || (!isExplicit && !/[<\w{"@]/.test(file.text[offset - 1] ?? ''))) return [];
    await file.synced();
    return this.link.request('completions', {file: name, offset}).catch(() => []);
  }
}

let studio = null;
const events = {undo: () => studio.undo(), redo: () => studio.redo(), cursor: (offset) => studio.cursor(offset), complete: (...words) => studio.complete(...words), fix: (one, fix) => studio.fix(one, fix)};
const made = document.querySelector('script[type="importmap"]') ? (await import('./code_text.js')).codePane : plainPane;
const panelsMade = panels(byId('panels'), 'studio', {wide: [['files-pane', 'palette-pane'], ['graph-pane', 'text-pane'], ['form-pane', 'problems-pane', 'runs-pane']], narrow: [['files-pane', 'graph-pane', 'form-pane', 'problems-pane', 'runs-pane', 'text-pane', 'palette-pane']]}, '(max-width: 900px)');
studio = new Studio(made(byId('text'), events));
studio.panels = panelsMade;
