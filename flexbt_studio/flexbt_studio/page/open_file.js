// SPDX-License-Identifier: BSD-3-Clause
// An open file. Its text is edited here at once; edits are sent to the server one after the other, each for the version that
// it was made in. An edit that came second is mapped over that of another page and sent again, so that both remain.

import {apply, compose, difference, fromEdits, inverse, mapOffset, toEdits, transform} from './changes.js';

const LONGEST_WAIT_MS = 1500;  // for the edit of another page that caused a conflict; then the whole text is asked for

export class OpenFile {
  // model is the server's answer to open; buffer holds the text and its history. on.changed(file, isRemote) is called after each
  // change of the text, on.viewed(file) after a new graph, on.found(file) after new findings, on.told(text, tone).
  constructor(link, model, buffer, on) {
    Object.assign(this, {link, buffer, on, name: model.file, language: model.language, gestures: model.gestures});
    this.folded = null;       // paths of folded nodes; null until the first graph
    this.anchor = 0;          // where the selected node or state begins in the text
    this.selected = null;     // its path
    this.findings = [];
    this.queue = Promise.resolve();
    this.watches = new Set();
    this.waiting = [];
    this.syncing = [];
    this.sinceView = [];      // what has changed since the graph
    buffer.onchange = (change, isRemote) => this.edited(change, isRemote);
    this.begin(model);
    this.saved = model.changed ? null : model.text;  // the text on disk, if it is known
    this.takeModel(model);
  }

  begin(model) {
    this.version = model.version;
    this.base = model.text;     // the server's text
    this.sent = null;           // the change that has been sent for it
    this.pending = null;        // the change after that one
    this.others = new Map();    // edits of other pages by version
    this.viewVersion = this.foundIn = 0;
    this.begun = {};            // answers to what was sent before are of no interest
    this.restored = null;       // for a new server: its text when all that it had lost is back, and the edits after that
    this.isRefused = this.sentIsMapped = false;
  }

  get text() { return this.buffer.text; }
  get isSettled() { return !this.isRecovering && !this.sent && !this.pending && this.viewVersion === this.version; }
  // Whether the findings are of the text as it is now.
  get isChecked() { return !this.sent && !this.pending && this.foundIn === this.version; }
  // Whether the text differs from that on disk; while that is not known, as the server says.
  get isChanged() { return this.saved === null ? this.changed : this.text !== this.saved; }

  edited(change, isRemote) {
    if (!isRemote) {
      this.pending = this.pending ? compose(this.pending, change) : change;
      if (this.restored) this.restored.unsent = compose(this.restored.unsent, change);
      queueMicrotask(() => this.send());
    }
    this.anchor = mapOffset(change, this.anchor);
    this.sinceView = compose(this.sinceView, change);
    for (const watch of this.watches) watch.change = compose(watch.change, change);
    this.on.changed(this, isRemote);
  }

  async send() {
    if (this.sent || !this.pending || !this.link.isOpen || this.isRecovering) return;
    this.sent = this.pending;
    this.pending = null;
    this.key = `${Math.random()}`;
    const {version, begun, key} = this;
    try {
      await this.link.request('edit', {file: this.name, version, edits: toEdits(this.sent), key});
      if (this.begun !== begun) return;
      this.restored = null;
      this.arrived();
      this.takeOthers();
      this.send();
      this.settle();
    } catch (refusal) {
      if (refusal.kind === 'lost' || this.begun !== begun) return;  // recover() goes on from here
      if (refusal.kind === 'conflict' && this.restored) { this.leaveToOther(); return; }
      if (refusal.kind === 'busy') {
        setTimeout(() => { if (this.begun === begun) { this.isRefused = this.sentIsMapped = true; this.sendAgain(); } }, LONGEST_WAIT_MS);
        return;
      }
      if (refusal.kind === 'conflict') {
        if (this.version === version) setTimeout(() => { if (this.version === version && this.sent) this.recover(); }, LONGEST_WAIT_MS);
        this.isRefused = true;
        this.sendAgain();
        return;
      }
      this.on.told(refusal.message, 'error');  // the text here is not that of the server any more: take it back
      const lost = this.pending ? compose(this.sent, this.pending) : this.sent;
      this.sent = this.pending = null;
      this.buffer.apply(inverse(this.base, lost), {isRemote: true});
    }
  }

