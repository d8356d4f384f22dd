// SPDX-License-Identifier: BSD-3-Clause
// Pan and zoom of an SVG that fills its pane: wheel, pinch, drag, buttons, and keys + - 0 and arrows while the pane has the focus.

import {html} from './elements.js';

const ZOOM = 1.25;
const PAN = 60;         // pixels for an arrow key
const SLOP = 4;         // pixels that a pointer moves before it drags: less is a click
const MOST = 5;
const MOST_FIT = 1.4;
const MARGIN = 8;       // pixels around a drawing that fits

// Returns {content(box), fit(whole), zoomTo(scale, x, y), reveal(element), scale, moved}. content gives the extent of what
// is drawn. Until somebody moves the view, it fits the drawing and follows what is revealed; fit() goes back to that.
// changed() is called after each change. In the style of the SVG --grow is how much larger than drawn labels are to be, to keep
// their size on the screen; it is at most grows. Where that is much, the SVG has the class "far".
export function viewport(svg, {grows = 1, changed = () => {}} = {}) {
  const pane = svg.parentElement;
  const pointers = new Map();
  let box = {x: 0, y: 0, width: 1, height: 1}, target = null;
  let scale = 1, x = 0, y = 0, moved = false, dragged = false, pinched = 0;

  const edges = () => svg.getBoundingClientRect();  // other things may be beside it in the pane
  const size = () => { const {width, height} = edges(); return [width || 1, height || 1]; };
  const within = (value, low, high) => Math.min(Math.max(value, low), high);

  function apply() {
    const [width, height] = size();
    const least = Math.min(1 / grows, width / box.width, height / box.height) / 1.5;
    scale = within(scale, least, MOST);
    x = within(x, box.x - (width - 40) / scale, box.x + box.width - 40 / scale);  // some of it stays in the pane
    y = within(y, box.y - (height - 40) / scale, box.y + box.height - 40 / scale);
    const grow = within(1 / scale, 1, grows);
    svg.setAttribute('viewBox', `${x} ${y} ${width / scale} ${height / scale}`);
    svg.style.setProperty('--grow', grow);
    svg.classList.toggle('far', grow > 1.15);
    changed();
  }

  // Where something is, in the units of the drawing, which is in the pane as it was before that changed its size; null if it is not shown.
  function placeOf(element) {
    const drawn = svg.getScreenCTM(), {left, right, top, bottom} = element.getBoundingClientRect();
    return drawn && {left: (left - drawn.e) / drawn.a, right: (right - drawn.e) / drawn.a, top: (top - drawn.f) / drawn.d, bottom: (bottom - drawn.f) / drawn.d};
  }

  // All of it, as large as it fits, but with readable labels; what does not fit then is where the target is. whole: all of it in any case.
  function fit(whole = false) {
    const [width, height] = size();
    moved = whole;
    const place = target?.isConnected ? placeOf(target) : null;
    scale = within(Math.min((width - 2 * MARGIN) / box.width, (height - 2 * MARGIN) / box.height), whole ? 0 : 1 / grows, MOST_FIT);
    const at = (start, length, room, from, to) => {
      const middle = length * scale + 2 * MARGIN <= room || !place ? start + length / 2 : (from + to) / 2;
      const begin = middle - room / scale / 2;
      return length * scale + 2 * MARGIN <= room ? begin : within(begin, start - MARGIN / scale, start + length - (room - MARGIN) / scale);
    };
    x = at(box.x, box.width, width, place?.left, place?.right);
    y = at(box.y, box.height, height, place?.top, place?.bottom);
    apply();
  }

  // To a scale, with the point (pixels in the pane; by default its middle) kept where it is.
  function zoomTo(to, px = size()[0] / 2, py = size()[1] / 2) {
    const [ux, uy] = [x + px / scale, y + py / scale];
    moved = true;
    scale = to;
    apply();
    [x, y] = [ux - px / scale, uy - py / scale];
    apply();
  }

  function panBy(dx, dy) {
    moved = true;
    [x, y] = [x - dx / scale, y - dy / scale];
    apply();
  }

  // Keep an element in the pane, unless somebody looks elsewhere.
  function reveal(element) {
    target = element;
    const place = moved || !element ? null : placeOf(element);
    if (!place) return;
    const {left, right, top, bottom} = place, [width, height] = size();
    if (left < x || top < y || right > x + width / scale || bottom > y + height / scale) fit();
  }

  pane.addEventListener('wheel', (event) => {
    const page = document.scrollingElement;
    if (!event.ctrlKey && page.scrollHeight > page.clientHeight) return;  // it scrolls the page
    event.preventDefault();
    const outer = edges();
    if (event.shiftKey) panBy(-event.deltaY - event.deltaX, 0);
    else zoomTo(scale * Math.exp(-event.deltaY * (event.deltaMode ? 16 : 1) / 400), event.clientX - outer.left, event.clientY - outer.top);
  }, {passive: false});
  svg.addEventListener('pointerdown', (event) => {
    if (event.button) return;
    if (event.isPrimary) pointers.clear();  // the end of one that left the diagram at once was not seen
    pointers.set(event.pointerId, event);
    dragged = pointers.size > 1;
    if (pointers.size === 2) pinched = scale / spread();
  });
  const spread = () => { const [a, b] = [...pointers.values()]; return Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY) || 1; };
  svg.addEventListener('pointermove', (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
    if (!dragged && Math.hypot(dx, dy) < SLOP) return;
    if (!svg.hasPointerCapture(event.pointerId)) svg.setPointerCapture(event.pointerId);
    dragged = true;
    pointers.set(event.pointerId, event);
    if (pointers.size === 1) panBy(dx, dy);
    else {
      const [a, b] = [...pointers.values()], outer = edges();
      panBy(dx / 2, dy / 2);
      zoomTo(pinched * spread(), (a.clientX + b.clientX) / 2 - outer.left, (a.clientY + b.clientY) / 2 - outer.top);
    }
  });
  for (const kind of ['pointerup', 'pointercancel']) svg.addEventListener(kind, (event) => pointers.delete(event.pointerId));
  svg.addEventListener('click', (event) => { if (dragged) event.stopPropagation(); dragged = false; }, {capture: true});
  pane.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest('input, select')) return;
    const act = {
      '+': () => zoomTo(scale * ZOOM), '=': () => zoomTo(scale * ZOOM), '-': () => zoomTo(scale / ZOOM), 0: () => fit(!moved),
      ArrowLeft: () => panBy(PAN, 0), ArrowRight: () => panBy(-PAN, 0), ArrowUp: () => panBy(0, PAN), ArrowDown: () => panBy(0, -PAN),
    }[event.key];
    if (!act) return;
    event.preventDefault();
    event.stopPropagation();
    act();
  });
  const button = (mark, title, act) => html('button', {type: 'button', title, 'aria-label': title, onclick: act}, mark);
  pane.append(html('div', {class: 'zoom seg'}, button('−', 'Zoom out (-)', () => zoomTo(scale / ZOOM)), button('⊡', 'Fit; again: all of it (0)', () => fit(!moved)), button('+', 'Zoom in (+)', () => zoomTo(scale * ZOOM))));
  new ResizeObserver(() => { if (moved) apply(); else fit(); }).observe(svg);
  return {
    content(extent) { box = {...extent, width: extent.width || 1, height: extent.height || 1}; if (moved) apply(); else fit(); },
    fit, zoomTo, reveal,
    get scale() { return scale; },
    get moved() { return moved; },
  };
}
