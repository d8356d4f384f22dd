// SPDX-License-Identifier: BSD-3-Clause
// The form of the selected node, tree or state. Each field is an edit of the text, made when it is left or at Enter.

import {ask, choose} from './choice.js';
import {byId, html, replace} from './elements.js';
import {portHelp} from './palette.js';

const CONDITIONS = {_skipIf: 'skip the node if true', _successIf: 'succeed without a tick if true', _failureIf: 'fail without a tick if true', _while: 'tick only while true', _onSuccess: 'run after success', _onFailure: 'run after failure', _onHalted: 'run after a halt', _post: 'run after every end'};
const LEVELS = ['off', 'low', 'high', 'full'];

const LONG = /^(code|script|description|message|text)$/;  // names of values that may have several lines
const literal = (text) => { try { return JSON.parse(text); } catch { return text; } };

export class Form {
  // on.gesture(part, name, args) at a part of the graph, on.now(part) is what it has become, on.can(name) tells whether the file has a gesture, on.act(id) runs a command, on.typeOf(node), on.keys() lists keys, on.problems(path), on.leave().
  constructor(on) {
    this.on = on;
    this.root = byId('form');
    this.root.addEventListener('submit', (event) => event.preventDefault());
    this.root.addEventListener('keydown', (event) => {
      const field = event.target.closest('[data-field]');
      if (event.isComposing) return;
      if (event.key === 'Escape') { event.preventDefault(); event.stopPropagation(); if (field) { field.value = field.dataset.was; } on.leave(); }
      if (event.key === 'Enter' && (field?.tagName === 'INPUT' || (field && event.ctrlKey))) { event.preventDefault(); this.commit(field); }
      if (event.key === ' ' && event.ctrlKey && field) { event.preventDefault(); this.complete(field); }
    });
    this.root.addEventListener('change', (event) => { const field = event.target.closest('[data-field]'); if (field) this.commit(field); });
  }

  // What is refused can be entered again; what the user has left (null) is as it was.
  async commit(field) {
    const {was} = field.dataset;
    if (field.value === was) return;
    field.dataset.was = field.value;
    let done = false;
    try { done = await this.setters.get(field.dataset.field)?.(field.value); } finally { if (done === false) field.dataset.was = was; }
    if (done === null) field.value = field.dataset.was = was;
  }

  async complete(field) {
    const at = field.selectionStart ?? 0, {part} = this, set = this.setters.get(field.dataset.field);
    const found = await choose(`Value for ${field.dataset.label}`, this.words.get(field.dataset.field)?.() ?? this.on.keys().map((key) => ({label: `{${key}}`, detail: 'key of the blackboard'})), {free: (text) => ({label: text, detail: 'as typed'})});
    const now = this.root.querySelector(`[data-field="${CSS.escape(field.dataset.field)}"]`);
    if (!now || this.on.now(part) !== this.on.now(this.part)) { if (found) set(found.label); return; }  // another part is shown now
    now.focus();
    if (!found) { now.setSelectionRange?.(at, at); return; }
    now.value = found.label;
    this.commit(now);
  }

  focus() {
    const first = this.root.querySelector('[data-field].invalid, [data-field][data-first]') ?? this.root.querySelector('[data-field]');
    first?.focus();
    first?.select?.();
  }

  // Show a part of the graph. If it is as it was, the fields stay as they are; what is being typed is kept in any case.
  show(part, extra = '') {
    const key = JSON.stringify([part && [part.kind, part.path, part.data, part.problems, part.locked, part.behavior], extra]);
    if (key === this.key) return;
    const isSame = Boolean(part) && this.on.now(this.part) === part.part, active = document.activeElement;
    const typed = active?.dataset?.field && this.root.contains(active) ? {field: active.dataset.field, value: active.value, was: active.dataset.was, at: [active.selectionStart, active.selectionEnd]} : null;
    if (typed && !isSame) this.commit(active);  // as if it was left
    if (typed) active.dataset.was = active.value;  // a browser tells a change also of what is removed
    Object.assign(this, {key, part: part?.part ?? null, setters: new Map(), words: new Map()});
    byId('form-hint').textContent = part?.title ?? '';
    const put = isSame ? replace : (root, ...parts) => root.replaceChildren(...parts);
    put(this.root, ...(!part ? [html('p', {class: 'empty'}, 'Select a node or a state.')] : {tree: () => this.tree(part), node: () => this.node(part), state: () => this.state(part), outcome: () => this.outcome(part)}[part.kind]()));
    if (!typed || !isSame) return;
    const field = this.root.querySelector(`[data-field="${CSS.escape(typed.field)}"]`);
    field?.focus();
    if (field && typed.value !== typed.was) field.value = typed.value;
    try { field?.setSelectionRange?.(...typed.at); } catch { /* a list to choose from has no cursor */ }
  }

