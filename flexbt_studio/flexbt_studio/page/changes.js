// SPDX-License-Identifier: BSD-3-Clause
// Changes of texts. A change is a list of steps through a text: a positive number keeps that many characters, a negative one
// removes that many, and a string is inserted. What follows the last step is kept.
//
// Sources: operational transformation of texts as in ot.js and CodeMirror's ChangeSet.

const MOST_LINES = 2000;  // of each side of a difference that is compared line by line; beyond, it is one replacement

// A text such as '5' is no number here, whatever JavaScript says of '5' > 0.
const keeps = (step) => typeof step === 'number' && step > 0;
const removes = (step) => typeof step === 'number' && step < 0;

function builder() {
  const steps = [];
  return {
    steps,
    keep(count) { if (count > 0) { if (keeps(steps.at(-1))) steps[steps.length - 1] += count; else steps.push(count); } },
    insert(text) {
      if (!text) return;
      const last = steps.length - 1;
      if (typeof steps[last] === 'string') steps[last] += text;
      else if (removes(steps[last])) {  // insertions come before removals, so that equal changes look equal
        if (typeof steps[last - 1] === 'string') steps[last - 1] += text; else steps.splice(last, 0, text);
      } else steps.push(text);
    },
    remove(count) { if (count > 0) { if (removes(steps.at(-1))) steps[steps.length - 1] -= count; else steps.push(-count); } },
    done() { while (keeps(steps.at(-1))) steps.pop(); return steps; },
  };
}

// Reads a change step by step, in portions of a wished length. After the last step it keeps for ever.
function reader(change) {
  let index = 0, used = 0;
  return {
    get more() { return index < change.length; },
    get step() { return index < change.length ? change[index] : Infinity; },
    get left() { return index < change.length ? Math.abs(change[index]) - used : Infinity; },
    take(count) { used += count; if (used >= Math.abs(change[index])) { index += 1; used = 0; } },
    skip() { index += 1; used = 0; },
  };
}

// The change of edits [start, end, text], which do not overlap and count in the text before them.
export function fromEdits(edits) {
  const made = builder();
  let at = 0;
  const sorted = edits.map((edit, index) => [edit, index]).sort(([a, i], [b, j]) => a[0] - b[0] || a[1] - b[1] || i - j);
  for (const [[start, end, text]] of sorted) {
    made.keep(start - at);
    made.insert(text);
    made.remove(end - start);
    at = end;
  }
  return made.done();
}

export function toEdits(change) {
  const edits = [];
  let at = 0;
  for (const step of change) {
    const last = edits.at(-1);
    if (keeps(step)) at += step;
    else if (typeof step === 'string') edits.push([at, at, step]);
    else { if (last?.[1] === at) last[1] -= step; else edits.push([at, at - step, '']); at -= step; }
  }
  return edits;
}

export function apply(text, change) {
  const parts = [];
  let at = 0;
  for (const step of change) {
    if (typeof step === 'string') parts.push(step);
    else { if (step > 0) parts.push(text.slice(at, at + step)); at += Math.abs(step); }
  }
  return parts.join('') + text.slice(at);
}

// The change that takes back a change of this text.
export function inverse(text, change) {
  const made = builder();
  let at = 0;
  for (const step of change) {
    if (typeof step === 'string') made.remove(step.length);
    else { if (step > 0) made.keep(step); else made.insert(text.slice(at, at - step)); at += Math.abs(step); }
  }
  return made.done();
}

// One change with the effect of both, one after the other.
export function compose(first, second) {
  const made = builder(), a = reader(first), b = reader(second);
  let text = '';  // what is left of an insertion of the first
  for (;;) {
    if (!text && removes(a.step)) { made.remove(a.left); a.skip(); }
    else if (typeof b.step === 'string') { made.insert(b.step); b.skip(); }
    else if (!text && typeof a.step === 'string') { text = a.step; a.skip(); }
    else if (!text && !a.more && !b.more) return made.done();
    else {
      const count = Math.min(text ? text.length : a.left, b.left), isKept = keeps(b.step);
      if (count === Infinity) return made.done();
      if (text) { if (isKept) made.insert(text.slice(0, count)); text = text.slice(count); }
      else { if (isKept) made.keep(count); else made.remove(count); if (a.more) a.take(count); }
      if (b.more) b.take(count);
    }
  }
}

