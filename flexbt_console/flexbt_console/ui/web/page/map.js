// SPDX-License-Identifier: BSD-3-Clause
// The map: walls, places, obstacles, what the lidar meets, other robots, planned and driven path, goal, robot, and a cursor for the pose that is asked for.

import {element, plain} from './decision.js';
import {Connection, mapOf} from './server_link.js';

const TURN = Math.PI / 8;
const STEP_PX = 12;
const TRACE_STEP = 0.05;
const MOST_TRACE = 4000;
const STALE_MS = 5000;  // after which a costmap is told to be old
// Costmaps of navigation, by the names of their topics, and the colour of a cost: [red, green, blue, opacity].
const COSTMAPS = [['local_costmap', 'Local costmap'], ['global_costmap', 'Global costmap']];
const costColour = (cost) => (cost === 100 ? [214, 0, 148, 210] : cost === 99 ? [0, 172, 205, 190] : cost === 0 || cost > 100 ? [0, 0, 0, 0] : [40 + 2.1 * cost, 90 - 0.4 * cost, 230 - 2 * cost, 60 + cost]);

// The layers that a map may have: switches and a legend, and the connection by which costmaps come while one is on.
class Costmaps extends Connection {
  // path is that of the server's WebSocket for costmaps; changed() is called when another picture is to be drawn.
  constructor(path, changed) {
    super(path, () => location.search);
    Object.assign(this, {changed, shown: new Set(), images: new Map()});
    const swatch = (cost, text) => { const [red, green, blue] = costColour(cost), one = element('i', {}); one.style.background = `rgb(${red} ${green} ${blue})`; return element('span', {}, one, text); };
    this.told = element('span', {class: 'hint', role: 'status'});
    this.legend = element('span', {class: 'legend', hidden: true}, swatch(10, 'low cost'), swatch(90, 'high'), swatch(99, 'too near for the robot'), swatch(100, 'occupied'), this.told);
    const layer = ([name, title]) => element('label', {}, element('input', {type: 'checkbox', onchange: (event) => this.show(name, event.target.checked)}), ` ${title}`);
    this.controls = element('div', {class: 'layers', role: 'group', 'aria-label': 'layers of the map'}, ...COSTMAPS.map(layer), this.legend);
  }

  show(name, isOn) {
    if (isOn) this.shown.add(name); else { this.shown.delete(name); this.images.delete(name); }
    this.legend.hidden = !this.shown.size;
    if (!this.shown.size) this.drop();
    else if (!this.socket) this.open();
    else if (this.socket.readyState === WebSocket.OPEN) this.opened();
    this.tell();
    this.changed();
  }

  // Nothing is shown any more, or of another robot.
  leave() { this.drop(); this.images.clear(); this.changed(); }

  open() { if (this.shown.size) super.open(); }
  opened() { this.socket.send(JSON.stringify({show: [...this.shown]})); }
  lost() { this.images.clear(); this.tell(); this.changed(); this.retry(); }

  take(data) {
    const [head, cells] = mapOf(data);
    if (!this.shown.has(head.costmap)) return;
    this.images.set(head.costmap, {...head, at: performance.now(), image: painted(head, (cell) => costColour(cells[cell]))});
    clearTimeout(this.aging);
    this.aging = setTimeout(() => this.tell(), STALE_MS + 1);
    this.tell();
    this.changed();
  }

  tell() {
    const missing = COSTMAPS.filter(([name]) => this.shown.has(name) && !this.images.has(name)).map(([, title]) => title.toLowerCase());
    const old = COSTMAPS.filter(([name]) => performance.now() - this.images.get(name)?.at > STALE_MS).map(([, title]) => title.toLowerCase());
    this.told.textContent = missing.length ? `waiting for the ${missing.join(' and the ')}` : old.length ? `OLD: the ${old.join(' and the ')}` : '';
  }
}

// An image of a grid whose first row is the lowest; colour(cell) is [red, green, blue, opacity].
function painted({width, height}, colour) {
  const image = new OffscreenCanvas(width, height), context = image.getContext('2d'), pixels = context.createImageData(width, height);
  for (let row = 0; row < height; row++) for (let column = 0; column < width; column++) pixels.data.set(colour((height - 1 - row) * width + column), 4 * (row * width + column));
  context.putImageData(pixels, 0, 0);
  return image;
}