  // An edit that was refused is sent again, after a conflict when that of the other page is known.
  sendAgain() {
    if (!this.isRefused || !this.sentIsMapped) return;
    this.isRefused = this.sentIsMapped = false;
    this.pending = this.pending ? compose(this.sent, this.pending) : this.sent;
    this.sent = null;
    this.send();
  }

  // The edit that was sent has made the next version.
  arrived() {
    this.base = apply(this.base, this.sent);
    this.version += 1;
    this.sent = null;
  }

  // key is what the page that has made an edit calls it.
  takeEdited(version, edits, key) {
    if (this.restored) { this.leaveToOther(); return; }
    this.others.set(version, [fromEdits(edits), key]);
    this.takeOthers();
  }

  takeOthers() {
    for (let next; (next = this.others.get(this.version + 1)); ) {
      this.others.delete(this.version + 1);
      let [change, key] = next;
      if (this.sent && key === this.key) { this.arrived(); continue; }  // its answer was lost with the connection
      this.version += 1;
      this.base = apply(this.base, change);
      if (this.sent) this.sentIsMapped = true;  // it was for an older version, so it is refused
      for (const part of ['sent', 'pending']) if (this[part]) [change, this[part]] = transform(change, this[part]);
      this.buffer.apply(change, {isRemote: true});
    }
    for (const version of this.others.keys()) if (version <= this.version) this.others.delete(version);
    this.sendAgain();
    this.settle();
  }

  // After a lost connection or an edit that is missing: take the edits since then, or else compare with the server's text. What only
  // this page has is sent again.
  // instance identifies the server: a new one has what is on disk, and nothing of what was not saved there.
  async recover(instance = this.instance) {
    const isNewServer = instance !== this.instance;
    this.isRecovering = true;
    try {
      const open = () => this.link.request('open', {file: this.name, version: this.version});
      const model = await (isNewServer && this.isChanged ? open().catch(() => this.createAgain()).catch(open) : open()), unsent = this.pending ?? [];
      let remote, local;
      if (isNewServer && model.version === 1) {  // it has read the file again: what is not saved is only in the pages
        const isOld = this.saved === null || this.saved === model.text;
        const restored = difference(isOld ? model.text : this.saved, this.base);
        const [onDisk, restore] = isOld ? [[], restored] : transform(difference(this.saved, model.text), restored);
        [remote, local] = transform(onDisk, compose(this.sent ?? [], unsent));
        this.begin(model);
        this.saved = model.text;
        if (restore.length || local.length) this.restored = {base: apply(model.text, restore), unsent: local};
        local = compose(restore, local);
      } else if (!isNewServer && !this.restored && model.since) {
        for (const [version, edits, key] of model.since) this.others.set(version, [fromEdits(edits), key]);
        this.takeOthers();
        this.pending = this.sent && this.pending ? compose(this.sent, this.pending) : this.sent ?? this.pending;
        Object.assign(this, {sent: null, begun: {}, isRefused: false, sentIsMapped: false});
        [remote, local] = [[], this.pending ?? []];
      } else {
        // An edit whose answer was lost has arrived if the server's text is nearer to that with it.
        const without = difference(this.base, model.text), withSent = this.sent && difference(apply(this.base, this.sent), model.text);
        [remote, local] = withSent && size(withSent) < size(without) ? transform(withSent, unsent) : transform(without, compose(this.sent ?? [], unsent));
        this.begin(model);
      }
      this.pending = local.length ? local : null;
      if (remote.length) this.buffer.apply(remote, {isRemote: true});
      this.instance = instance;
      this.takeModel(model);
    } catch (refusal) {
      if (refusal.kind !== 'lost') this.on.told(`${this.name}: ${refusal.message}`, 'error');
      return;
    } finally {
      this.isRecovering = false;
    }
    this.send();
    this.settle();
  }

  // A changed file that is not on disk is begun anew, and gets all that this page has of it.
  async createAgain() {
    const model = await this.link.request('create', {file: this.name, text: ''});
    this.saved = null;
    return model;
  }

