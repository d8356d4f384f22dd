// SPDX-License-Identifier: BSD-3-Clause
// The connection to the server of the studio: requests with answers, events, and a new connection whenever it is lost.

const LONGEST_WAIT_MS = 4000;

export class Refusal extends Error {
  // kind: gesture, conflict, refused, fault or busy as the server says, or lost: there is no connection.
  constructor({kind, message}) { super(message); this.kind = kind; }
}

export class SessionLink {
  // on.event(event), on.state(isOpen, text).
  constructor(on) {
    this.on = on;
    this.asked = new Map();
    this.number = 0;
    this.wait = 200;
    this.isOpen = false;
    this.open();
  }

  open() {
    const address = new URL('session', location.href);
    address.protocol = location.protocol === 'https:' ? 'wss:' : 'ws:';
    address.hash = '';
    const socket = this.socket = new WebSocket(address);
    socket.onopen = () => socket.send(JSON.stringify({hello: new URLSearchParams(location.hash.slice(1)).get('token')}));
    socket.onmessage = (message) => this.take(JSON.parse(message.data));
    socket.onclose = (event) => this.lost(event.reason);
  }

  take(message) {
    if (message.event === 'welcome') {
      this.isOpen = true;
      this.wait = 200;
      this.on.state(true, '');
    }
    if (message.event) { this.on.event(message); return; }
    const asked = this.asked.get(message.id);
    this.asked.delete(message.id);
    if (!asked) { if (message.error) this.on.event({event: 'note', message: message.error.message}); }
    else if (message.error) asked.refuse(new Refusal(message.error));
    else asked.answer(message.result);
  }

  lost(reason) {
    this.isOpen = false;
    const asked = [...this.asked.values()];
    this.asked.clear();
    const text = reason || 'the studio does not answer';
    this.on.state(false, text);
    for (const one of asked) one.refuse(new Refusal({kind: 'lost', message: text}));
    setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT_MS);
  }

  request(method, args = {}) {
    if (!this.isOpen) return Promise.reject(new Refusal({kind: 'lost', message: 'not connected to the studio; what you edit is sent when it is back'}));
    this.number += 1;
    const id = this.number;
    this.socket.send(JSON.stringify({id, method, arguments: args}));
    return new Promise((answer, refuse) => this.asked.set(id, {answer, refuse}));
  }
}
