// SPDX-License-Identifier: BSD-3-Clause
// Buttons, single keys, dialogs and the line that is typed: each gives a line as it is written at the prompt.

import {REACTION_MS, element, plain} from './decision.js';
import {byId} from './elements.js';

const COMPLETE_MS = 100;
const BURST_MS = 700;  // keys that follow each other sooner are typed in one go

// The actions of the screen's keys that have a button: each is as it is on the screen.
export const ACTIONS = ['stop', 'pause', 'repeat', 'lock', 'breakpoint', 'authority'];

const ENTER = '\u23ce';  // stands for one in what was typed

// A dialog that was left has the focus until the page is drawn again.
const isLeft = (target) => Boolean(target.closest?.('dialog:not([open])'));
const isElsewhere = (target) => !isLeft(target) && Boolean(target.closest?.('input, select, textarea, dialog, [contenteditable]'));

// Why a text is no value of a parameter; '' when it is one.
function problem({type, minimum, maximum}, text) {
  const number = Number(text);
  if (type === 'int' ? !/^\s*[+-]?\d+\s*$/.test(text) : type === 'float' && (!text.trim() || Number.isNaN(number))) return `expected ${type === 'int' ? 'a whole number' : 'a number'}`;
  if (['int', 'float'].includes(type) && ((minimum && number < Number(minimum)) || (maximum && number > Number(maximum)))) return `beyond its limits (${minimum} to ${maximum})`;
  return '';
}

// A word as the prompt reads it (POSIX shell quoting).
export const word = (text) => /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", `'"'"'`)}'`;

export class Commands {
  // send(message), tell(text, tone), now(): {status, active, behaviors, live}, bar: the decision bar, map
  constructor({send, tell, now, bar}) {
    Object.assign(this, {send, tell, now, bar});
    this.specs = [];
    this.lineBound = null;
    this.burst = '';
    this.burstAt = -Infinity;
    this.byKey = false;
    this.meanings = new Map();
    for (const action of ACTIONS) byId(action).addEventListener('click', () => this.act(action));
    byId('dialog').querySelector('.stop').addEventListener('click', () => this.act('stop'));
    byId('menu').addEventListener('click', (event) => { if (event.target.closest('button')) byId('menu').hidePopover(); });
    for (const button of byId('autonomy').querySelectorAll('button')) button.addEventListener('click', () => this.do(`autonomy ${button.value}`));
    byId('start').addEventListener('click', () => this.start());
    byId('force').addEventListener('click', () => this.force());
    byId('note').addEventListener('click', () => this.type('note '));
    byId('help').addEventListener('click', () => this.help());
    byId('line-form').addEventListener('submit', (event) => { event.preventDefault(); this.submit(); });
    byId('line').addEventListener('input', () => this.complete());
    byId('line').addEventListener('keydown', (event) => { if (event.key === 'Escape') { event.target.value = ''; this.lineBound = null; event.target.blur(); } });
    document.addEventListener('keydown', (event) => this.typed(event), {capture: true});
    document.addEventListener('keydown', (event) => this.key(event));
  }

  // A stop goes out whatever the picture is; the server judges all other lines, too. Whether it went out.
  do(line, decision = this.bar.id) {
    return this.send({do: line, decision});
  }

  // Note what a button sends now. What it has begun to mean only just now was not seen when it was pressed.
  means(id, line) {
    const before = this.meanings.get(id);
    if (before?.line !== line) this.meanings.set(id, {line, since: before ? performance.now() : -Infinity});
  }

  toggle(id) {
    const {line = id, since = -Infinity} = this.meanings.get(id) ?? {};  // nothing was heard of the robot yet
    if (performance.now() - since < REACTION_MS) this.tell(`nothing was sent: this button has just come to mean "${plain(line)}". Press it again`, 'warning');
    else this.do(line);
  }

  // A key of the screen's table: as its button, but its line is typed first, and sent by Enter: only STOP acts at once.
  press(action) {
    const {asks, blocked, lines} = this.now().actions[action] ?? {};
    if (asks && !blocked && lines.length === 1) this.type(lines[0]);
    else this.act(action);
  }

