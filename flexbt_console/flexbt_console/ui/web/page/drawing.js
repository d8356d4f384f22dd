// SPDX-License-Identifier: BSD-3-Clause
// Diagrams in the page. Machines are pictures of Graphviz, copied element by element, so that nothing but shapes and texts gets in; trees are laid out here.

import {svg as svgElement} from './elements.js';

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

export const has = (key) => Boolean(known.get(key));

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

// Put a kept picture into an SVG, and its legend into another one. Gives the extent of the picture.
export function show(svg, legend, key) {
  const made = copy(known.get(key));
  const signs = made.querySelector('.legend');
  signs?.remove();
  for (const group of made.querySelectorAll('g.node, g.edge, g.cluster')) group.setAttribute('aria-hidden', 'true');  // the panel has the same as text
  svg.replaceChildren(...made.children);
  svg.dataset.key = key;
  if (signs) {
    legend.replaceChildren(signs);
    const {x, y, width, height} = legend.getBBox();
    if (width) {  // none while its panel is folded
      legend.setAttribute('viewBox', `${x - 2} ${y - 2} ${width + 4} ${height + 4}`);
      legend.setAttribute('width', width + 4);
      legend.setAttribute('height', height + 4);
    }
  }
  return svg.firstElementChild.getBBox && extent(svg.firstElementChild);
}

// The extent of a group in the units of its parent: Graphviz moves its drawing.
function extent(group) {
  const {x, y, width, height} = group.getBBox(), by = group.transform.baseVal.consolidate()?.matrix;
  return {x: x + (by?.e ?? 0), y: y + (by?.f ?? 0), width, height};
}

export const part = (svg, id) => svg.querySelector(`[id="${CSS.escape(id)}"]`);

export function mark(svg, name, ids) {
  const wanted = new Set(ids);
  for (const old of svg.querySelectorAll(`.${name}`)) if (!wanted.has(old.id)) old.classList.remove(name);
  for (const id of wanted) part(svg, id)?.classList.add(name);
}

// Make an element a button of the diagram, or none any more (without run).
export function press(group, label, run) {
  group.onclick = run ?? null;
  group.onkeydown = run ? (event) => { if (event.key === 'Enter' || event.key === ' ') { event.preventDefault(); event.stopPropagation(); if (!event.repeat) run(); } } : null;
  group.classList.toggle('button', Boolean(run));
  if (run) {
    group.removeAttribute('aria-hidden');
    for (const [name, value] of [['role', 'button'], ['tabindex', '0'], ['aria-label', label]]) if (group.getAttribute(name) !== value) group.setAttribute(name, value);
  } else {
    for (const name of ['role', 'tabindex', 'aria-label']) group.removeAttribute(name);
    group.setAttribute('aria-hidden', 'true');
  }
}

// The outcomes that may be chosen, as buttons at the labels of their transitions. choices: by id of the transition {label, run}.
export function offer(svg, choices) {
  for (const old of svg.querySelectorAll('.choice')) {
    if (choices.has(old.id)) continue;
    old.classList.remove('choice');
    press(old, '', null);
    old.querySelector('rect')?.remove();
  }
  for (const [id, {label, run}] of choices) {
    const edge = part(svg, id), text = edge?.querySelector('text');
    if (!text) continue;
    edge.classList.add('choice');
    press(edge, label, run);
    if (edge.querySelector('rect')) continue;
    edge.parentNode.append(edge);  // above all lines
    svg.dataset.spread = '';
    const {x, y, width, height} = text.getBBox();
    text.before(svgElement('rect', {x: x - 5, y: y - 4, width: width + 10, height: height + 8, rx: 5}));
  }
  spread(svg);
}

// Buttons that would lie on each other or on a state, as labels that grow do, go below it.
export function spread(svg) {
  const grow = Number(svg.style.getPropertyValue('--grow')) || 1;
  if (svg.dataset.spread === String(grow)) return;
  svg.dataset.spread = String(grow);
  const taken = [...svg.querySelectorAll('.State, .Outcome')].map((state) => state.getBBox()).map(({x, y, width, height}) => ({left: x, top: y, w: width, h: height}));
  const pills = [...svg.querySelectorAll('.choice > rect')].map((rect) => [rect.parentNode, rect.getBBox()]).sort(([, a], [, b]) => a.y - b.y);
  for (const [edge, {x, y, width, height}] of pills) {
    const [w, h] = [width * grow, height * grow];
    const box = {left: x + (width - w) / 2, top: y + (height - h) / 2};
    for (const one of [...taken].sort((a, b) => a.top - b.top)) if (box.left < one.left + one.w && one.left < box.left + w && box.top < one.top + one.h && one.top < box.top + h) box.top = one.top + one.h + 1;
    taken.push({...box, w, h});
    edge.style.setProperty('--down', `${box.top - (y + (height - h) / 2)}px`);
  }
}

