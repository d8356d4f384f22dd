// SPDX-License-Identifier: BSD-3-Clause
// Elements of both pages, made in one expression: html('button', {type: 'button', onclick: run}, 'Run'). Attributes that are null,
// undefined or false are left out, and those that begin with "on" are listeners.

const NAMESPACE = 'http://www.w3.org/2000/svg';

function filled(made, attributes, parts) {
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith('on')) made.addEventListener(key.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) made.setAttribute(key, value === true ? '' : value);
  }
  made.append(...parts);
  return made;
}
export const html = (name, attributes = {}, ...parts) => filled(document.createElement(name), attributes, parts);
export const svg = (name, attributes = {}, ...parts) => filled(document.createElementNS(NAMESPACE, name), attributes, parts);
export const byId = (id) => document.getElementById(id);