  // Another page has brought the text back to a new server: what it has brought is the same text, and no edit of another one.
  leaveToOther() {
    Object.assign(this, {base: this.restored.base, version: 0, sent: null, pending: this.restored.unsent, restored: null, begun: {}});
    this.recover();
  }

  takeModel(model) {
    this.changed = model.changed;
    if (model.version !== this.version || (model.version === this.viewVersion && this.view)) return;
    this.viewVersion = model.version;
    this.sinceBefore = this.sinceView;  // since the graph before
    const since = [this.sent, this.pending].filter(Boolean).reduce(compose, []);
    const problem = model.problems[0];
    this.problem = problem ?? null;
    // While the text is not readable, the last graph that was remains, with the places that it had.
    if (!problem || !this.view || this.wasUnreadable) {
      this.view = model.view;
      this.sinceView = since;
      this.wasUnreadable = Boolean(problem);
    }
    this.on.viewed(this);
    this.settle();
  }

  // Another page has saved a version. If there is a newer one, the server tells whether that differs.
  takeSaved(version) { Object.assign(this, {saved: version === this.version ? this.base : null, changed: true}); }

  takeFindings(version, findings) {
    if (version !== this.version || this.sent || this.pending) return;  // those of the newest text follow
    this.findings = findings;
    this.foundIn = version;
    this.on.found(this);
  }

  settle() {
    if (!this.sent && !this.pending) for (const one of this.syncing.splice(0)) one();
    if (!this.isSettled) return;
    for (const one of this.waiting.splice(0)) one();
  }

  // Edit the text. edits count in it as it is now.
  apply(edits, name, isChange = false) { this.buffer.apply(isChange ? edits : fromEdits(edits), {name}); }

  // Wait until the server has the text of this page.
  async synced() { while ((this.sent || this.pending) && this.link.isOpen) await new Promise((done) => { this.syncing.push(done); setTimeout(done, LONGEST_WAIT_MS); }); }

  // Wait until the server has the text of this page, and this page its graph.
  async settled() {
    while (!this.isSettled) {
      if (!this.sent && !this.pending && !this.isRecovering) {
        this.takeModel(await this.link.request('model', {file: this.name}));
        if (this.isSettled) return;
      }
      if (!this.link.isOpen) await this.link.request('model', {file: this.name});  // refused, with the reason
      await new Promise((done) => { this.waiting.push(done); setTimeout(done, LONGEST_WAIT_MS); });
    }
  }

  // Carry out a gesture. make() is called when the graph is up to date, and returns [name, arguments] or null. Gestures are
  // carried out one after the other. The result is the change of the text, or null.
  gesture(make) {
    this.queue = this.queue.then(async () => {
      await this.settled();
      const wanted = make();
      if (!wanted) return null;
      const [name, args] = wanted;
      const change = await this.watching(async (watch) => watch.over(fromEdits(await this.link.request('gesture', {file: this.name, version: this.version, name, arguments: args}))));
      if (change.length) this.buffer.apply(change, {name});
      await this.settled();
      return change;
    }).catch((refusal) => { this.on.told(refusal.message, 'error'); return null; });
    return this.queue;
  }

  // Do work(watch), and resolve to its result. watch.change is what has changed meanwhile, watch.over(change) a change of the text as
  // it was before, for the text as it is then.
  async watching(work) {
    const watch = {change: [], over: (change) => transform(watch.change, change)[1]};
    this.watches.add(watch);
    try { return await work(watch); } finally { this.watches.delete(watch); }
  }

  // Let make(text) resolve to another text, or to null, and put that in the place of this one; what is edited meanwhile stays.
  // Resolves to that text.
  rewrite(name, make) {
    return this.watching(async (watch) => {
      const before = this.text, after = await make(before);
      if (after !== null && after !== before) this.apply(watch.over(difference(before, after)), name, true);
      return after;
    });
  }

  // Offsets of the graph in the text as it is now.
  now([start, end]) { return [mapOffset(this.sinceView, start), mapOffset(this.sinceView, end, true)]; }
}

const size = (change) => toEdits(change).reduce((sum, [start, end, text]) => sum + end - start + text.length, 0);