// The statuses of a tree: colour, frame, and a sign. A node that is idle again shows how it had ended.
export function statuses(svg, current, last) {
  const changed = current.map((status, index) => [part(svg, `t0n${index}`), status === 'idle' ? last[index] : status]).filter(([node, shown]) => node && node.dataset.status !== shown);
  for (const one of changed) one.push(one[0].firstElementChild.getBBox());  // before anything changes: it is laid out once
  for (const [node, shown, {x, y}] of changed) {
    node.dataset.status = shown;
    node.classList.remove(...Object.keys(SIGNS));
    node.querySelector('.sign')?.remove();
    if (!SIGNS[shown]) continue;
    node.classList.add(shown);
    node.append(svgElement('text', {class: 'sign', x: x - 4, y: y + 5}, SIGNS[shown]));
  }
}

// Trees: children beside each other in their order, each parent in the middle above its children (Reingold and Tilford 1981), or to the left of them.

const FONT = 13, LINE = 16, GAP = 14, LEVEL = 24;
export const LEAST = 12 / FONT;  // the scale at which labels of a tree have 12 pixels
const measure = document.createElement('canvas').getContext('2d');

function sizeOf(lines) {
  measure.font = `${FONT}px Helvetica, Arial, sans-serif`;
  return [Math.max(...lines.map((line) => measure.measureText(line).width)) + 22, LINE * lines.length + 10];
}

// Places for nodes {parent, size}, parents first: across and along the way from the root. There are at least gap pixels between siblings,
// and level pixels between parents and children.
export function placesOf(nodes, isRight, gap = GAP, level = LEVEL) {
  const [across, along] = isRight ? [1, 0] : [0, 1];
  const depth = [], levels = [], children = nodes.map(() => []);
  nodes.forEach(({parent, size}, index) => {
    depth[index] = parent === null ? 0 : depth[parent] + 1;
    levels[depth[index]] = Math.max(levels[depth[index]] ?? 0, size[along]);
    if (parent !== null) children[parent].push(index);
  });
  const centre = nodes.map(() => 0), contours = [];
  for (let index = nodes.length - 1; index >= 0; index--) {  // children first; a contour has the borders at each level, from its node's centre
    const low = [], high = [], at = [];
    for (const child of children[index]) {
      let shift = at.length ? -Infinity : 0;
      contours[child].low.forEach((border, row) => { if (row in high) shift = Math.max(shift, high[row] - border + gap); });
      at.push([child, shift]);
      contours[child].low.forEach((border, row) => { low[row] ??= border + shift; });
      contours[child].high.forEach((border, row) => { high[row] = border + shift; });
    }
    const middle = at.length ? (at[0][1] + at.at(-1)[1]) / 2 : 0, half = nodes[index].size[across] / 2;
    for (const [child, shift] of at) centre[child] = shift - middle;
    contours[index] = {low: [-half, ...low.map((one) => one - middle)], high: [half, ...high.map((one) => one - middle)]};
  }
  let place = 0;
  const starts = levels.map((size) => { const start = place; place += size + level; return start; });
  return nodes.map(({parent}, index) => {
    if (parent !== null) centre[index] += centre[parent];
    const far = starts[depth[index]] + levels[depth[index]] / 2;
    return isRight ? [far, centre[index]] : [centre[index], far];
  });
}

