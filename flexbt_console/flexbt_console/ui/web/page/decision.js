// SPDX-License-Identifier: BSD-3-Clause
// The decision that waits. Each button belongs to the decision it was made for: its answer never reaches another one.

import {html} from './elements.js';

export const REACTION_MS = 400;  // a click or key sooner than this after a decision took the place of another was meant for the other,
                                 // also when there was nothing in between for no longer than this

export class DecisionBar {
  // send(message) gives whether it went out; tell(text, tone); placesOf() are the names of places; all is where one of
  // those that wait is chosen
  constructor(bar, line, body, all, {send, tell, placesOf}) {
    Object.assign(this, {bar, line, body, all, send, tell, placesOf});
    this.waiting = [];
    this.turned = null;
    this.shown = null;
    this.text = '';
    this.left = -Infinity;
    this.replaced = -Infinity;
    this.picked = '';
    this.allowed = false;
    all.addEventListener('change', () => this.turn(all.value));
  }

  get id() { return this.shown?.id ?? null; }

  // The oldest, or the one that was chosen while it waits.
  show(decisions, now) {
    this.waiting = decisions;
    const next = decisions.find((one) => one.id === this.turned) ?? decisions[0] ?? null;
    const text = JSON.stringify(next);
    if (text !== this.text) {
      const at = performance.now();
      if (this.shown && next?.id !== this.shown.id) this.left = at;
      if (next && next.id !== this.shown?.id && at - this.left < REACTION_MS) this.replaced = at;
      if (next?.id !== this.shown?.id) this.picked = next?.kind === 'transition' ? next.wanted : '';
      this.text = text;
      this.shown = next;
      this.build();
    }
    const line = next ? next.line + (decisions.length > 1 ? ` (+${decisions.length - 1} more)` : '') : 'No pending decision';
    if (this.line.textContent !== line) this.line.textContent = line;
    this.list();
    this.count(now);
  }

  // The page shows now again: what was pressed was meant for the past, and an answer is picked anew.
  returned() {
    this.uncovered();
    this.picked = '';
    this.markPicked();
  }

  // What has covered the page is gone: what was pressed was meant for that.
  uncovered() { this.replaced = performance.now(); }

  // Who has chosen a decision knows it.
  turn(id) {
    this.turned = id;
    this.left = this.replaced = -Infinity;
    this.shown = null;
    this.text = '';
    this.show(this.waiting, this.now);
  }

  list() {
    this.all.parentElement.hidden = this.waiting.length < 2;
    const ids = this.waiting.map((one) => one.id);
    if (ids.join() !== [...this.all.options].map((option) => option.value).join()) {  // it may be open
      this.all.replaceChildren(...this.waiting.map((one) => element('option', {value: one.id}, one.line)));
    }
    if (this.all.value !== this.id) this.all.value = this.id;
  }

  choose() {
    if (this.waiting.length > 1) this.all.focus();
    else this.tell(this.shown ? 'no other pending decision' : 'no pending decision', 'warning');
  }

  // Buttons can be pressed while the picture is live.
  allow(allowed, why = 'there is no live link') {
    this.allowed = allowed;
    this.why = why;
    for (const control of this.body.querySelectorAll('button, input')) control.disabled = !allowed;
  }

  count(now) {
    this.now = now;
    const waited = this.shown && this.shown.since && now >= this.shown.since ? ` (waits ${Math.round(now - this.shown.since)} s)` : '';
    const timer = this.body.querySelector('.waited');
    if (timer && timer.textContent !== waited) timer.textContent = waited;
  }