  field(name, value, set, {label = name, hint = '', lines = 1, choices = null, words = null, placeholder = '', isFirst = false, isReadOnly = false, problem = ''} = {}) {
    const id = `field-${name}`;
    this.setters.set(name, set);
    lines = Math.min(Math.max(lines, LONG.test(label.replace(' *', '')) ? 3 : 1, String(value ?? '').split('\n').length), 12);
    if (words) this.words.set(name, words);
    const common = {id, 'data-field': name, 'data-label': label, 'data-was': value ?? '', 'data-first': isFirst, 'aria-describedby': hint || problem ? `${id}-hint` : null, 'aria-invalid': problem ? 'true' : null, class: problem ? 'invalid' : null};
    const made = choices ? html('select', {...common, disabled: isReadOnly}, ...choices.map((one) => html('option', {value: one}, one || '–')))
      : lines > 1 ? html('textarea', {...common, rows: lines, placeholder, readonly: isReadOnly, spellcheck: 'false'}) : html('input', {...common, placeholder, readonly: isReadOnly, spellcheck: 'false', list: words ? null : 'known-keys'});
    made.value = value ?? '';
    return html('div', {class: 'field'}, html('label', {for: id}, label), html('div', {}, made, ...(problem ? [html('span', {class: 'error hint', id: `${id}-hint`}, problem)] : hint ? [html('span', {class: 'hint', id: `${id}-hint`}, hint)] : [])));
  }

  buttons(...ids) { return html('div', {class: 'buttons'}, ...ids.map(([id, text]) => html('button', {type: 'button', 'data-act': id, onclick: () => this.on.act(id)}, text))); }
  keys() { return html('datalist', {id: 'known-keys'}, ...this.on.keys().map((key) => html('option', {value: `{${key}}`}))); }
  edit(part, name, args) { return this.on.gesture(part.part, name, args); }
  comment(part, name) { return this.field('its:comment', part.note, (text) => this.edit(part, 'set_comment', {[name]: part.path, text}), {label: 'note', lines: 2, hint: 'a comment in the text'}); }
  problems(part) { return part.problems.filter((text) => !part.told?.has(text)).map((text) => html('p', {class: 'error'}, text)); }

  tree(part) {
    const {data} = part;
    return [this.buttons(['add_child', 'Add Child'], ['rename', 'Rename…'], ['paste', 'Paste']), ...this.problems(part), this.field('ID', data.id, (value) => this.on.rename(part.part, value), {isFirst: true, hint: 'what names it follows, in all files'}), this.comment(part, 'node')];
  }

  node(part) {
    const {data} = part, type = this.on.typeOf(data), values = new Map(data.attributes.map((one) => [one.name, one.value])), rest = new Set(values.keys());
    const set = (name) => (value) => this.edit(part, 'set_value', {node: part.path, name, value: value === '' && name !== 'name' && !required.has(name) ? null : value === '' && name === 'name' ? null : value});
    const ports = type?.ports ?? [], required = new Set(ports.filter((port) => port.required).map((port) => port.name));
    const problemOf = (name) => part.problems.find((text) => text.includes(`[${name}]`)) ?? '';
    part.told = new Set();
    const isSubTree = data.kind === 'subtree';
    rest.delete('name');
    const fields = ports.map((port, index) => {
      rest.delete(port.name);
      const problem = problemOf(port.name);
      if (problem) part.told.add(problem);
      const bools = port.category === 'bool' ? () => ['true', 'false', ...this.on.keys().map((key) => `{${key}}`)].map((label) => ({label})) : null;
      return this.field(port.name, values.get(port.name) ?? '', set(port.name), {label: `${port.name}${port.required ? ' *' : ''}`, hint: portHelp(port), placeholder: port.default ?? '', isFirst: index === 0, words: bools, problem});
    });
    if (isSubTree && rest.delete('ID')) fields.unshift(this.field('ID', values.get('ID'), set('ID'), {label: 'tree', words: () => this.on.trees().map((label) => ({label})), isFirst: true}));
    for (const name of Object.keys(CONDITIONS)) rest.delete(name);
    if (!isSubTree && data.tag !== data.type) rest.delete('ID');
    const others = [...rest].map((name) => { const problem = problemOf(name); if (problem) part.told.add(problem); return this.field(name, values.get(name), (value) => this.edit(part, 'set_value', {node: part.path, name, value: value || null}), {problem, isFirst: isSubTree || !ports.length}); });
    const given = Object.keys(CONDITIONS).filter((name) => values.has(name));
    return [
      this.keys(), this.buttons(['set_type', `${data.type} – Change…`], ['add_after', 'Add After'], ['add_child', 'Add Child'], ['wrap', 'Wrap…'], ['remove', 'Remove']), ...this.problems(part),
      this.field('name', values.get('name') ?? '', (value) => (value && values.get('name') ? this.on.rename(part.part, value) : set('name')(value)), {placeholder: data.type, words: () => []}), ...fields, ...others,
      html('button', {type: 'button', onclick: () => this.add(part, 'set_value')}, isSubTree ? 'Hand Over a Key…' : 'Add an Attribute…'), this.comment(part, 'node'),
      html('details', {open: given.length > 0}, html('summary', {}, `Conditions${given.length ? ` (${given.length})` : ''}`), ...Object.entries(CONDITIONS).map(([name, hint]) => this.field(name, values.get(name) ?? '', set(name), {hint}))),
      ...(type?.documentation ? [html('details', {}, html('summary', {}, `Help: ${data.type}`), html('p', {class: 'hint'}, type.documentation))] : []),
    ];
  }