function shapeOf(kind, x, y, [width, height]) {
  const [w, h] = [width / 2, height / 2];
  if (kind === 'Condition') return svgElement('ellipse', {cx: x, cy: y, rx: w, ry: h});
  if (kind === 'Decorator') return svgElement('polygon', {points: `${x - w},${y} ${x - w + 8},${y - h} ${x + w - 8},${y - h} ${x + w},${y} ${x + w - 8},${y + h} ${x - w + 8},${y + h}`});
  if (kind === 'SubTree') return svgElement('path', {d: `M${x - w},${y - h}h${width}v${height}h${-width}zm4,0v${height}m${width - 8},0v${-height}`});
  return kind === 'Control' ? svgElement('path', {d: `M${x - w},${y - h}h${width}v${height}h${-width}z`})
    : svgElement('path', {d: `M${x - w + 8},${y - h}h${width - 16}q8,0 8,8v${height - 16}q0,8 -8,8h${16 - width}q-8,0 -8,-8v${16 - height}q0,-8 8,-8z`});
}

// Draw a tree of nodes {lines, kind, parent} into an SVG: downward or to the right, with types or with names alone, the first that is readable in
// its pane, or the largest. What is below the nodes of folded is left out; fold(index) is called for a sub-tree that is pressed. Gives the extent.
export function drawTree(svg, nodes, folded, fold) {
  const outside = nodes.map(() => false), under = nodes.map(() => 0);
  nodes.forEach(({parent}, index) => { outside[index] = parent !== null && (outside[parent] || folded.has(parent)); });
  for (let index = nodes.length - 1; index > 0; index--) if (nodes[index].parent !== null) under[nodes[index].parent] += under[index] + 1;
  const shown = nodes.map((_, index) => index).filter((index) => !outside[index]), position = new Map(shown.map((index, at) => [index, at]));
  const drawn = shown.map((index) => {
    const {lines, kind, parent} = nodes[index], isFold = kind === 'SubTree' && under[index] > 0;
    const told = isFold ? [`${folded.has(index) ? `▸ ${under[index]} in` : '▾'} ${lines[0]}`, ...lines.slice(1)] : lines;
    return {index, kind, isFold, told, parent: parent === null ? null : position.get(parent)};
  });
  const forms = [Infinity, 1].map((most) => drawn.map((node) => ({...node, told: node.told.slice(0, most), size: sizeOf(node.told.slice(0, most))})));
  const layouts = forms.flatMap((form) => [[form, false], [form, true]]).map(([form, isRight]) => {
    const places = placesOf(form, isRight), box = {left: Infinity, top: Infinity, right: -Infinity, bottom: -Infinity};
    places.forEach(([x, y], at) => {
      const [w, h] = form[at].size;
      Object.assign(box, {left: Math.min(box.left, x - w / 2), right: Math.max(box.right, x + w / 2), top: Math.min(box.top, y - h / 2), bottom: Math.max(box.bottom, y + h / 2)});
    });
    const {clientWidth: width, clientHeight: height} = svg.parentElement;
    return {form, isRight, places, x: box.left - 12, y: box.top - 14, width: box.right - box.left + 24, height: box.bottom - box.top + 22,
      scale: Math.min(width / (box.right - box.left + 42), height / (box.bottom - box.top + 40))};
  });
  const best = layouts.find(({scale}) => scale >= LEAST) ?? layouts.reduce((a, b) => b.scale > a.scale ? b : a), {form, places, isRight} = best;
  const group = svgElement('g', {class: 'graph'});
  form.forEach(({parent, size}, at) => {
    if (parent === null) return;
    const [x, y] = places[at], [px, py] = places[parent], from = form[parent].size;
    const line = isRight ? `M${px + from[0] / 2},${py}H${x - size[0] / 2 - LEVEL / 2}V${y}H${x - size[0] / 2}` : `M${px},${py + from[1] / 2}V${y - size[1] / 2 - LEVEL / 2}H${x}V${y - size[1] / 2}`;
    group.append(svgElement('g', {class: 'branch', 'aria-hidden': 'true'}, svgElement('path', {d: line, fill: 'none'})));
  });
  form.forEach(({index, kind, isFold, told, size}, at) => {
    const [x, y] = places[at];
    const node = svgElement('g', {id: `t0n${index}`, class: `node ${kind}`}, shapeOf(kind, x, y, size),
      ...told.map((line, row) => svgElement('text', {x, y: y + LINE * (row - (told.length - 1) / 2) + 5, 'text-anchor': 'middle', 'font-size': FONT}, line)));
    press(node, `${folded.has(index) ? 'unfold' : 'fold'} ${nodes[index].lines[0]}`, isFold ? () => fold(index) : null);
    group.append(node);
  });
  svg.replaceChildren(group);
  return best;
}
