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
  const found = c.hunks(text, after), chosen = found.filter(() => random(2)), now = c.apply(text, b);
  // One hunk after the other, from the last: each takes the place of its lines.
  const byHand = chosen.reduceRight((made, {start, text: put, was}) => made.slice(0, start) + put + made.slice(start + was.length), text);
  const accepted = c.fromEdits(chosen.map((one) => c.placed(one, [], text))), kept = chosen.filter((one) => c.placed(one, b, now));
  const late = c.fromEdits(kept.map((one) => c.placed(one, b, now)));
  const laws = {
    hunks: [c.apply(text, c.fromEdits(found.map((one) => c.placed(one, [], text)))), after], chosen: [c.apply(text, accepted), byHand],
    late: [c.apply(now, late), c.apply(now, c.transform(b, c.fromEdits(kept.map((one) => c.placed(one, [], text))))[1])], none: [found.length === 0, text === after],
    apply: [c.apply(text, a), after], edits: [c.apply(text, c.fromEdits(c.toEdits(a))), after],
    inverse: [c.apply(after, c.inverse(text, a)), text], transform: [c.apply(c.apply(text, b), aBehind), c.apply(after, bBehind)],
    compose: [c.apply(text, c.compose(a, next)), c.apply(after, next)], difference: [c.apply(text, c.difference(text, after)), after],
  };
  for (const [law, [left, right]] of Object.entries(laws)) if (left !== right) return `${law}: ${JSON.stringify([text, one, left, right])}`;
}
return '';
