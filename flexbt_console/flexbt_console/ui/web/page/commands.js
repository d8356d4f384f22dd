// SPDX-License-Identifier: BSD-3-Clause
// Buttons, single keys, dialogs and the line that is typed: each gives a line as it is written at the prompt.

import {element, plain} from './decision.js';

const COMPLETE_MS = 100;

// The actions of the screen's keys that have a button: each is as it is on the screen.
export const ACTIONS = ['stop', 'pause', 'repeat', 'lock', 'breakpoint', 'authority'];

const byId = (id) => document.getElementById(id);

// A word as the prompt reads it (POSIX shell quoting).
export const word = (text) => /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", `'"'"'`)}'`;

export class Commands {
  // send(message), tell(text, tone), now(): {status, active, behaviors, live}, bar: the decision bar, map
  constructor({send, tell, now, bar}) {
    Object.assign(this, {send, tell, now, bar});
    this.specs = [];
    this.lineBound = null;
    for (const action of ACTIONS) byId(action).addEventListener('click', () => this.act(action));
    byId('autonomy').addEventListener('change', (event) => this.do(`autonomy ${event.target.value}`));
    byId('start').addEventListener('click', () => this.start());
    byId('force').addEventListener('click', () => this.force());
    byId('note').addEventListener('click', () => this.type('note '));
    byId('help').addEventListener('click', () => this.help());
    byId('line-form').addEventListener('submit', (event) => { event.preventDefault(); this.submit(); });
    byId('line').addEventListener('input', () => this.complete());
    byId('line').addEventListener('keydown', (event) => { if (event.key === 'Escape') { event.target.value = ''; event.target.blur(); } });
    document.addEventListener('keydown', (event) => this.key(event));
  }

  // A stop goes out whatever the picture is; the server judges all other lines, too.
  do(line, decision = this.bar.id) {
    this.send({do: line, decision});
  }

  // What a key of the screen's table means now: a line, or one of several.
  act(action) {
    const {blocked, lines, help} = this.now().actions[action] ?? {lines: [action]};  // nothing was heard of the robot yet
    if (blocked) this.tell(blocked, 'warning');
    else if (lines.length === 1) this.do(lines[0]);
    else this.read(help, this.list(lines.map((line) => [line, line])));
  }

  force() {
    const rows = this.now().active.states.flatMap((state) =>
      state.outcomes.map((outcome) => [`leave ${state.path} by ${outcome}`, `force ${word(state.path)} ${word(outcome)}`]));
    this.read('leave an active state', rows.length ? this.list(rows) : 'the outcomes of the active state are not known yet');
  }

  // Buttons of texts, with the line that each gives; it belongs to the decision that is on the page now.
  list(rows) {
    const decision = this.bar.id;
    return element('ul', {}, ...rows.map(([text, line]) => {
      const button = element('button', {type: 'button'}, text);
      button.addEventListener('click', () => { byId('dialog').close(); this.do(line, decision); });
      return element('li', {}, button);
    }));
  }

  start() {
    const {behaviors, status} = this.now();
    const verb = status?.running ? 'switch' : 'start';
    const list = element('ul', {});
    for (const behavior of behaviors) {
      const button = element('button', {type: 'button'}, behavior.name);
      button.addEventListener('click', () => this.fill(verb, behavior));
      list.append(element('li', {}, button, ` ${behavior.description}`));
    }
    this.read(`${verb} a behavior`, behaviors.length ? list : 'the robot has not said which behaviors it has');
  }

