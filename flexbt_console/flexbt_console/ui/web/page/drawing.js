// SPDX-License-Identifier: BSD-3-Clause
// Pictures of Graphviz in the page: copied element by element, so that nothing but shapes and texts gets in.

const SVG = 'http://www.w3.org/2000/svg';
const ELEMENTS = new Set(['svg', 'g', 'path', 'polygon', 'polyline', 'ellipse', 'text', 'title']);
const ATTRIBUTES = new Set(['id', 'class', 'd', 'points', 'x', 'y', 'cx', 'cy', 'rx', 'ry', 'fill', 'stroke', 'stroke-width',
  'stroke-dasharray', 'transform', 'viewBox', 'width', 'height', 'text-anchor', 'font-size', 'font-family']);
const SIGNS = {running: '▶', success: '✓', failure: '✗', skipped: '↷'};
const known = new Map();

export function keep(key, text) {
  const source = new DOMParser().parseFromString(text, 'image/svg+xml').documentElement;
  known.set(key, source.localName === 'svg' ? source : null);
  if (known.size > 32) known.delete(known.keys().next().value);
}

function copy(source) {
  if (!ELEMENTS.has(source.localName) || source.namespaceURI !== SVG) return null;
  const made = document.createElementNS(SVG, source.localName);
  for (const {name, value} of source.attributes) if (ATTRIBUTES.has(name)) made.setAttribute(name, value);
  for (const child of source.childNodes) {
    if (child.nodeType === Node.TEXT_NODE) made.append(child.data);
    else if (child.nodeType === Node.ELEMENT_NODE) {
      if (child.localName === 'title' && source.localName === 'g') continue;  // Graphviz's own names, which tell nothing
      const inner = copy(child);
      if (inner) made.append(inner);
    }
  }
  return made;
}

// Put the drawing into a place; gives the SVG, or null while it is not there.
export function show(place, key) {
  if (place.dataset.key === key) return place.firstElementChild;
  const source = known.get(key);
  if (!source) return null;
  const made = copy(source);
  made.setAttribute('aria-hidden', 'true');
  for (const side of ['width', 'height']) made.setAttribute(side, parseFloat(source.getAttribute(side)));  // pixels for points
  place.replaceChildren(made);
  place.dataset.key = key;
  return made;
}

export const part = (svg, id) => svg.querySelector(`[id="${CSS.escape(id)}"]`);

export function mark(svg, name, ids) {
  const wanted = new Set(ids);
  for (const old of svg.querySelectorAll(`.${name}`)) if (!wanted.has(old.id)) old.classList.remove(name);
  for (const id of wanted) part(svg, id)?.classList.add(name);
}

// The statuses of a tree: colour, frame, and a sign. A node that is idle again shows how it had ended.
export function statuses(svg, current, last) {
  current.forEach((status, index) => {
    const node = part(svg, `t0n${index}`);
    const shown = status === 'idle' ? last[index] : status;
    if (!node || node.dataset.status === shown) return;
    node.dataset.status = shown;
    node.classList.remove(...Object.keys(SIGNS));
    node.querySelector('.sign')?.remove();
    if (!SIGNS[shown]) return;
    node.classList.add(shown);
    const text = node.querySelector('text');
    if (!text) return;
    const box = node.getBBox();
    const sign = document.createElementNS(SVG, 'text');
    sign.setAttribute('class', 'sign');
    sign.setAttribute('x', box.x - 3);
    sign.setAttribute('y', box.y + 4);
    sign.append(SIGNS[shown]);
    node.append(sign);
  });
}

export function bring(place, element) {
  if (!element) return;
  const outer = place.getBoundingClientRect();
  const inner = element.getBoundingClientRect();
  if (inner.top < outer.top || inner.bottom > outer.bottom) place.scrollTop += (inner.top + inner.bottom - outer.top - outer.bottom) / 2;
  if (inner.left < outer.left || inner.right > outer.right) place.scrollLeft += (inner.left + inner.right - outer.left - outer.right) / 2;
}
