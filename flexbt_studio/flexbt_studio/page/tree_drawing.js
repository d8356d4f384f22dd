// SPDX-License-Identifier: BSD-3-Clause
// Trees as a picture: each node above its children, which are in order from left to right and as near as they can be.

import {placesOf} from './drawing.js';
import {svg} from './elements.js';
import {BOLD, shortened, SMALL, widthOf} from './graph.js';

const HEIGHT = 44, ROW = 84, GAP = 18, TREE_GAP = 56;
const SIGNS = {Sequence: '→', ReactiveSequence: '⇒', SequenceWithMemory: '→', AsyncSequence: '→', Fallback: '?', ReactiveFallback: '⁇', AsyncFallback: '?', Parallel: '⇉', ParallelAll: '⇉', Inverter: '¬', SubTree: '▤', SubTreePlus: '▤'};

const ports = (node) => node.attributes.filter((one) => one.name !== 'name' && one.name !== 'ID').map((one) => `${one.name}=${one.value}`).join('  ');

function shape(kind, x, y, width) {
  const right = x + width, bottom = y + HEIGHT, middle = y + HEIGHT / 2, cut = 9;
  if (kind === 'decorator') return svg('path', {class: 'box', d: `M${x + cut} ${y}H${right - cut}L${right} ${middle}L${right - cut} ${bottom}H${x + cut}L${x} ${middle}Z`});
  return svg('rect', {class: 'box', x, y, width, height: HEIGHT, rx: {condition: HEIGHT / 2, control: 12, tree: 3, subtree: 2}[kind] ?? 4});
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
      const told = isTree ? one.detail : [isNamed ? one.type : kind, ports(one)].filter(Boolean).join(' · '), detail = shortened(told, 40);
      const count = isTree ? below.reduce((sum, node) => sum + 1 + hidden.get(node.path), 0) : hidden.get(one.path);
      const width = Math.max(72, Math.max(widthOf(title, BOLD), widthOf(detail, SMALL)) + (kind === 'decorator' || kind === 'condition' ? 34 : 22));
      const box = {one, kind, title, detail, told, width, isFolded, count, depth: parent ? parent.depth + 1 : 0, parent, index: boxes.length};
      boxes.push(box);
      if (!isFolded) for (const node of [...below].reverse()) waiting.push([node, box]);
    }
    const centres = placesOf(boxes.map(({parent, width}) => ({parent: parent && parent.index, size: [width, HEIGHT]})), false, GAP, ROW - HEIGHT).map(([x]) => x);
    const left = Math.min(...boxes.map((box, index) => centres[index] - box.width / 2));
    let depth = 0;
    for (const box of boxes) {
      box.left = centres[box.index] - box.width / 2 - left;
      const y = top + box.depth * ROW, {one, kind} = box, isTree = kind === 'tree';
      depth = Math.max(depth, box.depth);
      right = Math.max(right, box.left + box.width);
      const element = svg('g', {class: `node ${kind}${box.isFolded ? ' folded-node' : ''}`}, shape(kind, box.left, y, box.width),
        svg('text', {class: 'type', x: box.left + box.width / 2, y: y + 19, 'text-anchor': 'middle'}, box.title),
        svg('text', {class: 'detail', x: box.left + box.width / 2, y: y + 35, 'text-anchor': 'middle'}, ` ${box.detail}`));
      if (box.told !== box.detail) element.append(svg('title', {}, box.told));
      if (kind === 'subtree') element.append(svg('path', {class: 'double', d: `M${box.left + 4} ${y}V${y + HEIGHT}M${box.left + box.width - 4} ${y}V${y + HEIGHT}`}));
      if (one.comments?.length) element.append(svg('g', {class: 'note'}, svg('title', {}, one.comments.join('\n')), svg('path', {d: `M${box.left - 4} ${y - 6}h12v9h-7l-3 4v-4h-2z`})));
      if (box.isFolded) {
        const text = `+${box.count}`;
        element.append(svg('g', {class: 'fold-mark'}, svg('rect', {x: box.left + box.width / 2 - 18, y: y + HEIGHT - 2, width: 36, height: 18, rx: 9}), svg('text', {x: box.left + box.width / 2, y: y + HEIGHT + 11, 'text-anchor': 'middle'}, text)));
      }
      if (box.parent) {
        const from = box.parent.left + box.parent.width / 2, to = box.left + box.width / 2;
        box.parent.lines = `${box.parent.lines ?? ''}M${from} ${y - ROW + HEIGHT}C${from} ${y - 18} ${to} ${y - 22} ${to} ${y}`;
      }
      shapes.push(element);
      const name = isTree ? one.type : one.name && one.name !== one.type ? one.name : one.type;
      items.push({
        path: one.path, parent: isTree ? null : box.parent.one.path, level: box.depth + 1, name, span: one.span, open: one.open ?? one.span, element, box: [box.left, y, box.width, HEIGHT], isFolded: box.isFolded, count: box.count, node: isTree ? null : one, tree: isTree ? one : null,
        label: [one.type, isTree ? box.detail : one.kind || 'unknown', isTree ? '' : one.name, isTree ? '' : ports(one)].filter(Boolean).join(', '), note: one.comments.join(' '),
      });
    }
    // One line for each parent: the browser leaves out what is not in the pane.
    for (const box of boxes) if (box.lines) lines.push(svg('path', {class: 'edges', d: box.lines}));
    top += depth * ROW + HEIGHT + TREE_GAP;
  }
  return {items, parts: [...lines, ...shapes], box: {x: -6, y: -12, width: right + 18, height: Math.max(top - TREE_GAP, 1) + 34}};
}
