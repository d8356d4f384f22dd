// SPDX-License-Identifier: BSD-3-Clause
// State machines as a picture, at the places of the server's layout: containers, states, outcomes, transitions.

import {svg} from './elements.js';
import {BOLD, SMALL, shortened, widthOf} from './graph.js';

const SIGNS = {machine: '▣', concurrency: '∥', priority: '‼', behavior: '▤', state: ''};
const WORDS = {machine: 'machine', concurrency: 'concurrency', priority: 'priority container', behavior: 'embedded behavior', state: 'state'};
const LEVELS = {off: '', low: 'low', high: 'high', full: 'full'};

// The path of the item of an outcome of a state.
export const outcomePath = (state, outcome) => `${state}#${outcome}`;

function curve(points) {
  const [first, ...rest] = points.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`);
  const steps = [];
  for (let at = 0; at + 2 < rest.length; at += 3) steps.push(rest[at] === rest[at + 2] ? `L${rest[at]}` : `C${rest.slice(at, at + 3).join(' ')}`);
  return `M${first}${steps.join('')}`;
}

export function drawMachine(view, layout, folded) {
  const items = [], backs = [], lines = [], fronts = [];
  const states = new Map(view.states.map((one) => [one.path, one]));
  const hidden = new Map();
  for (const one of [...view.states].reverse()) if (one.parent !== null) hidden.set(one.parent, (hidden.get(one.parent) ?? 0) + (hidden.get(one.path) ?? 0) + 1);
  const edges = new Map();
  for (const edge of layout.edges) {
    if (!edge.from) {
      const [x, y] = edge.points[0] ?? [0, 0];
      lines.push(svg('circle', {class: 'begin', cx: x, cy: y - 4, r: 5}), svg('path', {class: 'way', d: curve(edge.points), 'marker-end': 'url(#arrow)'}));
      continue;
    }
    edges.set(outcomePath(edge.from, edge.outcome), edge);
  }
  const level = (path) => { let count = 1; for (let one = states.get(path); one?.parent != null; one = states.get(one.parent)) count += 1; return count; };
  for (const one of view.states) {
    const place = layout.states[one.path];
    if (!place) continue;  // it is in a folded container
    const [x, y, width, height] = place, isContainer = !['state', 'behavior'].includes(one.kind), isFolded = folded.has(one.path) && isContainer;
    const isOpen = isContainer && !isFolded, sign = SIGNS[one.kind], name = one.label || view.behavior?.name || (one.parent === null ? 'machine' : '');
    const title = `${sign} ${shortened(name, 38)}${one.initial && isOpen ? ' (initial)' : ''}`.trim();
    const marks = [...one.wrappers.map((wrapper) => ({retry: '↻', timeout: '◷'})[wrapper.kind] ?? ''), one.locked ? 'locked' : ''].join(' ').trim();
    const element = svg('g', {class: `node ${isOpen ? 'container' : 'state'} ${one.kind}${one.locked ? ' locked' : ''}`}, svg('rect', {class: 'box', x, y, width, height, rx: isOpen ? 8 : 10}));
    if (one.kind === 'behavior' || (isContainer && isFolded)) element.append(svg('path', {class: 'double', d: `M${x + 4} ${y + 4}V${y + height - 4}M${x + width - 4} ${y + 4}V${y + height - 4}`}));
    if (isOpen) element.append(svg('text', {class: 'type', x: x + 12, y: y + 20}, title), svg('text', {class: 'detail', x: x + width - 10, y: y + 20, 'text-anchor': 'end'}, widthOf(title, BOLD) + widthOf(`${marks} ${WORDS[one.kind]}`, SMALL) + 30 > width ? marks : `${marks} ${WORDS[one.kind]}`));
    else {
      element.append(svg('text', {class: 'type', x: x + width / 2, y: y + 20, 'text-anchor': 'middle'}, title),
        svg('text', {class: 'detail', x: x + width / 2, y: y + 37, 'text-anchor': 'middle'}, shortened(`${marks} ${one.type || WORDS[one.kind]}`, 46)));
    }
    if (isFolded) element.append(svg('g', {class: 'fold-mark'}, svg('rect', {x: x + width / 2 - 18, y: y + height - 6, width: 36, height: 18, rx: 9}), svg('text', {x: x + width / 2, y: y + height + 7, 'text-anchor': 'middle'}, `+${hidden.get(one.path) ?? 0}`)));
    if (one.comments.length) element.append(svg('g', {class: 'note'}, svg('title', {}, one.comments.join('\n')), svg('path', {d: `M${x - 4} ${y - 6}h12v9h-7l-3 4v-4h-2z`})));
    if (one.locked) element.append(svg('title', {}, one.locked));
    (isOpen ? backs : fronts).push(element);
    const at = level(one.path);
    items.push({
      path: one.path, parent: one.parent, level: at, name, span: one.span, open: one.label_span, element, box: place, isFolded, count: isContainer ? (hidden.get(one.path) ?? 0) + one.transitions.length : one.transitions.length, state: one,
      label: `${name}, ${[one.type, WORDS[one.kind]].filter(Boolean).join(', ')}`, note: [one.initial ? 'initial' : '', one.locked ? `locked: ${one.locked}` : '', one.comments.join(' ')].filter(Boolean).join(', '),
    });
    for (const way of one.transitions) {
      const edge = edges.get(outcomePath(one.path, way.outcome)), needed = LEVELS[one.autonomy.find((entry) => entry.outcome === way.outcome)?.level] ?? '';
      const box = edge?.label ? [edge.label[0] - 3.6 * way.outcome.length - 4, edge.label[1] - 9, 7.2 * way.outcome.length + 8, 18] : [x + 8, y + height + 2, 8, 2];
      const mark = svg('g', {class: `way-mark ${needed}`}, svg('rect', {class: 'box', x: box[0], y: box[1], width: box[2], height: box[3], rx: 4}));
      if (edge?.label) mark.append(svg('text', {x: edge.label[0], y: edge.label[1] + 4, 'text-anchor': 'middle'}, way.outcome));
      if (edge) lines.push(svg('path', {class: `way ${needed}`, d: curve(edge.points), 'marker-end': 'url(#arrow)', 'data-way': outcomePath(one.path, way.outcome), 'data-from': one.path}));
      if (needed) mark.append(svg('title', {}, `asks the operator below autonomy ${needed}`));
      fronts.push(mark);
      items.push({
        path: outcomePath(one.path, way.outcome), parent: one.path, level: at + 1, name: way.outcome, span: way.span, open: way.span, element: mark, box, isFolded: false, count: 0, way, state: one,
        label: `outcome ${way.outcome} to ${way.target || 'no target'}${needed ? `, needs autonomy ${needed}` : ''}`,
      });
    }
    for (const [outcome, [left, top, wide, high]] of Object.entries(layout.ends[one.path] ?? {})) {
      lines.push(svg('g', {class: 'end', 'data-end': outcome, 'data-of': one.path}, svg('rect', {x: left, y: top, width: wide, height: high, rx: high / 2}), svg('text', {x: left + wide / 2, y: top + high / 2 + 4, 'text-anchor': 'middle'}, outcome)));
    }
  }
  const arrow = svg('defs', {}, svg('marker', {id: 'arrow', viewBox: '0 0 8 8', refX: 7, refY: 4, markerWidth: 10, markerHeight: 10, markerUnits: 'userSpaceOnUse', orient: 'auto'}, svg('path', {d: 'M0 0L8 4L0 8z'})));
  return {items, parts: [arrow, ...backs, ...lines, ...fronts], box: {x: -8, y: -12, width: layout.width + 16, height: layout.height + 24}};
}
