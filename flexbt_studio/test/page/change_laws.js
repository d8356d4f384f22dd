// SPDX-License-Identifier: BSD-3-Clause
// The laws that the work of several pages rests on, for random changes of random texts. Returns what breaks one, or ''.
const c = await import('./changes.js');
let seed = 7;
const random = (most) => { seed = (seed * 1103515245 + 12345) % 2147483648; return Math.floor(seed / 65536) % most; };
const word = () => Array.from({length: random(4)}, () => ['a', '5', '-', '\n', '🙂'][random(5)]).join('');
const edits = (text) => {
  const made = [];
  for (let at = 0; at <= text.length && random(4); ) {
    const start = at + random(text.length - at + 1), end = start + random(Math.min(4, text.length - start + 1));
    made.push([start, end, word()]);
    at = end + 1;
  }
  return made;
};
for (let count = 0; count < 20000; count += 1) {
  const text = word() + word() + word() + word(), one = edits(text), a = c.fromEdits(one), b = c.fromEdits(edits(text));
  const after = one.reduceRight((now, [start, end, put]) => now.slice(0, start) + put + now.slice(end), text);
  const [aBehind, bBehind] = c.transform(a, b), next = c.fromEdits(edits(after));
  const laws = {
    apply: [c.apply(text, a), after], edits: [c.apply(text, c.fromEdits(c.toEdits(a))), after],
    inverse: [c.apply(after, c.inverse(text, a)), text], transform: [c.apply(c.apply(text, b), aBehind), c.apply(after, bBehind)],
    compose: [c.apply(text, c.compose(a, next)), c.apply(after, next)], difference: [c.apply(text, c.difference(text, after)), after],
  };
  for (const [law, [left, right]] of Object.entries(laws)) if (left !== right) return `${law}: ${JSON.stringify([text, one, left, right])}`;
}
return '';
