// SPDX-License-Identifier: BSD-3-Clause
// Elements of both pages, made in one expression: html('button', {type: 'button', onclick: run}, 'Run'). Attributes that are null,
// undefined or false are left out, and those that begin with "on" are listeners.

const NAMESPACE = 'http://www.w3.org/2000/svg';
// Signs that turn the direction of what follows: with them a name can be read as another one, so they are written out.
const TURNS = /[\u202a-\u202e\u2066-\u2069]/g;
const seen = (part) => typeof part === 'string' ? part.replace(TURNS, (sign) => `\\u{${sign.codePointAt(0).toString(16)}}`) : part;

function filled(made, attributes, parts) {
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith('on')) made.addEventListener(key.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) made.setAttribute(key, value === true ? '' : value);
  }
  made.append(...parts.map(seen));
  return made;
}
export const html = (name, attributes = {}, ...parts) => filled(document.createElement(name), attributes, parts);
export const svg = (name, attributes = {}, ...parts) => filled(document.createElementNS(NAMESPACE, name), attributes, parts);

// Put other parts into an element. If one of its buttons has the focus, that of this name gets it.
export function replace(root, ...parts) {
  const name = (one) => one.title || one.ariaLabel || one.textContent, focused = root.contains(document.activeElement) && document.activeElement.matches('button') ? name(document.activeElement) : null;
  root.replaceChildren(...parts);
  if (focused !== null) [...root.querySelectorAll('button')].find((one) => name(one) === focused)?.focus();
}

// A double click and a key that is held down press what a selector names once: it may mean something else when it has been pressed.
// tell(text, tone): who presses again on purpose, but soon, is told.
export function pressedOnce(selector, tell) {
  const once = (kind, isAgain) => document.addEventListener(kind, (event) => {
    if (!isAgain(event) || !event.target.closest?.(selector)) return;
    event.preventDefault();
    event.stopPropagation();
    if (kind === 'click') tell('A double click presses once: nothing was done at the second press. Press again if you mean it', 'warning');
  }, {capture: true});
  once('click', (event) => event.detail > 1);
  once('keydown', (event) => event.repeat && event.key === 'Enter');
}
export const byId = (id) => document.getElementById(id);