  build() {
    const decision = this.shown;
    this.bar.classList.toggle('waits', decision !== null);
    this.line.title = decision ? `decision ${decision.id}` : '';
    const rows = [];
    if (decision) {
      for (const reason of decision.reasons) rows.push(element('p', {class: decision.lacks ? 'reason error' : 'reason'}, reason));
      if (decision.lacks) rows.push(element('label', {}, element('input', {id: 'unseen', type: 'checkbox'}), ` answer without seeing ${decision.lacks}`));
      const choices = element('div', {class: 'choices', role: 'group', 'aria-label': 'answers'});
      decision.choices.forEach((choice, index) => {
        const wanted = choice.value === decision.wanted;
        const leads = choice.leads ? ` → ${choice.leads.replace(/^=/, 'ends with ')}` : '';
        choices.append(element('button', {type: 'button', class: wanted && 'primary', 'data-choice': choice.value, onclick: () => this.answer(choice.value, decision.id)},
          `${index + 1} ${choice.text}${wanted ? ' (wanted)' : ''}${leads}`));
      });
      if (decision.wants_value) {
        const field = element('input', {id: 'value', 'data-of': decision.id, 'aria-label': decision.wants_pose ? 'a place, or x y yaw' : 'value', list: 'places',
          placeholder: decision.wants_pose ? 'a place, or x y yaw; or click on the map' : 'value', maxlength: '4000'});
        const places = decision.wants_pose ? this.placesOf().map((name) => element('option', {value: name})) : [];
        const answer = (event) => {
          event.preventDefault();
          if (field.value.trim()) this.answer(field.value.trim(), decision.id);
        };
        choices.append(element('form', {onsubmit: answer}, field, element('datalist', {id: 'places'}, ...places), element('button', {type: 'submit'}, 'Answer')),
          element('button', {type: 'button', id: 'decline', onclick: () => this.ask({do: 'decline', decision: decision.id})}, 'Decline'));
      }
      choices.append(element('span', {class: 'waited hint', role: 'timer'}));
      rows.push(choices);
    }
    const focused = this.body.contains(document.activeElement), before = this.body.querySelector('#value'), isTyped = before === document.activeElement;
    this.body.replaceChildren(...rows);
    this.allow(this.allowed, this.why);
    this.markPicked();
    const field = this.body.querySelector('#value');
    if (before && field?.dataset.of === before.dataset.of) {  // more is known of the same decision: what was typed stays
      field.value = before.value;
      if (isTyped) { field.focus(); field.setSelectionRange(before.selectionStart, before.selectionEnd); }
    }
    if (focused && document.activeElement !== field) this.bar.focus();  // a key that is still on its way must not press a new button
  }

  markPicked() {
    for (const button of this.body.querySelectorAll('[data-choice]')) {
      button.setAttribute('aria-pressed', String(button.dataset.choice === this.picked));
    }
  }

  pick(number) {
    const choice = this.shown?.choices[number - 1];
    if (!choice) this.tell(this.shown ? `there is no choice ${number}` : 'no pending decision', 'warning');
    else if (this.isHasty()) this.hasty();
    else {
      this.picked = choice.value;
      this.markPicked();
    }
  }

  confirm() {
    if (!this.shown) this.tell('no pending decision', 'warning');
    else if (!this.picked) this.tell('pick an answer by its number; Enter sends it', 'warning');
    else this.answer(this.picked, this.shown.id);
  }

  isHasty() { return performance.now() - this.replaced < REACTION_MS; }

  hasty() { this.tell('this decision has just come into view; nothing was sent. Check it and answer again', 'warning'); }

  // What was not received cannot be judged: who answers all the same says so first.
  answer(text, id) {
    const unseen = this.body.querySelector('#unseen');
    if (!unseen) this.ask({answer: text, decision: id});
    else if (unseen.checked) this.ask({answer: text, decision: id, unseen: true});
    else {
      this.tell(`${this.shown.lacks} not received; nothing was sent. Wait for it, or tick "answer without seeing it"`, 'warning');
      unseen.focus();
    }
  }

  ask(message) {
    if (this.isHasty()) this.hasty();
    else if (!this.allowed) this.tell(`${this.why}; nothing was sent`, 'warning');
    else this.send(message);
  }
}

// A text in which nothing is hidden and nothing turns the direction: of names that a robot gives, for which the server
// has no text to be shown. Lines stay lines.
export const plain = (text) => text.replace(/[^\P{C}\n]|[\p{Zl}\p{Zp}]/gu, (sign) => `\\u{${sign.codePointAt(0).toString(16)}}`);

// An element whose texts may come from a robot.
export const element = (name, attributes, ...parts) => html(name, attributes, ...parts.map((one) => typeof one === 'string' ? plain(one) : one));