  async add(part) {
    const known = part.data.kind === 'subtree' ? this.on.keys().map((key) => ({label: key, detail: 'key of this file'})) : [];
    const name = await choose('Name of the attribute', known, {free: (label) => ({label, detail: 'new'})});
    if (name) this.edit(part, 'set_value', {node: part.path, name: name.label, value: part.data.kind === 'subtree' ? `{${name.label}}` : ''});
  }

  state(part) {
    const {data, path} = part, isRoot = data.parent === null, isLocked = Boolean(data.locked), isContainer = !['state', 'behavior'].includes(data.kind);
    const edit = (name, args) => this.edit(part, name, {state: path, ...args});
    const parts = [...(isLocked ? [html('p', {class: 'warning'}, `Locked: ${data.locked}`)] : []), ...this.problems(part)];
    parts.unshift(this.buttons(...(isContainer ? [['add_child', 'Add State']] : []), ...(isRoot ? [] : [['add_after', 'Add Beside'], ['set_initial', 'Make Initial'], ['remove', 'Remove']])));
    if (!isRoot) parts.push(this.field('its:label', data.label, (label) => this.on.rename(part.part, label), {label: 'label', isFirst: true, isReadOnly: isLocked, words: () => []}));
    if (data.type) parts.push(html('p', {class: 'hint'}, `${data.kind} ${data.type}`));
    const known = this.on.typeOf(data)?.parameters ?? [], given = new Map(data.parameters.map((one) => [one.name, one]));
    for (const name of new Set([...known.map((one) => one.name), ...given.keys()])) {
      const value = given.get(name), described = known.find((one) => one.name === name);
      const isText = typeof value?.value === 'string' && value.value.includes('\n');  // as it is read; others as they are written
      parts.push(this.field(name, (isText ? value.value : value?.text) ?? '', (text) => edit('set_parameter', {name, text: text === '' ? null : isText && this.on.isPython() ? JSON.stringify(text) : text}), {hint: described ? portHelp(described) : '', placeholder: described?.default ?? '', isReadOnly: isLocked || (value && !value.literal), words: () => []}));
    }
    if (!isRoot) {
      parts.push(html('h3', {}, 'Transitions'), ...data.transitions.map((way) => {
        const level = data.autonomy.find((one) => one.outcome === way.outcome)?.level ?? 'off';
        const name = `level:${way.outcome}`;
        this.setters.set(name, (value) => edit('set_autonomy', {outcome: way.outcome, level: value === 'off' ? null : value}));
        const levels = html('select', {'data-field': name, 'data-was': level, 'data-label': `autonomy for ${way.outcome}`, 'aria-label': `autonomy for ${way.outcome}`, disabled: isLocked}, ...LEVELS.map((one) => html('option', {value: one}, one)));
        levels.value = level;
        return html('div', {class: 'way-row'}, html('span', {}, way.outcome), html('button', {type: 'button', disabled: isLocked, 'aria-label': `target of ${way.outcome}: ${way.target}`, onclick: () => this.on.target(path, way.outcome)}, way.target || '–'), levels);
      }), html('button', {type: 'button', disabled: isLocked, onclick: () => this.on.target(path, null)}, 'Add a Transition…'));
      parts.push(html('h3', {}, 'Keys'), ...data.remapping.map((one) => this.field(`key:${one.key}`, one.name, (name) => edit('set_remapping', {key: one.key, name: name || null}), {label: one.key, isReadOnly: isLocked, words: () => []})));
      parts.push(html('button', {type: 'button', disabled: isLocked, onclick: async () => { const key = await choose('Key of the state', (this.on.typeOf(data)?.keyNames ?? []).map((label) => ({label})), {free: (label) => ({label, detail: 'as typed'})}); if (key) edit('set_remapping', {key: key.label, name: key.label}); }}, 'Remap a Key…'));
    }
    for (const {kind, span, ...fields} of data.wrappers) {
      parts.push(html('h3', {}, kind === 'retry' ? 'Retry' : 'Time Limit'), ...Object.entries(fields).map(([name, value]) => this.field(`${kind}:${name}`, typeof value === 'string' ? value : JSON.stringify(value), (text) => edit('set_wrapper', {kind, fields: {...fields, [name]: literal(text)}}), {label: name, isReadOnly: isLocked, words: () => []})),
        html('button', {type: 'button', disabled: isLocked, onclick: () => edit('set_wrapper', {kind, fields: null})}, 'Remove It'));
    }
    if (isRoot && part.behavior) {
      if (this.on.can('set_behavior')) for (const key of ['name', 'description']) parts.push(this.field(key, part.behavior[key], (text) => this.edit(part, 'set_behavior', {key, text: text || null}), {words: () => [], lines: key === 'name' ? 1 : 2}));
      parts.push(html('h3', {}, 'Parameters'), ...part.behavior.parameters.map((one) => this.parameter(part, one)), ...(this.on.can('set_behavior_parameter') ? [html('button', {type: 'button', id: 'add-parameter', onclick: () => this.addParameter(part)}, 'Add a Parameter…')] : []));
    }
    if (data.conditions?.length) parts.push(html('h3', {}, 'Ends When'), ...data.conditions.map((one) => html('p', {}, `${one.outcome}: ${one.when.map((pair) => pair.join(' ')).join(' and ')}`)));
    if (isContainer && data.outcomes.length) parts.push(html('h3', {}, 'Outcomes'), html('p', {}, data.outcomes.join(', ')), ...(this.on.can('add_outcome') ? [this.buttons(['add_outcome', 'Add an Outcome…'], ['remove_outcome', 'Remove an Outcome…'])] : []));
    if (isContainer && this.on.can('set_userdata')) parts.push(html('h3', {}, 'Userdata'), ...data.userdata.map((one) => this.field(`userdata:${one.name}`, one.text, (text) => this.edit(part, 'set_userdata', {container: path, key: one.name, text: text || null}), {label: one.name, isReadOnly: isLocked || !one.literal, words: () => []})), html('button', {type: 'button', disabled: isLocked, onclick: () => this.addUserdata(part)}, 'Add a Key…'));
    if (!isRoot) parts.push(this.comment(part, 'state'));
    return parts;
  }

