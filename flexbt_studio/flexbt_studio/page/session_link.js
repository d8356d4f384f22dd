// SPDX-License-Identifier: BSD-3-Clause
// The connection to the server of the studio: requests with answers, events, and a new connection whenever it is lost.

import {Connection} from './server_link.js';

const SILENT_MS = 10000;
const MOST_BYTES = 8e6;  // of a request: at a longer one the server ends the connection

export class Refusal extends Error {
  // kind: gesture, conflict, refused, fault or busy as the server says, or lost: there is no connection.
  constructor({kind, message}) { super(message); this.kind = kind; }
}

export class SessionLink extends Connection {
  // on.event(event), on.state(isOpen, text).
  constructor(on) {
    super('session', undefined, undefined, SILENT_MS);
    Object.assign(this, {on, asked: new Map(), number: 0, isOpen: false});
    this.open();
  }

  take(data) {
    const message = JSON.parse(data);
    if (message.event === 'welcome') {
      this.isOpen = true;
      this.on.state(true, '');
    }
    if (message.event) { this.on.event(message); return; }
    const asked = this.asked.get(message.id);
    this.asked.delete(message.id);
    if (!asked) { if (message.error) this.on.event({event: 'note', message: message.error.message}); }
    else if (message.error) asked.refuse(new Refusal(message.error));
    else asked.answer(message.result);
  }

  drop() {
    super.drop();
    this.refuseAll('the page was left');
  }

  lost(reason) {
    this.refuseAll(reason || 'the studio does not answer');
    this.retry();
  }

  // What was asked gets no answer any more.
  refuseAll(text) {
    this.isOpen = false;
    const asked = [...this.asked.values()];
    this.asked.clear();
    this.on.state(false, text);
    for (const one of asked) one.refuse(new Refusal({kind: 'lost', message: text}));
  }

  request(method, args = {}) {
    if (!this.isOpen) return Promise.reject(new Refusal({kind: 'lost', message: 'not connected to the studio: this was not done; what you write in the text is sent when it is back'}));
    this.number += 1;
    const id = this.number, text = JSON.stringify({id, method, arguments: args});
    if (3 * text.length > MOST_BYTES && new Blob([text]).size > MOST_BYTES) return Promise.reject(new Refusal({kind: 'refused', message: `${args.file ?? method}: the studio takes at most ${MOST_BYTES / 1e6} MB at once; nothing of this was done`}));
    this.socket.send(text);
    return new Promise((answer, refuse) => this.asked.set(id, {answer, refuse}));
  }
}