  // What the button of such a key means now: a line, or one of several.
  act(action) {
    const {blocked, lines, help} = this.now().actions[action] ?? {lines: [action]};  // nothing was heard of the robot yet
    if (blocked) this.tell(blocked, 'warning');
    else if (lines.length === 1 && action !== 'stop') this.toggle(action);
    else if (lines.length === 1) this.do(lines[0]);
    else this.read(help, this.lines(lines.map((line) => [line, [line, line.slice(line.indexOf(' ') + 1)], line])));
  }

  force() {
    const rows = this.now().active.states.flatMap(({path, outcomes}) => outcomes.map((outcome) => {
      const of = [path, path.slice(path.lastIndexOf('/') + 1)];
      return [`leave ${path} by ${outcome}`, [outcome, ...of.flatMap((one) => [`${one} ${outcome}`, `${one}: ${outcome}`])], `force ${word(path)} ${word(outcome)}`];
    }));
    this.read('Leave an Active State', rows.length ? this.lines(rows) : 'The outcomes of the active state are not known yet');
  }

  // Ask before a state is left by an outcome; the command belongs to the decision that is on the page now.
  forced(path, outcome) {
    const decision = this.bar.id, opened = performance.now();
    const told = element('p', {class: 'hint', role: 'status'});
    const send = () => {
      if (performance.now() - opened < REACTION_MS) { told.textContent = 'just opened: press again'; return; }
      byId('dialog').close();
      this.do(`force ${word(path)} ${word(outcome)}`, decision);
    };
    this.read(`Leave ${path} by ${outcome}`, element('div', {}, element('p', {}, 'The robot leaves this state at once, whatever it is doing there.'), element('button', {type: 'button', class: 'primary', onclick: send}, `Force ${outcome}`), told));
  }

  // A list of lines to send, [text, names, line]; each belongs to the decision that is on the page now.
  lines(rows) {
    const decision = this.bar.id;
    return this.list(rows.map(([text, names, line]) => ({text, names, run: () => this.do(line, decision)})));
  }

  // A list that is filtered as one types, as that of the screen: nothing is preselected. Enter in its field takes the only
  // row one of whose names is what was typed; Up and Down go to the buttons. A row has {text, names, run, about, refusal}.
  list(rows) {
    const field = element('input', {class: 'find', 'aria-label': 'type to find', placeholder: 'type to find, or go down to a line', autocomplete: 'off'});
    const told = element('p', {class: 'hint', role: 'status'});
    const list = element('ul', {});
    const take = ({refusal, run}) => {
      if (refusal) { told.textContent = plain(`not possible: ${refusal}`); return; }
      byId('dialog').close();
      run();
    };
    const made = rows.map((row) => {
      const button = element('button', {type: 'button', disabled: Boolean(row.refusal), onclick: () => take(row)}, row.text);
      const item = element('li', {}, button, row.about ? ` ${row.about}` : '', row.refusal ? element('span', {class: 'dim'}, ` (not possible: ${row.refusal})`) : '');
      list.append(item);
      return {row, button, item};
    });
    field.addEventListener('input', () => {
      const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
      for (const {row, item} of made) item.hidden = !words.every((one) => row.names.join(' ').toLowerCase().includes(one));
      told.textContent = '';
    });
    const body = element('div', {}, field, told, list);
    body.addEventListener('keydown', (event) => {
      const by = {ArrowDown: 1, ArrowUp: -1}[event.key];
      if (by) {
        const stops = [field, ...made.filter(({item, button}) => !item.hidden && !button.disabled).map(({button}) => button)];
        stops[Math.min(Math.max(0, stops.indexOf(document.activeElement) + by), stops.length - 1)].focus();
      } else if (event.key === 'Enter' && event.target === field && !event.isComposing) {
        const typed = field.value.trim().replace(/\s+/g, ' ');
        const named = (same) => typed ? rows.filter((row) => row.names.some((name) => same(name.replace(/\s+/g, ' ')) === same(typed))) : [];
        const exact = named((text) => text);
        const found = exact.length ? exact : named((text) => text.toLowerCase());
        if (found.length === 1) take(found[0]);
        else told.textContent = found.length ? `${found.length} lines have this name: go down to one` : typed
          ? 'no line has this name: type it in full, or go down to a line' : 'nothing is chosen yet: type a name, or go down to a line';
      } else {
        // What is typed at a line is typed into the field: Enter must not take that line for it. Space presses a button.
        if ((/^[^ ]$/u.test(event.key) || event.key === 'Backspace') && !event.ctrlKey && !event.altKey && !event.metaKey) field.focus();
        return;
      }
      event.preventDefault();
      event.stopPropagation();  // what has closed the dialog must not confirm a decision, too
    });
    return body;
  }