  async addUserdata(part) {
    const key = await ask('Key of the userdata', ''), text = key && await ask(`Value of ${key}`, '""', 'As it is written in YAML.');
    if (text) this.edit(part, 'set_userdata', {container: part.path, key, text});
  }

  // A parameter of the behavior. Python has its default as it is written; YAML its value, and all its fields in each edit.
  parameter(part, one) {
    const {name, default: written, description, span, value, ...others} = one, isYaml = 'value' in one, isText = isYaml && typeof value === 'string';
    const set = (fields) => this.edit(part, 'set_behavior_parameter', {name, fields: isYaml ? {...others, default: value, ...(description ? {description} : {}), ...fields} : fields});
    const field = (key, shown, setter, more = {}) => this.field(`parameter:${name}:${key}`, shown, setter, {label: key, words: () => [], ...more});
    return html('fieldset', {class: 'parameter'}, html('legend', {}, name),
      field('name', name, (text) => text && this.edit(part, 'rename_behavior_parameter', {name, new: text})),
      field('default', isText ? value : isYaml ? JSON.stringify(value) : written, (text) => set({default: isText ? text : isYaml ? literal(text) : text}), {hint: others.unit ? `unit ${others.unit}` : ''}),
      field('description', description ?? '', (text) => set({description: text})),
      html('button', {type: 'button', 'aria-label': `Remove the parameter ${name}`, onclick: () => this.edit(part, 'set_behavior_parameter', {name, fields: null})}, 'Remove'));
  }

  async addParameter(part) {
    const name = await ask('Name of the new parameter', ''), isPython = this.on.isPython();
    const text = name && await ask(`Default of ${name}`, '0.0', isPython ? 'A Python expression; its type is that of the parameter.' : 'Its type is that of the parameter.');
    if (text !== null && name) this.edit(part, 'set_behavior_parameter', {name, fields: {default: isPython ? text : literal(text)}});
  }

  outcome(part) {
    const {data, way} = part, level = data.autonomy.find((one) => one.outcome === way.outcome)?.level ?? 'off';
    return [html('p', {}, `Outcome ${way.outcome} of ${data.label} leads to ${way.target || 'nothing'}.`), html('button', {type: 'button', onclick: () => this.on.target(data.path, way.outcome)}, 'Change the Target…'),
      this.field('level', level, (value) => this.edit(part, 'set_autonomy', {state: data.path, outcome: way.outcome, level: value === 'off' ? null : value}), {label: 'autonomy', choices: LEVELS, isFirst: true, hint: 'below this level the operator is asked'})];
  }
}
