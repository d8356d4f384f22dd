// SPDX-License-Identifier: BSD-3-Clause
// What can be done in the graph, by keys, the list of commands, buttons, and drag: each is one gesture of the server.

import {ask, choose} from './choice.js';
import {outcomePath} from './machine_drawing.js';

const TEMPLATES = {
  Tree: ['new_tree.xml', (name) => `<root BTCPP_format="4" main_tree_to_execute="${name}">\n  <BehaviorTree ID="${name}">\n    <Sequence>\n      <AlwaysSuccess/>\n    </Sequence>\n  </BehaviorTree>\n</root>\n`],
  'State machine': ['new_machine.yaml', (name) => `# What this behavior is for.\nbehavior:\n  name: ${name}\nmachine:\n  outcomes: [finished, failed]\n  states:\n    Wait:\n      state: WaitState\n      parameters: {wait_time: 1.0}\n      transitions: {done: finished}\n`],
};
const escaped = (text) => text.replace(/[&<>"]/g, (letter) => ({'&': '&amp;', '<': '&lt;', '>': '&gt;', '"': '&quot;'})[letter]);

// The XML of a new node: required outputs get the key of their name, required inputs are empty and marked by the checker.
function snippet(entry) {
  if (entry.kind === 'subtree') return `<SubTree ID="${escaped(entry.label)}"/>`;
  const given = (entry.ports ?? []).filter((port) => port.required).map((port) => ` ${port.name}="${port.direction === 'output' ? `{${port.name}}` : ''}"`);
  return `<${entry.label}${given.join('')}/>`;
}

const lastIndex = (path) => Number(path.slice(path.lastIndexOf('/') + 1));
// The path of a node when another one is gone that was there before.
function without(path, gone) {
  const steps = path.split('/'), missing = gone.split('/'), depth = missing.length - 1;
  if (steps.length > depth && missing.slice(0, depth).every((step, index) => steps[index] === step) && Number(steps[depth]) > Number(missing[depth])) steps[depth] = String(Number(steps[depth]) - 1);
  return steps.join('/');
}

export class Actions {
  // studio has file, part(path), select, told, clipboard, entries(), link.
  constructor(studio) {
    this.studio = studio;
  }

  get file() { return this.studio.file; }
  get isTree() { return this.file?.language === 'xml'; }

  // Carry out a gesture, and select what it is about, unless something else was selected meanwhile.
  async run(make, then = () => null, told = '', file = this.file) {
    const {picks} = this.studio, change = await file.gesture(make);
    if (!change) return false;
    const path = file === this.file ? then() : null;
    if (path !== null && picks === this.studio.picks) this.studio.select(path, {isMoved: true});
    if (told) this.studio.told(typeof told === 'function' ? told() : told);
    return true;
  }

  // Carry out a gesture at a part, wherever that is then. make(path, part) and then(path, part) are as in run().
  at(part, make, then = (path) => path, told = '') {
    let now = null;
    return this.run(() => {
      now = this.studio.now(part);
      if (!now) throw new Error(`${part?.title ?? 'it'} has gone since; nothing was changed`);
      return make(now.path, now);
    }, () => then(now.path, now), told, part?.file);
  }

  // A part was moved to a path: what was asked for it meanwhile is for it there.
  moved(part, path) {
    const now = this.studio.part(path);
    if (now !== part) part.later = now;
    return path;
  }

  // A gesture of the form of a part, whose state that of an outcome is.
  change(part, name, args) {
    const at = part.kind === 'outcome' ? part.parent : part;
    return this.at(at, (path) => [name, {...args, ...Object.fromEntries(['node', 'state', 'container'].filter((key) => key in args).map((key) => [key, path]))}], () => null, 'changed');
  }

  now() { return this.studio.part(this.file.selected); }

  // Where something is added: at an item, or the selected one, or the first; null after telling why.
  place(path = null) {
    const part = this.studio.part(path) ?? this.now() ?? this.file.parts.values().next().value ?? null;
    if (!part) this.studio.told('The file has no tree or machine; write one in its text', 'warning');
    return part;
  }

  // Trees.

  // Insert XML at a part. where: after, before or into.
  insert(xml, what, where, at) {
    let place = null;
    return this.at(at, (_, part) => {
      const isInto = where === 'into' || part.kind === 'tree' || part.parent.kind === 'tree';
      place = isInto ? [part.path, part.children.length] : [part.parent.path, lastIndex(part.path) + Number(where === 'after')];
      return ['add_node', {parent: place[0], index: place[1], xml}];
    }, () => `${place[0]}/${place[1]}`, `${what} added`);
  }

  async add(where, entry = null, target = null) {
    const at = this.file && this.place(target);
    if (!at) return;
    const chosen = entry ?? await choose(where === 'into' ? 'Add Child' : 'Add After', this.studio.entries());
    if (!chosen) return;
    if (at.file.language !== 'xml') { await this.addState(where, chosen, at); return; }
    if (await this.insert(snippet(chosen), chosen.label, where, at) && chosen.ports?.some((port) => port.required)) this.studio.told(`${chosen.label} added. Enter opens its properties`);
  }

  // Move the selected node: by -1 or 1 among its siblings, out of its parent, or into the sibling before it.
  move(how) {
    let to = null;
    if (!this.isTree) return this.moveState(how);
    const asked = this.now();
    return this.at(asked, (_, part) => {
      const {parent} = part;
      let target = null;
      if (part.kind !== 'node') throw new Error('a tree cannot be moved; select a node');
      const index = lastIndex(part.path), rows = parent.children;
      if (how === 'out') {
        if (parent.kind === 'tree' || parent.parent.kind === 'tree') throw new Error('the root of a tree has no siblings; wrap it first');
        to = [parent.parent.path, lastIndex(parent.path) + 1];
      } else if (how === 'into') {
        const before = [...rows.slice(0, index).reverse(), ...rows.slice(index + 1)].find((one) => this.hasRoom(one));
        if (!before) throw new Error(`${part.title} has no sibling that can have one more child`);
        target = before.path;
        to = [without(before.path, part.path), lastIndex(before.path) < index ? before.children.length : 0];
      } else {
        if (!rows[index + how]) throw new Error(`${part.title} is the ${how < 0 ? 'first' : 'last'} child already`);
        to = [parent.path, index + how];
      }
      return ['move', {node: part.path, parent: target ?? to[0], index: to[1]}];
    }, (_, part) => this.moved(part, `${to[0]}/${to[1]}`), () => { const part = this.studio.now(asked); return `${part.title}: ${lastIndex(part.path) + 1} of ${part.parent.children.length} in ${part.parent.title}`; });
  }

  // Move a node to a place beside or in another one, or copy what is dragged from the palette there.
  drop(from, to, zone, entry) {
    if (from === null) { this.add(zone, entry, to); return; }
    const dragged = this.studio.part(from), over = this.studio.part(to);
    if (!this.isTree) { const outcome = dragged.title, target = zone === 'end' ? entry : over.data.label; this.at(dragged.parent, (state) => ['set_target', {state, outcome, target}], (state) => outcomePath(state, outcome), `${outcome} leads to ${target}`); return; }
    let place = null;
    this.at(dragged, (_, part) => {
      const target = this.studio.now(over);
      if (!target) throw new Error(`${over.title} has gone since; nothing was changed`);
      const isInto = zone === 'into' || target.kind === 'tree';
      const parent = isInto ? target : target.parent, others = parent.children.filter((one) => one !== part);
      const index = isInto ? others.length : others.indexOf(target) + Number(zone === 'after');
      place = [without(parent.path, part.path), index];
      return ['move', {node: part.path, parent: parent.path, index}];
    }, (_, part) => this.moved(part, `${place[0]}/${place[1]}`), 'moved');
  }

  // Where an item may be dropped. end is an outcome of the container to.
  zones(from, to, end = null) {
    const target = this.studio.part(to), part = from === null ? null : this.studio.part(from);
    if (!target || from === to) return [];
    if (end !== null) return part?.kind === 'outcome' && part.data.parent === to ? ['end'] : [];
    if (!this.isTree) {
      if (from === null) return ['into'];
      return part?.kind === 'outcome' && target.kind === 'state' && target.data.parent === part.data.parent ? ['into'] : [];
    }
    if (part && (part.kind !== 'node' || to.startsWith(`${from}/`))) return [];
    return [...(target.kind === 'node' && target.parent.kind !== 'tree' && this.hasRoom(target.parent, part) ? ['before', 'after'] : []), ...(this.hasRoom(target, part) ? ['into'] : [])];
  }

  // Whether a node can have one more child, or the one that it has among others.
  hasRoom(target, part = null) {
    const most = target.kind === 'tree' ? 1 : target.data.kind === 'subtree' ? 0 : this.studio.typeOf(target.data)?.children?.[1] ?? Infinity;
    return target.children.filter((one) => one !== part).length < most;
  }

  async wrap() {
    const part = this.now();
    if (!this.isTree) { await this.group(part); return; }
    if (part?.kind !== 'node') { this.studio.told('Select a node to wrap it', 'warning'); return; }
    const chosen = await choose(`Wrap ${part.title} in`, this.studio.entries().filter((one) => ['control', 'decorator'].includes(one.kind)));
    if (!chosen) return;
    const values = Object.fromEntries((chosen.ports ?? []).filter((port) => port.required).map((port) => [port.name, '']));
    await this.at(part, (node) => ['wrap', {node, xml_type: chosen.label, values}], undefined, `${part.title} wrapped in ${chosen.label}`);
  }

  unwrap() {
    const part = this.now();
    if (!this.isTree) return this.at(part, (state) => ['ungroup', {state}], () => this.studio.now(part.parent)?.path ?? null, `${part.title}: its states took its place`);
    return this.at(part, (node) => ['unwrap', {node}], undefined, `${part?.title}: its children took its place`);
  }

  async setType() {
    const part = this.now();
    if (!this.isTree || part?.kind !== 'node') return;
    const chosen = await choose(`Change ${part.data.type} to`, this.studio.entries());
    if (!chosen) return;
    const keep = chosen.ports && chosen.kind !== 'subtree' ? chosen.ports.map((port) => port.name) : null;
    const form = chosen.kind === 'subtree' ? 'SubTree' : part.data.tag === 'SubTree' ? '' : null;
    await this.at(part, (node) => ['set_type', {node, type: chosen.label, keep, form}], undefined, `changed to ${chosen.label}`);
  }

  async remove(part = this.now()) {
    if (!part) return;
    if (part.file.language !== 'xml') { await this.removeState(part); return; }
    if (part.kind === 'tree') {
      if (part.file.view.trees.length < 2) { this.studio.told('The only tree of a file cannot be removed', 'warning'); return; }
      await this.run(() => ['remove_tree', {id: part.data.id}], () => this.file.view.trees[0].path, `tree ${part.data.id} removed`, part.file);
      return;
    }
    await this.at(part, (node) => ['remove', {node}], (path) => {
      const parent = this.studio.part(path.slice(0, path.lastIndexOf('/')));
      return (parent.children[lastIndex(path)] ?? parent.children.at(-1) ?? parent).path;
    }, `${part.title} removed`);
  }

  async rename() {
    const part = this.now();
    if (!part) return;
    if (part.kind === 'node' && part.data.kind !== 'subtree' && !part.data.name) {
      const name = await ask(`Name of ${part.title}`, '', 'The name of this node in logs, in requirements and in the graph.');
      if (name) await this.at(part, (node) => ['set_value', {node, name: 'name', value: name}], undefined, `renamed to ${name}`);
    } else if (part.kind === 'tree' && !part.data.id) {
      const name = await ask('ID of the tree', '');
      if (name) await this.at(part, (id) => ['rename_tree', {id, new: name}], () => name, `named ${name}`);
    } else await this.renameTo(part, null);
  }

  // Give a tree, a node or a state another name in all files, and select it again. Resolves as Names.rename().
  async renameTo(asked, name) {
    const part = this.studio.now(asked);
    if (!part) { this.studio.told(`${asked.title} has gone since; nothing was renamed`, 'warning'); return false; }
    const {file} = part, at = part.span[0], {picks} = this.studio;
    const isDone = name !== '' && await this.studio.names.rename({file, offset: this.studio.names.placeOf(part), name});
    if (!isDone) return isDone;
    await file.settled();
    const same = [...file.parts.values()].find((one) => one.span[0] === at && one.kind === part.kind);
    if (same && file === this.file && picks === this.studio.picks) this.studio.select(same.path, {isMoved: true});
    return true;
  }

  async extract() {
    const part = this.now();
    if (!this.isTree || part?.kind !== 'node') return;
    const id = await ask(`Make a tree of ${part.title}`, '', 'ID of the new tree. A sub-tree takes the place of the node.');
    if (id) await this.at(part, (node) => ['extract', {node, id}], undefined, `extracted into the tree ${id}`);
  }

  inline() { return this.at(this.now(), (node) => ['inline', {node}], undefined, 'the sub-tree is in its place now'); }

  // Go to the tree that a sub-tree runs, also in another file.
  async define() {
    const part = this.now(), {file} = this;
    if (part?.kind !== 'node' || part.data.kind !== 'subtree') {
      if (part) this.studio.revealText(part.span);
      return;
    }
    const own = file.view.trees.find((one) => one.id === part.data.type);
    const owner = own ? file.name : (await this.studio.link.request('trees', {file: file.name}))[part.data.type];
    if (!owner) { this.studio.told(`No tree [${part.data.type}] is in this project`, 'warning'); return; }
    await this.studio.go(owner, (view) => view.trees.find((one) => one.id === part.data.type)?.path, {isJump: true});
    this.studio.told(`Tree ${part.data.type}; Alt+Left goes back`);
  }

  // The clipboard has text.

  copy() { return this.copying = this.copied(); }

  async copied() {
    const part = this.now();
    if (!part || part.kind === 'tree' || part.kind === 'outcome') { this.studio.told('Select a node or a state to copy it', 'warning'); return ''; }
    try {
      await part.file.settled();
      const now = this.studio.now(part);
      if (!now) throw new Error(`${part.title} has gone since; nothing was copied`);
      const text = await this.studio.link.request('clip', {file: now.file.name, part: now.path});
      this.studio.clipboard = text;
      navigator.clipboard?.writeText(text).catch(() => {});  // not allowed: it is pasted within the studio only
      this.studio.told(`${part.title} copied as text`);
      return text;
    } catch (refusal) {
      this.studio.told(refusal.message, 'error');
      return '';
    }
  }

  async cut() {
    const part = this.now();
    if (await this.copy()) await this.remove(part);
  }

  async paste(where, text = null) {
    const at = this.place();
    if (!at) return;
    await this.copying;  // what was copied just before
    const xml = text ?? (await navigator.clipboard?.readText().catch(() => '') || this.studio.clipboard);
    if (!xml?.trim()) { this.studio.told('The clipboard is empty: c copies a node', 'warning'); return; }
    if (at.file.language === 'xml') await this.insert(xml, 'clipboard', where, at);
    else await this.pasteState(where, xml, at);
  }

  // Machines.

  async addState(where, entry, at) {
    const part = this.studio.now(at) ?? at, state = part.kind === 'outcome' ? part.parent : part;
    const isContainer = !['state', 'behavior'].includes(state.data.kind), parent = isContainer && (where === 'into' || state.data.parent === null) ? state : state.parent;
    const taken = new Set(parent.children.filter((one) => one.kind === 'state').map((one) => one.data.label));
    let usual = entry.label.replace(/State$/, ''), count = 2;
    while (taken.has(usual)) { usual = entry.label.replace(/State$/, '') + count; count += 1; }
    const label = await ask(`Label of the new ${entry.label}`, usual);
    if (!label) return;
    const end = parent.data.outcomes.at(-1) ?? '';
    const transitions = Object.fromEntries((entry.outcomes ?? []).map((outcome) => [outcome, parent.data.outcomes.includes(outcome) ? outcome : end]));
    const parameters = Object.fromEntries((entry.parameters ?? []).filter((one) => one.required).map((one) => [one.name, '']));
    await this.at(parent, (path) => ['add_state', {parent: path, label, type: entry.stateType ?? entry.label, parameters, transitions, kind: entry.stateKind ?? 'state'}], (path) => `${path.replace(/\/$/, '')}/${label}`, `${label} added`);
  }

  // Add a state of a text to a container, or to that of a state.
  pasteState(where, text, at) {
    let parent = null;
    return this.at(at, (_, part) => {
      const state = part.kind === 'outcome' ? part.parent : part;
      const isContainer = !['state', 'behavior'].includes(state.data.kind);
      parent = isContainer && (where === 'into' || !state.parent || state.children.every((one) => one.kind !== 'state')) ? state.path : state.parent.path;
      return ['paste_state', {parent, text}];
    }, () => this.studio.part(parent).children.filter((one) => one.kind === 'state').at(-1).path, 'pasted');
  }

  moveState(how) {
    if (this.now()?.kind !== 'state' || typeof how !== 'number') return Promise.resolve(false);
    return this.at(this.now(), (state, part) => {
      const rows = part.parent?.children.filter((one) => one.kind === 'state') ?? [], index = rows.indexOf(part) + how;
      return rows[index] ? ['move_state', {state, index}] : null;
    }, (path, part) => this.moved(part, path), 'moved');
  }

  async removeState(part) {
    if (part.kind === 'outcome') { await this.at(part.parent, (state) => ['set_target', {state, outcome: part.way.outcome, target: null}], undefined, `transition ${part.way.outcome} removed`); return; }
    const pointing = part.parent?.children.some((one) => one.kind === 'state' && one !== part && one.data.transitions.some((way) => way.target === part.data.label));
    const instead = pointing ? await choose(`Transitions lead to ${part.title}. Where do they lead instead?`, this.targets(part)) : null;
    if (!pointing || instead) await this.at(part, (state) => ['remove_state', {state, instead: instead?.label ?? null}], () => this.studio.now(part.parent)?.path ?? null, `${part.title} removed`);
  }

  async group(part) {
    if (part?.kind !== 'state' || !part.parent) { this.studio.told('Select a state to put it into a machine of its own', 'warning'); return; }
    const label = await ask(`Put ${part.title} into a machine`, '', 'Label of the new machine, which takes the place of the state.');
    if (label) await this.at(part, (path) => ['group', {states: [path], label}], (path) => `${path.slice(0, path.lastIndexOf('/'))}/${label}`, `${part.title} is in ${label} now`);
  }

  setInitial() { const part = this.now(); return this.at(part, (state) => ['set_initial', {state}], undefined, `${part.title} is the initial state`); }

  targets(part) {
    return [
      ...part.parent.children.filter((one) => one.kind === 'state' && one !== part).map((one) => ({label: one.data.label, detail: one.data.type || one.data.kind})),
      ...part.parent.data.outcomes.map((label) => ({label, detail: `outcome of ${part.parent.title}`})),
    ];
  }

  // Choose where an outcome of a state leads.
  async target(path, outcome) {
    const part = this.studio.part(path);
    const entry = this.studio.typeOf(part.data), open = (entry?.outcomes ?? part.data.outcomes).filter((one) => !part.data.transitions.some((way) => way.outcome === one));
    const from = outcome ?? (await choose(`Outcome of ${part.title}`, open.map((label) => ({label})), {free: (label) => ({label, detail: 'as typed'})}))?.label;
    if (!from) return;
    const chosen = await choose(`${part.title}: target of ${from}`, [...this.targets(part), {label: part.data.label, detail: 'itself'}]);
    if (chosen) await this.at(part, (state) => ['set_target', {state, outcome: from, target: chosen.label}], (now) => outcomePath(now, from), `${from} leads to ${chosen.label}`);
  }

  async addOutcome() {
    const part = this.now(), outcome = part && await ask(`New outcome of ${part.title}`, '');
    if (outcome) await this.at(part, (container) => ['add_outcome', {container, outcome}], undefined, `outcome ${outcome} added`);
  }

  // Remove an outcome of a container; what leads to it leads to another target.
  async removeOutcome() {
    const part = this.now(), outcome = part && (await choose(`Outcome of ${part.title} to remove`, (part.data.outcomes ?? []).map((label) => ({label}))))?.label;
    if (!outcome) return;
    const ends = part.children.filter((one) => one.kind === 'state'), isUsed = part.data.conditions?.some((one) => one.outcome === outcome) || ends.some((one) => one.data.transitions.some((way) => way.target.replace(/^=/, '') === outcome));
    const targets = [...ends.map((one) => one.data.label), ...part.data.outcomes.filter((one) => one !== outcome)];
    const instead = isUsed ? await choose(`Transitions lead to ${outcome}. Where do they lead instead?`, targets.map((label) => ({label}))) : null;
    if (!isUsed || instead) await this.at(part, (container) => ['remove_outcome', {container, outcome, instead: instead?.label ?? null}], undefined, `outcome ${outcome} removed`);
  }

  // Files.

  // Include a file of trees, by its path from this one or, as "package: PACKAGE/PATH", from the share directory of a package.
  async include() {
    const path = await ask('File to include', '', 'Its path from this file, or package: PACKAGE and the path in its share directory.');
    const [, package_, inside] = /^package:\s*(\S+?)\/(.+)$/.exec(path ?? '') ?? [];
    if (path) await this.run(() => ['add_include', inside ? {path: inside, package: package_} : {path}], () => this.now()?.path, `${path} included`);
  }

  // Remove an include, or the model of a node type, of this file.
  async removeListed(gesture, title, key, listed) {
    await this.file.settled();
    const chosen = (await choose(title, (this.file.view[listed] ?? []).map((one) => ({label: one[key]}))))?.label;
    if (chosen) await this.run(() => [gesture, {[key]: chosen}], () => this.now()?.path, `${chosen} removed`);
  }

  async create() {
    const examples = this.studio.entries('xml').filter((one) => one.example).map((one) => ({...one, detail: `example of ${one.label}`, label: `Tree with ${one.label}`, example: one.example}));
    const kind = await choose('New file from', [...Object.keys(TEMPLATES).map((label) => ({label, detail: 'small template'})), ...examples]);
    if (!kind) return;
    const [usual, template] = TEMPLATES[kind.label] ?? TEMPLATES.Tree;
    const name = await ask('Name of the new file', usual, 'It is on disk when it is saved.');
    if (!name) return;
    const id = name.replace(/^.*\//, '').replace(/\.\w+$/, '').replace(/(?:^|[^A-Za-z0-9]+)(\w?)/g, (_, letter) => letter.toUpperCase()) || 'Main';
    let text = template(id);
    if (kind.example) text = kind.example.includes('<root') ? kind.example : text.replace(/ {4}<Sequence>[^]*<\/Sequence>\n/, `${kind.example.trim().replace(/^/gm, '    ')}\n`);
    await this.studio.create(name, text);
  }
}