  start(verb = this.now().status?.running ? 'switch' : 'start') {
    const {behaviors} = this.now();
    const rows = behaviors.map((behavior) => (
      {text: behavior.name, names: [behavior.name], about: behavior.description, refusal: behavior.error, run: () => this.fill(verb, behavior)}));
    this.read(`${verb} a behavior`, rows.length ? this.list(rows) : 'The robot has not sent its list of behaviors');
  }

  // A field for each parameter and input of the behavior, and for each option of the command.
  fill(verb, behavior) {
    const form = element('form', {});
    const fields = [];
    const add = (name, told, choices, value, written, check = () => '') => {
      const field = element(choices.length ? 'select' : 'input', {name, autocomplete: 'off'}, ...choices.map((choice) => element('option', {value: choice}, choice)));
      field.value = value;
      if (field.selectedIndex < 0) field.selectedIndex = 0;  // a default that is none of the choices
      form.append(element('label', {class: 'field'}, name, field, element('span', {}), element('span', {class: 'hint'}, told)));
      field.addEventListener('input', () => field.setCustomValidity(check(field.value)));
      const shown = field.value;  // a field of one line shows no line breaks
      fields.push(() => written(choices.length || field.value !== shown ? field.value : value));
    };
    for (const parameter of behavior.parameters) {
      add(parameter.label || parameter.name, parameter.help, parameter.choices, parameter.default,
        (value) => value === parameter.default ? [] : [`${parameter.name}=${value}`], (value) => problem(parameter, value));
    }
    const known = this.specs.find((spec) => spec.name === verb).fields;
    if (known.some(({name}) => name === '--input')) {
      for (const {key, type, help, needed} of behavior.inputs) {
        add(key, help, [], '', (value) => value ? ['--input', `${key}=${type}${type && ':'}${value}`] : [], (value) => needed && !value ? `${key} is needed` : '');
        form.querySelector('label:last-of-type input').required = needed;
      }
    }
    for (const {name, help, choices} of known) {
      add(name.slice(2), help, choices.length ? ['', ...choices] : [], '', (value) => value ? [name, value] : []);
    }
    if (behavior.lacks_machine) {
      form.append(element('label', {}, element('input', {id: 'unseen-machine', type: 'checkbox'}), ` ${verb} it without seeing its machine`));
    }
    const told = element('p', {class: 'hint', role: 'status'});
    form.append(element('button', {type: 'submit'}, verb), told);
    if (behavior.machine) form.append(element('pre', {class: behavior.lacks_machine ? 'error' : ''}, `${behavior.lacks_machine ? '' : 'synthesized machine:\n'}${behavior.machine}`));
    let opened = performance.now();  // an Enter that comes at once, or is held down, was meant for what opened the form
    form.addEventListener('input', () => { opened = -Infinity; });
    form.addEventListener('keydown', (event) => { if (event.key === 'Enter' && event.repeat) event.preventDefault(); });
    form.addEventListener('submit', (event) => {
      event.preventDefault();
      if (performance.now() - opened < REACTION_MS) { told.textContent = `just opened: Enter again: ${verb}`; return; }
      const unseen = form.querySelector('#unseen-machine');
      if (unseen && !unseen.checked) { told.textContent = 'The machine was not received; nothing was sent. Wait for it, or tick the box'; unseen.focus(); return; }
      byId('dialog').close();
      const now = this.now().behaviors.find(({name}) => name === behavior.name);
      if (JSON.stringify(now) !== JSON.stringify(behavior)) this.tell(`${plain(behavior.name)} has changed since the form was opened; nothing was sent. Check it again`, 'warning');
      else this.do([...verb.split(' '), behavior.name, ...fields.flatMap((written) => written()), ...(unseen ? ['--unseen'] : [])].map(word).join(' '));
    });
    this.read(`${verb} ${behavior.name}`, form);
  }

