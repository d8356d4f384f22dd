// SPDX-License-Identifier: BSD-3-Clause
// The text pane without CodeMirror: a text field with line numbers and marks. Its history is like CodeMirror's: gestures and
// typing are taken back in one order, and edits of other pages are no part of it.

import {apply, compose, fromEdits, inverse, mapOffset, toEdits, transform} from './changes.js';
import {html} from './elements.js';

const TYPING_MS = 700;  // what is typed in one go, with pauses up to this long, is taken back in one step
const MOST_STEPS = 10000;

export function plainPane(parent, on) {
  const numbers = html('div', {class: 'numbers', 'aria-hidden': 'true'}), field = html('textarea', {class: 'plain', spellcheck: 'false', wrap: 'off', readonly: true});
  parent.append(numbers, field);
  let shown = null, marks = new Map();

  function drawNumbers() {
    const count = field.value.split('\n').length;
    if (numbers.childElementCount !== count) {
      numbers.replaceChildren(...Array.from({length: count}, (_, index) => html('div', {}, String(index + 1))));
      marks = new Map([...marks]);
      drawMarks();
    }
    numbers.scrollTop = field.scrollTop;
  }
  function drawMarks() {
    [...numbers.children].forEach((line, index) => { line.className = marks.get(index)?.severity ?? ''; line.title = marks.get(index)?.message ?? ''; });
  }
  const lineAt = (text, offset) => text.slice(0, offset).split('\n').length - 1;

  class Buffer {
    constructor(text, file) { Object.assign(this, {text, file, done: [], undone: [], selection: [0, 0], scroll: 0}); }

    // Put a change into the text and its field. The selection stays where it was in the text.
    put(change, isRemote) {
      this.text = apply(this.text, change);
      if (shown === this) {
        const [start, end, top] = [field.selectionStart, field.selectionEnd, field.scrollTop];
        field.value = this.text;
        field.setSelectionRange(mapOffset(change, start, true), mapOffset(change, end, true));
        field.scrollTop = top;
        drawNumbers();
      }
      this.onchange(change, isRemote);
    }

    apply(change, {isRemote = false} = {}) {
      if (isRemote) for (const stack of [this.done, this.undone]) {
        let remote = change;
        for (let index = stack.length - 1; index >= 0; index -= 1) [remote, stack[index].back] = transform(remote, stack[index].back);
      } else this.remember(inverse(this.text, change), 0);
      this.put(change, isRemote);
    }

    remember(back, time) {
      const last = this.done.at(-1);
      if (time && last?.time && time - last.time < TYPING_MS) Object.assign(last, {back: compose(back, last.back), time});
      else this.done.push({back, time});
      if (this.done.length > MOST_STEPS) this.done.shift();
      this.undone = [];
    }

    step(from, to) {
      const entry = from.pop();
      if (!entry) return false;
      to.push({back: inverse(this.text, entry.back), time: 0});
      this.put(entry.back, false);
      const edit = toEdits(entry.back).at(0);
      if (shown === this && edit && document.activeElement === field) { const at = edit[0] + edit[2].length; field.setSelectionRange(at, at); }
      return true;
    }
    get depth() { return this.done.length; }
    undo() { return this.step(this.done, this.undone); }
    redo() { return this.step(this.undone, this.done); }
  }

  field.addEventListener('input', () => {
    const before = shown.text, after = field.value, least = Math.min(before.length, after.length);
    let tail = 0, head = 0;
    const cursor = field.selectionEnd;  // equal letters: what was typed ends at the cursor
    while (tail < least && tail < after.length - cursor && before.at(-1 - tail) === after.at(-1 - tail)) tail += 1;
    while (head < least - tail && before[head] === after[head]) head += 1;
    while (tail < least - head && before.at(-1 - tail) === after.at(-1 - tail)) tail += 1;
    if (before === after) return;
    const change = fromEdits([[head, before.length - tail, after.slice(head, after.length - tail)]]);
    shown.remember(inverse(before, change), performance.now());
    shown.text = after;
    drawNumbers();
    shown.onchange(change, false);
  });
  field.addEventListener('beforeinput', (event) => {
    if (event.inputType !== 'historyUndo' && event.inputType !== 'historyRedo') return;
    event.preventDefault();
    if (event.inputType === 'historyUndo') on.undo(); else on.redo();
  });
  field.addEventListener('scroll', () => { numbers.scrollTop = field.scrollTop; });
  for (const kind of ['click', 'keyup']) field.addEventListener(kind, (event) => { if (kind === 'click' || /^(Arrow|Page|Home|End)/.test(event.key)) on.cursor(field.selectionStart); });

  return {
    isPlain: true,
    buffer: (text, file) => new Buffer(text, file),
    show(buffer) {
      if (shown) Object.assign(shown, {selection: [field.selectionStart, field.selectionEnd], scroll: field.scrollTop});
      shown = buffer;
      field.readOnly = false;  // it is of a file now
      field.value = buffer.text;
      field.setAttribute('aria-label', `text of ${buffer.file}`);
      field.setSelectionRange(...buffer.selection);
      field.scrollTop = buffer.scroll;
      drawNumbers();
    },
    mark(buffer, findings) {
      if (buffer !== shown) return;
      marks = new Map();
      for (const one of [...findings].reverse()) marks.set(lineAt(buffer.text, one.span[0]), {severity: one.severity === 'error' ? 'error' : 'warning', message: one.message});
      drawMarks();
    },
    select(start, end) {
      field.setSelectionRange(start, end);
      const height = parseFloat(getComputedStyle(field).lineHeight);
      field.scrollTop = Math.max(0, lineAt(shown.text, start) * height - field.clientHeight / 2);
    },
    offset: () => field.selectionStart,
    focus: () => field.focus(),
    hasFocus: () => document.activeElement === field,
    merge: null,
  };
}