// Two changes of one text: [the first as a change of what the second has made, the second as one of what the first has made].
// What both insert at one place comes in the order of the arguments.
export function transform(first, second) {
  const one = builder(), two = builder(), a = reader(first), b = reader(second);
  for (;;) {
    if (typeof a.step === 'string') { one.insert(a.step); two.keep(a.step.length); a.skip(); }
    else if (typeof b.step === 'string') { two.insert(b.step); one.keep(b.step.length); b.skip(); }
    else {
      const count = Math.min(a.left, b.left);
      if (count === Infinity) return [one.done(), two.done()];
      if (keeps(a.step) && keeps(b.step)) { one.keep(count); two.keep(count); }
      else if (removes(a.step) && keeps(b.step)) one.remove(count);
      else if (keeps(a.step) && removes(b.step)) two.remove(count);
      if (a.more) a.take(count);
      if (b.more) b.take(count);
    }
  }
}

// Where an offset is after a change. What is inserted there comes before it, unless isBefore.
export function mapOffset(change, offset, isBefore = false) {
  let at = 0, shift = 0;
  for (const step of change) {
    if (at > offset || (at === offset && (isBefore || typeof step !== 'string'))) break;
    if (typeof step === 'string') shift += step.length;
    else { if (step < 0) shift -= Math.min(-step, offset - at); at += Math.abs(step); }
  }
  return offset + shift;
}

// The lines of two texts side by side: [kind, line] with ' ' for both, '-' for the first only, '+' for the second only.
export function compareLines(before, after) {
  const a = before.split(/(?<=\n)/), b = after.split(/(?<=\n)/), rows = [];
  let start = 0, end = 0;
  while (start < Math.min(a.length, b.length) && a[start] === b[start]) start += 1;
  while (end < Math.min(a.length, b.length) - start && a.at(-1 - end) === b.at(-1 - end)) end += 1;
  for (const line of a.slice(0, start)) rows.push([' ', line]);
  const left = a.slice(start, a.length - end), right = b.slice(start, b.length - end);
  if (left.length > MOST_LINES || right.length > MOST_LINES) rows.push(...left.map((line) => ['-', line]), ...right.map((line) => ['+', line]));
  else {
    const width = right.length + 1, common = new Uint16Array((left.length + 1) * width);  // lengths of the longest common rest
    for (let i = left.length - 1; i >= 0; i -= 1) {
      for (let j = right.length - 1; j >= 0; j -= 1) {
        common[i * width + j] = left[i] === right[j] ? common[(i + 1) * width + j + 1] + 1 : Math.max(common[(i + 1) * width + j], common[i * width + j + 1]);
      }
    }
    let i = 0, j = 0;
    while (i < left.length || j < right.length) {
      if (i < left.length && j < right.length && left[i] === right[j]) { rows.push([' ', left[i]]); i += 1; j += 1; }
      else if (i < left.length && (j === right.length || common[(i + 1) * width + j] >= common[i * width + j + 1])) rows.push(['-', left[i++]]);
      else rows.push(['+', right[j++]]);
    }
  }
  for (const line of a.slice(a.length - end)) rows.push([' ', line]);
  return rows;
}

// The hunks of a difference, whole lines with one that stays between them: {start, end, text, was, line, after, rows}. Text takes
// the place of start to end, where was is; line and after are the numbers of their first lines.
export function hunks(before, after) {
  const found = [];
  let at = 0, line = 1, to = 1, last = null;
  for (const [kind, text] of compareLines(before, after)) {
    if (kind === ' ') last = null;
    else {
      if (!last) found.push(last = {start: at, end: at, text: '', was: '', line, after: to, rows: []});
      last.rows.push([kind, text]);
      if (kind === '+') last.text += text; else { last.was += text; last.end += text.length; }
    }
    if (kind !== '+') { at += text.length; line += 1; }
    if (kind !== '-') to += 1;
  }
  return found;
}

// The edit of a hunk after a change, which has made this text; null if its lines, or the place where it comes, are no longer there.
export function placed({start, end, text, was}, change, now) {
  const first = mapOffset(change, start), last = Math.max(first, mapOffset(change, end, true));
  const isAtLine = first === 0 || now[first - 1] === '\n' || first === now.length;
  return now.slice(first, last) === was && isAtLine ? [first, last, text] : null;
}

// A change that turns one text into another.
export function difference(before, after) {
  const made = builder();
  for (const [kind, line] of compareLines(before, after)) {
    if (kind === ' ') made.keep(line.length); else if (kind === '-') made.remove(line.length); else made.insert(line);
  }
  return shortened(made.done(), before);
}

// The change with each replacement as short as its common beginning and end allow.
function shortened(change, before) {
  return fromEdits(toEdits(change).map(([start, end, text]) => {
    const old = before.slice(start, end), least = Math.min(old.length, text.length);
    let head = 0, tail = 0;
    while (head < least && old[head] === text[head]) head += 1;
    while (tail < least - head && old.at(-1 - tail) === text.at(-1 - tail)) tail += 1;
    return [start + head, end - tail, text.slice(head, text.length - tail)];
  }));
}