  fill(verb, behavior) {
    const form = element('form', {});
    const fields = behavior.parameters.map((parameter) => {
      const field = element(parameter.choices.length ? 'select' : 'input', {name: parameter.name});
      for (const choice of parameter.choices) field.append(element('option', {value: choice}, choice));
      field.value = parameter.default;
      form.append(element('label', {class: 'field'}, parameter.name, field, element('span', {}), element('span', {class: 'hint'}, parameter.help)));
      return [parameter, field];
    });
    const options = element('input', {name: 'options'});
    const known = this.specs.find((spec) => spec.name === verb).options;
    form.append(element('label', {class: 'field'}, 'options', options, element('span', {}), element('span', {class: 'hint'}, known)));
    form.append(element('button', {type: 'submit'}, verb));
    form.addEventListener('submit', (event) => {
      event.preventDefault();
      byId('dialog').close();
      const given = fields.filter(([parameter, field]) => field.value !== parameter.default);
      const words = [verb, behavior.name, ...given.map(([parameter, field]) => `${parameter.name}=${field.value}`)].map(word);
      this.do([...words, options.value].join(' ').trim());
    });
    this.read(`${verb} ${behavior.name}`, form);
  }

  help() {
    const rows = this.specs.map((spec) => {
      const button = element('button', {type: 'button'}, element('code', {}, spec.usage));
      button.addEventListener('click', () => { byId('dialog').close(); this.type(`${spec.name} `); });
      return element('li', {}, button, ` ${spec.summary}`);
    });
    const keys = 'Keys: ! or F8 stop, p pause or go on, 1-9 pick an answer, Enter sends it, a chooses among all that waits, g to the map, s start, f force, r repeat, ' +
      'l lock, b breakpoint, c authority, n note, : any command, ? this help. They work while no field has the focus; F8 from anywhere.';
    this.read('commands', element('div', {}, element('p', {}, keys), element('ul', {}, ...rows)));
  }

  read(title, body) {
    byId('dialog-title').textContent = plain(title);
    byId('dialog-body').replaceChildren(typeof body === 'string' ? element('pre', {}, body) : body);
    if (!byId('dialog').open) byId('dialog').showModal();
    byId('dialog-body').querySelector('button, input, select')?.focus();
  }

  type(text) {
    const line = byId('line');
    line.value = text;
    line.focus();
    this.complete();
  }

  // A line belongs to the decision that was on the page when its first character was typed.
  complete() {
    const text = byId('line').value;
    if (!text) this.lineBound = null;
    else this.lineBound ??= {id: this.bar.id};
    this.completing ??= setTimeout(() => {  // a key that is held down gives 30 texts a second
      this.completing = null;
      if (byId('line').value) this.send({complete: byId('line').value.slice(0, 4000)});
    }, COMPLETE_MS);
  }

  candidates([text, words]) {
    if (byId('line').value !== text) return;
    const head = text.slice(0, text.length - text.split(' ').pop().length);
    byId('candidates').replaceChildren(...words.map((one) => element('option', {value: head + one})));
  }

  submit() {
    const text = byId('line').value.trim();
    if (!text) return;
    this.do(text, this.lineBound ? this.lineBound.id : this.bar.id);
    byId('line').value = '';
    this.lineBound = null;
  }

  key(event) {
    if (event.key === 'F8') {
      event.preventDefault();
      if (!event.repeat) this.act('stop');
      return;
    }
    const left = event.target.closest?.('dialog:not([open])');  // it has the focus until the page is drawn again
    const inField = !left && event.target.closest?.('input, select, textarea, dialog, [contenteditable]');
    const onButton = !left && event.target.closest?.('button, a');
    if (inField || event.ctrlKey || event.altKey || event.metaKey || !byId('keys').checked || event.repeat) return;
    const actions = {
      '!': () => this.act('stop'), p: () => this.act('pause'), f: () => this.force(), s: () => this.start(), r: () => this.act('repeat'),
      a: () => this.bar.choose(), l: () => this.act('lock'), b: () => this.act('breakpoint'), c: () => this.act('authority'),
      n: () => this.type('note '), ':': () => this.type(''), '/': () => this.type(''), '?': () => this.help(), g: () => byId('map').focus(),
      Enter: onButton ? null : () => this.bar.confirm(),
    };
    const action = /^[1-9]$/.test(event.key) ? () => this.bar.pick(Number(event.key)) : actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }
}