export class RobotMap {
  // on.pose(x, y, yaw), on.obstacle(x, y): what was pointed at; on.cursor(text): where the cursor is; on.leave(): nothing is pointed at any more;
  // on.costmaps: the path of the robot's costmaps at the server, if it has them. layers are the controls of those.
  constructor(canvas, hint, on) {
    Object.assign(this, {canvas, hint, on, map: null, image: null, plan: [], goal: null, driven: [], places: {}, obstacles: [], scan: [], others: [], pose: null});
    this.costmaps = new Costmaps(on.costmaps, () => this.redraw());
    this.layers = on.costmaps ? this.costmaps.controls : '';
    this.mode = '';          // '', 'pose' or 'obstacle'
    this.cursor = null;      // {x, y, yaw}
    this.planned = false;
    this.zoom = 1;           // against the scale at which all of it fits
    this.middle = null;      // what is in the middle of the canvas, m; null: of all of it
    new ResizeObserver(() => this.redraw()).observe(canvas);
    for (const query of ['(prefers-color-scheme: dark)', '(forced-colors: active)']) matchMedia(query).addEventListener('change', () => { this.paint(); this.redraw(); });
    canvas.addEventListener('pointerdown', (event) => this.press(event));
    canvas.addEventListener('pointermove', (event) => this.drag(event));
    canvas.addEventListener('pointerup', (event) => this.release(event));
    canvas.addEventListener('pointercancel', () => { this.grabbed = null; this.pressed = false; });
    canvas.addEventListener('wheel', (event) => {
      if (!event.ctrlKey && document.scrollingElement.scrollHeight > document.scrollingElement.clientHeight) return;  // it scrolls the page
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY * (event.deltaMode ? 16 : 1) / 400), event.offsetX, event.offsetY);
    }, {passive: false});
    canvas.addEventListener('keydown', (event) => this.key(event));
  }

  setMap(head, cells) {
    this.map = {...head, cells};
    this.paint();
    this.redraw();
  }

  setPose(pose) {
    this.pose = pose;
    const last = this.driven[this.driven.length - 1];
    if (pose && (!last || Math.hypot(last[0] - pose.x, last[1] - pose.y) >= TRACE_STEP)) {
      this.driven.push([pose.x, pose.y]);
      if (this.driven.length > MOST_TRACE) this.driven.shift();
    }
    this.redraw();
  }

  set(name, value) {
    this[name] = value;
    this.redraw();
  }

  setMode(mode) {
    if (this.mode === mode) return;
    this.mode = mode;
    this.canvas.classList.toggle('aims', mode !== '');
    this.canvas.setAttribute('role', mode ? 'application' : 'img');  // with keys of its own, or a picture
    const to = {pose: 'answer', obstacle: 'drop it there'}[mode];
    this.hint.textContent = mode ? `Click${mode === 'pose' ? ' (drag for the heading)' : ''}, or g: arrows move${mode === 'pose' ? ', < > turn' : ''}, Enter: ${to}, Esc leaves` : '';
    this.point(null);
  }

  // Put the cursor there, or take it away. Where it is, is also told as text.
  point(cursor) {
    this.cursor = cursor;
    const yaw = cursor && this.mode === 'pose' ? ` yaw ${Math.atan2(Math.sin(cursor.yaw), Math.cos(cursor.yaw)).toFixed(2)}` : '';
    const missing = cursor?.aimed === false ? ': move it first, then Enter' : '';
    this.on.cursor(cursor ? `cursor x ${cursor.x.toFixed(2)} y ${cursor.y.toFixed(2)}${yaw}${missing}` : '');
    this.redraw();
  }

  colour(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  }

  // The cells as an image, once for each map and colour scheme.
  paint() {
    if (!this.map) return;
    const {width, height, cells} = this.map;
    const probe = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
    const colours = ['--free', '--wall', '--unknown'].map((name) => {
      probe.fillStyle = this.colour(name);
      probe.fillRect(0, 0, 1, 1);
      return probe.getImageData(0, 0, 1, 1).data;
    });
    this.image = painted({width, height}, (cell) => colours[cells[cell]] || colours[2]);
  }

  hasContent() { return Boolean(this.map || this.pose || this.plan.length || this.scan.length || this.others.length || Object.keys(this.places).length); }

  bounds() {
    if (this.map) {
      const {x, y, width, height, resolution} = this.map;
      return [x, y, x + width * resolution, y + height * resolution];
    }
    const points = [...this.plan, ...this.driven, ...this.scan, ...Object.values(this.places), ...(this.pose ? [[this.pose.x, this.pose.y]] : [[0, 0]])];
    const xs = points.map((point) => point[0]), ys = points.map((point) => point[1]);
    return [Math.min(...xs) - 1, Math.min(...ys) - 1, Math.max(...xs) + 1, Math.max(...ys) + 1];
  }

  redraw() {
    if (this.planned) return;
    this.planned = true;
    requestAnimationFrame(() => { this.planned = false; this.draw(); });
  }

  draw() {
    const {canvas} = this;
    const ratio = devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const context = canvas.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const [x0, y0, x1, y1] = this.bounds();
    const scale = this.zoom * Math.min(width / (x1 - x0), height / (y1 - y0));
    const [cx, cy] = this.middle ?? [(x0 + x1) / 2, (y0 + y1) / 2];
    const left = width / 2 - (cx - x0) * scale, top = height / 2 - (y1 - cy) * scale;
    this.view = {scale, left, top, x0, y1};
    const at = ([x, y]) => [left + (x - x0) * scale, top + (y1 - y) * scale];
    if (this.image) {
      context.imageSmoothingEnabled = false;
      context.drawImage(this.image, left, top, (x1 - x0) * scale, (y1 - y0) * scale);
    }
    for (const [name] of COSTMAPS.toReversed()) {
      const costs = this.costmaps.images.get(name);
      if (!costs || this.isPast) continue;
      context.save();
      context.translate(...at([costs.x, costs.y]));
      context.rotate(-costs.yaw);
      context.scale(costs.resolution * scale, costs.resolution * scale);
      context.drawImage(costs.image, 0, -costs.height);
      context.restore();
    }
    const line = (points, colour, wide, dashes) => {
      if (points.length < 2) return;
      context.beginPath();
      points.forEach((point, index) => index ? context.lineTo(...at(point)) : context.moveTo(...at(point)));
      context.setLineDash(dashes);
      context.strokeStyle = colour;
      context.lineWidth = wide;
      context.stroke();
      context.setLineDash([]);
    };
    line(this.driven, this.colour('--driven'), 2, []);
    line(this.plan, this.colour('--plan'), 2.5, [7, 4]);
    context.font = '12px system-ui, sans-serif';
    const boxes = [];
    for (const [name, place] of Object.entries(this.places)) {
      const [x, y] = at(place);
      context.fillStyle = this.colour('--decision');
      context.beginPath();
      context.arc(x, y, 3, 0, 7);
      context.fill();
      this.label(context, plain(name.slice(0, 40)), x, y, width, boxes);
    }
    for (const [, x, y, radius] of this.obstacles) {
      context.fillStyle = this.colour('--warning');
      context.beginPath();
      context.arc(...at([x, y]), Math.max(3, radius * scale), 0, 7);
      context.fill();
    }
    context.fillStyle = this.colour('--scan');
    for (const point of this.scan) {
      const [x, y] = at(point);
      context.fillRect(x - 1.5, y - 1.5, 3, 3);
    }
    if (this.goal) {
      const [x, y] = at(this.goal);
      context.strokeStyle = this.colour('--plan');
      context.lineWidth = 2;
      for (const radius of [4, 8]) { context.beginPath(); context.arc(x, y, radius, 0, 7); context.stroke(); }
    }
    for (const {name, x, y, yaw, live} of this.others) {
      const where = at([x, y]);
      this.arrow(context, where, yaw, this.colour('--driven'), 9);
      context.fillStyle = this.colour('--driven');
      this.label(context, `${name.slice(0, 40)}${live ? '' : ' (old)'}`, ...where, width, boxes, 10);
    }
    if (this.pose) this.arrow(context, at([this.pose.x, this.pose.y]), this.pose.yaw, this.colour('--robot'), 11);
    if (this.cursor) {
      const where = at([this.cursor.x, this.cursor.y]);
      context.strokeStyle = context.fillStyle = this.colour('--accent');
      context.lineWidth = 2;
      context.beginPath();
      context.arc(...where, 12, 0, 7);
      context.stroke();
      if (this.mode === 'pose') this.arrow(context, where, this.cursor.yaw, this.colour('--accent'), 9);
    }
  }

  // A name beside what has it, so many pixels away, on the canvas, where it covers none of those before; nowhere if there is no such side.
  label(context, text, x, y, width, boxes, gap = 5) {
    const wide = context.measureText(text).width;
    const above = y + 1 - gap, below = y + 8 + gap;
    for (const [start, base] of [[x + gap, above], [x + gap, below], [x - gap - wide, above], [x - gap - wide, below]]) {
      const left = Math.max(3, Math.min(start, width - wide - 3));
      const box = {left, right: left + wide, top: base - 10, bottom: base + 3};
      if (boxes.some((one) => box.left < one.right && one.left < box.right && box.top < one.bottom && one.top < box.bottom)) continue;
      boxes.push(box);
      context.strokeStyle = this.colour('--free');  // also over a wall it is read
      context.lineWidth = 3;
      context.strokeText(text, left, base);
      context.fillText(text, left, base);
      return;
    }
  }

  arrow(context, [x, y], yaw, colour, size) {
    context.save();
    context.translate(x, y);
    context.rotate(-yaw);
    context.fillStyle = colour;
    context.beginPath();
    context.moveTo(size, 0);
    context.lineTo(-0.7 * size, 0.7 * size);
    context.lineTo(-0.35 * size, 0);
    context.lineTo(-0.7 * size, -0.7 * size);
    context.fill();
    context.restore();
  }

  // Zoom with the world point at a place of the canvas kept where it is; 0 fits all of it.
  zoomBy(by, px = this.canvas.clientWidth / 2, py = this.canvas.clientHeight / 2) {
    if (!this.view) return;
    const to = Math.min(Math.max(by * this.zoom, 1), 40), kept = this.world({offsetX: px, offsetY: py});
    const scale = this.view.scale * to / this.zoom;
    this.zoom = to;
    this.middle = to === 1 ? null : [kept[0] + (this.canvas.clientWidth / 2 - px) / scale, kept[1] - (this.canvas.clientHeight / 2 - py) / scale];
    this.draw();
  }

  world(event) {
    const {scale, left, top, x0, y1} = this.view;
    return [x0 + (event.offsetX - left) / scale, y1 - (event.offsetY - top) / scale];
  }

  press(event) {
    if (!this.view || event.button) return;
    if (!event.isPrimary) {  // two fingers point at nothing
      this.grabbed = null;
      this.pressed = false;
      this.point(null);
      return;
    }
    if (!this.mode && this.zoom > 1) this.grabbed = this.world(event);
    if (this.grabbed) this.canvas.setPointerCapture(event.pointerId);
    if (!this.mode) return;
    const [x, y] = this.world(event);
    this.point({x, y, yaw: this.pose ? Math.atan2(y - this.pose.y, x - this.pose.x) : 0});
    this.pressed = true;
    this.canvas.setPointerCapture(event.pointerId);
  }

  drag(event) {
    if (this.grabbed) {
      const [x, y] = this.world(event), {scale, left, top, x0, y1} = this.view;
      const {clientWidth: width, clientHeight: height} = this.canvas;
      this.middle = [x0 + (width / 2 - left) / scale + this.grabbed[0] - x, y1 - (height / 2 - top) / scale + this.grabbed[1] - y];
      this.draw();
    }
    if (!this.pressed || this.mode !== 'pose' || !this.cursor) return;
    const [x, y] = this.world(event), from = this.cursor;
    if (Math.hypot(x - from.x, y - from.y) * this.view.scale > 10) this.point({...from, yaw: Math.atan2(y - from.y, x - from.x)});
  }

  release() {
    this.grabbed = null;
    if (!this.pressed) return;
    this.pressed = false;
    this.send();
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const by = {'+': 1.25, '=': 1.25, '-': 0.8, 0: 0}[event.key];
    if (by !== undefined) {
      this.zoomBy(by);
      event.preventDefault();
      event.stopPropagation();
    }
    if (by !== undefined || !this.mode) return;
    const step = STEP_PX / (this.view?.scale || 40);
    const move = {ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step]}[event.key] ?? [0, 0];
    const turn = {'<': TURN, '>': -TURN}[event.key] ?? 0;
    if (event.key === 'Enter' && this.cursor?.aimed) this.send();
    else if (event.key === 'Escape') this.leave();
    else if (move[0] || move[1] || turn || event.key === 'Enter') {  // Enter sends no cursor that was neither moved nor turned
      const {x, y, yaw, aimed} = this.cursor ?? this.pose ?? {x: 0, y: 0, yaw: 0};
      this.point({x: x + move[0], y: y + move[1], yaw: yaw + turn, aimed: aimed || event.key !== 'Enter'});
    } else return;
    event.preventDefault();
    event.stopPropagation();
  }

  leave() {
    this.point(null);
    this.canvas.blur();
    this.on.leave();
  }

  send() {
    if (!this.cursor) return;
    const {x, y, yaw} = this.cursor;
    if (this.mode === 'pose') this.on.pose(x, y, yaw);
    else if (this.mode === 'obstacle') this.on.obstacle(x, y);
    this.point(null);
  }
}
