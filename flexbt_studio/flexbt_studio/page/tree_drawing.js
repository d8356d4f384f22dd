// SPDX-License-Identifier: BSD-3-Clause
// Trees as a picture: each node above its children, which are in order from left to right and as near as they can be.

import {placesOf} from './drawing.js';
import {svg} from './elements.js';
import {BOLD, shortened, SMALL, widthOf} from './graph.js';

const HEIGHT = 44, LINE = 16, GAP = 18, LEVEL = 38, TREE_GAP = 56;
const SIGNS = {Sequence: '→', ReactiveSequence: '⇒', SequenceWithMemory: '→', AsyncSequence: '→', Fallback: '?', ReactiveFallback: '⁇', AsyncFallback: '?', Parallel: '⇉', ParallelAll: '⇉', Inverter: '¬', SubTree: '▤', SubTreePlus: '▤'};

const SHAPED = new Set(['action', 'condition', 'control', 'decorator']);  // the frame tells it as well

const ports = (node) => node.attributes.filter((one) => one.name !== 'name' && one.name !== 'ID').map((one) => `${one.name}=${one.value}`);

function shape(kind, x, y, width, height) {
  const right = x + width, bottom = y + height, middle = y + height / 2, cut = 9;
  if (kind === 'decorator') return svg('path', {class: 'box', d: `M${x + cut} ${y}H${right - cut}L${right} ${middle}L${right - cut} ${bottom}H${x + cut}L${x} ${middle}Z`});
  return svg('rect', {class: 'box', x, y, width, height, rx: {condition: HEIGHT / 2, control: 12, tree: 3, subtree: 2}[kind] ?? 4});
}

// The items, the elements and the extent of a view. folded has the paths whose children are not shown.
export function drawTrees(view, folded) {
  const children = new Map(), hidden = new Map(), items = [], lines = [], shapes = [];
  const roots = new Map(view.trees.map((tree) => [tree.path, []]));
  for (const node of view.nodes) {
    const list = node.parent === null ? roots.get(node.tree) : children.get(node.parent);
    if (list) list.push(node);
    children.set(node.path, []);
  }
  for (const node of [...view.nodes].reverse()) hidden.set(node.path, children.get(node.path).reduce((sum, one) => sum + 1 + hidden.get(one.path), 0));
  let top = 0, right = 0;

  for (const tree of view.trees) {
    const below = roots.get(tree.path);
    const root = {path: tree.path, parent: null, kind: 'tree', type: tree.id || 'tree without ID', detail: tree.id && tree.id === view.main ? 'main tree' : 'tree', span: tree.span, level: 1, below, name: tree.id, comments: tree.comments};
    const boxes = [];
    const waiting = [[root, null]];
    while (waiting.length) {  // parents first, children in order
      const [one, parent] = waiting.pop();
      const isFolded = folded.has(one.path), below = one.below ?? children.get(one.path);
      const kind = one.kind || 'unknown', isTree = kind === 'tree';
      const sign = SIGNS[one.tag] ?? '', isNamed = !isTree && one.name && one.name !== one.type;
      const title = shortened(`${sign} ${isNamed ? one.name : one.type}`.trim(), 34);
      const told = isTree ? [one.detail] : [isNamed ? one.type : SHAPED.has(kind) && ports(one).length ? '' : kind, ...ports(one)].filter(Boolean), details = told.map((line) => shortened(line, 40));
      const count = isTree ? below.reduce((sum, node) => sum + 1 + hidden.get(node.path), 0) : hidden.get(one.path);
      const width = Math.max(72, Math.max(widthOf(title, BOLD), ...details.map((line) => widthOf(line, SMALL))) + (kind === 'decorator' || kind === 'condition' ? 34 : 22));
      const box = {one, kind, title, details, told, width, height: HEIGHT + LINE * (details.length - 1), isFolded, count, depth: parent ? parent.depth + 1 : 0, parent, index: boxes.length};
      boxes.push(box);
      if (!isFolded) for (const node of [...below].reverse()) waiting.push([node, box]);
    }
    const places = placesOf(boxes.map(({parent, width, height}) => ({parent: parent && parent.index, size: [width, height]})), false, GAP, LEVEL);
    const left = Math.min(...boxes.map((box, index) => places[index][0] - box.width / 2)), tops = [];
    for (const box of boxes) tops[box.depth] = Math.min(tops[box.depth] ?? Infinity, top + places[box.index][1] - box.height / 2);  // that of the highest one
    let bottom = top;
    for (const box of boxes) {
      box.left = places[box.index][0] - box.width / 2 - left;
      const y = tops[box.depth], {one, kind, height} = box, isTree = kind === 'tree';
      box.bottom = y + height;
      bottom = Math.max(bottom, box.bottom);
      right = Math.max(right, box.left + box.width);
      const element = svg('g', {class: `node ${kind}${box.isFolded ? ' folded-node' : ''}`}, shape(kind, box.left, y, box.width, height),
        svg('text', {class: 'type', x: box.left + box.width / 2, y: y + 19, 'text-anchor': 'middle'}, box.title),
        ...box.details.map((line, row) => svg('text', {class: 'detail', x: box.left + box.width / 2, y: y + 35 + LINE * row, 'text-anchor': 'middle'}, ` ${line}`)));
      if (box.told.join() !== box.details.join()) element.append(svg('title', {}, box.told.join('\n')));
      if (kind === 'subtree') element.append(svg('path', {class: 'double', d: `M${box.left + 4} ${y}v${height}M${box.left + box.width - 4} ${y}v${height}`}));
      if (one.comments?.length) element.append(svg('g', {class: 'note'}, svg('title', {}, one.comments.join('\n')), svg('path', {d: `M${box.left - 4} ${y - 6}h12v9h-7l-3 4v-4h-2z`})));
      if (box.isFolded) {
        const text = `+${box.count}`;
        element.append(svg('g', {class: 'fold-mark'}, svg('rect', {x: box.left + box.width / 2 - 18, y: box.bottom - 2, width: 36, height: 18, rx: 9}), svg('text', {x: box.left + box.width / 2, y: box.bottom + 11, 'text-anchor': 'middle'}, text)));
      }
      if (box.parent) {
        const from = box.parent.left + box.parent.width / 2, to = box.left + box.width / 2;
        box.parent.lines = `${box.parent.lines ?? ''}M${from} ${box.parent.bottom}V${y - LEVEL}C${from} ${y - 16} ${to} ${y - 20} ${to} ${y}`;
      }
      shapes.push(element);
      const name = isTree ? one.type : one.name && one.name !== one.type ? one.name : one.type;
      items.push({
        path: one.path, parent: isTree ? null : box.parent.one.path, level: box.depth + 1, name, span: one.span, open: one.open ?? one.span, element, box: [box.left, y, box.width, height], isFolded: box.isFolded, count: box.count, node: isTree ? null : one, tree: isTree ? one : null,
        label: [name, ...box.told, isTree || box.told.includes(kind) ? '' : kind].filter(Boolean).join(', '), note: one.comments.join(' '),
      });
    }
    // One line for each parent: the browser leaves out what is not in the pane.
    for (const box of boxes) if (box.lines) lines.push(svg('path', {class: 'edges', d: box.lines}));
    top = bottom + TREE_GAP;
  }
  return {items, parts: [...lines, ...shapes], box: {x: -6, y: -12, width: right + 18, height: Math.max(top - TREE_GAP, 1) + 34}};
}
