// SPDX-License-Identifier: BSD-3-Clause
// The map beside the graph: of the simulated robot, or of a moment of a recording.

import {byId, html} from './elements.js';
import {RobotMap} from './map.js';

const ON_MAP = ['plan', 'scan', 'places', 'obstacles', 'driven'];

export class MapPane {
  // word says what is shown; on is as of RobotMap, and more is shown above the map.
  constructor(id, word, on = {}, ...more) {
    const canvas = html('canvas', {id: `${id}-map`, class: 'beside-map', tabindex: '0', role: 'img', 'aria-label': `map: ${word.toLowerCase()}`}), hint = html('span', {class: 'hint'}), cursor = html('span', {class: 'hint', role: 'status'});
    this.map = new RobotMap(canvas, hint, {pose: () => {}, obstacle: () => {}, leave: () => {}, cursor: (text) => { cursor.textContent = text; }, ...on});
    this.element = html('aside', {id: `${id}-view`, class: 'beside', 'aria-label': word.toLowerCase(), hidden: true}, html('p', {class: 'beside-head'}, html('strong', {class: 'badge warning'}, word), cursor, hint), ...more, this.map.layers, canvas);
    byId('graph-body').append(this.element);
  }

  set isShown(isShown) { this.element.hidden = !isShown; }

  clear() { Object.assign(this.map, {driven: [], scan: [], plan: [], goal: null, pose: null, map: null, image: null}); }

  // Parts as the operator's page gets them.
  show(parts) {
    for (const name of ON_MAP) if (name in parts) this.map.set(name, parts[name]);
    if ('plan' in parts) this.map.set('goal', parts.plan.at(-1) ?? null);
    if ('pose' in parts) this.map.setPose(parts.pose);
  }
}