  help() {
    const rows = this.specs.map((spec) => ({text: spec.usage, names: [spec.name, spec.summary], about: spec.summary, run: () => this.type(`${spec.name} `)}));
    const keys = 'Keys: ! or F8 stop, p pause or resume, 1-9 pick an answer, Enter sends it, a chooses among all that waits, g to the map, j to the time line, s start, f force, r repeat, ' +
      'l lock, b breakpoint, c authority, n note, : any command, ? this help. Only STOP acts at once: p, r, l, b and c show a line that Enter sends. Keys work while no field has the focus; F8 from anywhere.';
    this.read('commands', element('div', {}, element('p', {}, keys), this.list(rows)));
  }

  read(title, body) {
    byId('dialog-title').textContent = plain(title);
    byId('dialog-body').replaceChildren(typeof body === 'string' ? element('pre', {}, body) : body);
    if (!byId('dialog').open) byId('dialog').showModal();
    (byId('dialog-body').querySelector('button, input, select') ?? byId('dialog-close')).focus();  // not STOP
  }

  type(text) {
    const line = byId('line');
    line.value = text;
    this.lineBound = null;
    this.byKey = true;
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
    if (!this.do(text, this.lineBound ? this.lineBound.id : this.bar.id)) return;
    byId('line').value = '';
    this.lineBound = null;
    if (this.byKey) byId('line').blur();  // the next key is a command again
    this.byKey = false;
  }

  // What is typed in one go, wherever it goes; arrows, Tab and Escape begin another one.
  typed(event) {
    const at = performance.now();
    if (at - this.burstAt >= BURST_MS || /^(Arrow|Tab|Esc|Home|End|Page|F\d)/.test(event.key)) this.burst = '';
    this.burstAt = at;
    if (/^[\p{L}\p{N}]$/u.test(event.key)) this.burst += event.key;
    else if (event.key === 'Enter' && isElsewhere(event.target)) this.burst += ENTER;
    this.burst = this.burst.slice(-20);
  }

  // Whether a key is of a word, which may be meant as an answer: no letter of it is a command, and neither Enter nor
  // Space behind it presses anything. Enter may follow one number, which picks an answer, and not the Enter that was meant for a field.
  isOfWord(key) {
    if (key === 'Enter' || key === ' ') {
      if (this.burst !== '' && !/^\d$/.test(this.burst.split(ENTER).pop())) return true;
      this.burst = ENTER;
      return false;
    }
    return /^\p{L}$/u.test(key) && this.burst.split(ENTER).pop().length > 1;
  }

  timeline() { byId('timeline').querySelector('.timeline-body').focus(); }

  key(event) {
    if (event.key === 'F8') {
      event.preventDefault();
      if (!event.repeat) this.act('stop');
      return;
    }
    const isPressed = !isLeft(event.target) && event.target.closest?.('button, a, summary');
    if (isElsewhere(event.target) || event.ctrlKey || event.altKey || event.metaKey || !byId('keys').checked || event.repeat) return;
    if (this.isOfWord(event.key)) {
      event.preventDefault();
      this.tell(`nothing was sent: '${plain(this.burst)}' was typed in one go. Press one key alone, or ":" to type a line`, 'warning');
      return;
    }
    const actions = {
      '!': () => this.act('stop'), p: () => this.press('pause'), f: () => this.force(), s: () => this.start(), r: () => this.press('repeat'),
      a: () => this.bar.choose(), l: () => this.press('lock'), b: () => this.press('breakpoint'), c: () => this.press('authority'),
      n: () => this.type('note '), ':': () => this.type(''), '/': () => this.type(''), '?': () => this.help(), g: () => byId('map').focus(), j: () => this.timeline(),
      Enter: isPressed ? null : () => this.bar.confirm(),
    };
    const action = /^[1-9]$/.test(event.key) ? () => this.bar.pick(Number(event.key)) : actions[event.key] ?? actions[event.key.toLowerCase()];  // also with caps lock
    if (!action) return;
    event.preventDefault();
    action();
  }
}
