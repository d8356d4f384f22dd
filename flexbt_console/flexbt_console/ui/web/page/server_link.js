// SPDX-License-Identifier: BSD-3-Clause
// The connection to the server: opened again whenever it is lost, and taken for lost when it is silent.

const SILENT_MS = 3500;
const LONGEST_WAIT_MS = 5000;
const REFUSED_WAIT_MS = 1000;  // the server is there: what it waits for is shown soon when it comes

// What the browser remembers of the operator's page, if it does.
export const remembered = (key, usual) => { try { return JSON.parse(localStorage.getItem(`flexbt-${key}`)) ?? usual; } catch { return usual; } };
export const remember = (key, value) => { try { localStorage.setItem(`flexbt-${key}`, JSON.stringify(value)); } catch { /* not beyond this page then */ } };

// Who uses this browser is asked once; until then it has a name of its own, so that two browsers are two operators.
const guest = remembered('guest', `guest-${Math.random().toString(36).slice(2, 6)}`);
remember('guest', guest);
export const operator = () => remembered('operator', '') || guest;

export class ServerLink {
  // on.parts(parts), on.message(message), on.map(head, cells), on.state(isOpen, word, text): while it is not open, what
  // is wrong, in a word and in a line.
  // search() names the robot, path is that of the server's link for the page.
  constructor(on, search = () => location.search, path = 'link') {
    Object.assign(this, {on, search, path});
    this.wait = 250;
    this.socket = null;
    this.heard = 0;
    this.welcome = false;
    this.refused = null;
    setInterval(() => this.look(), 500);
    addEventListener('pagehide', () => { const before = this.socket; this.socket = null; before?.close(); });  // a page that the browser keeps for "back" is not at the robot
    addEventListener('pageshow', (event) => { if (event.persisted) this.open(); });
    this.open();
  }

  open() {
    clearTimeout(this.again);  // one connection, whoever opens it
    const address = new URL(this.path, location.href);
    address.protocol = location.protocol === 'https:' ? 'wss:' : 'ws:';
    address.search = this.search();
    address.hash = '';
    const socket = new WebSocket(address);
    socket.binaryType = 'arraybuffer';
    this.socket = socket;
    this.welcome = false;
    this.heard = performance.now();
    const token = new URLSearchParams(location.hash.slice(1)).get('token');
    socket.onopen = () => socket.send(JSON.stringify({hello: token, operator: operator()}));
    socket.onmessage = (event) => { if (this.socket === socket) this.take(event.data); };
    socket.onclose = (event) => { if (this.socket === socket) this.lost(event.reason); };
  }

  take(data) {
    this.heard = performance.now();
    if (data instanceof ArrayBuffer) {
      const length = new DataView(data).getUint32(0);
      const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
      this.on.map(head, new Uint8Array(data, 4 + length));
      return;
    }
    const message = JSON.parse(data);
    if (message.hello) {
      this.welcome = true;
      this.wait = 250;
      this.on.state(true, '', '');
    }
    if (message.refused) this.refused = message.refused;
    if (message.parts) this.on.parts(message.parts);
    else this.on.message(message);
  }

  // Begin again, as who uses the page now.
  renew() {
    const before = this.socket;
    this.open();
    before?.close();
  }

  close() {
    const before = this.socket;
    clearTimeout(this.again);
    this.socket = null;
    before?.close();
  }

  look() {
    if (this.socket && performance.now() - this.heard > SILENT_MS) {
      const silent = this.socket;
      this.lost('the server of this page is silent');
      silent.close();
    }
  }

  lost(reason) {
    this.socket = null;
    this.welcome = false;
    const {word, text} = this.refused ?? {word: 'NO SERVER', text: reason || 'the server of this page is gone'};
    this.on.state(false, word, text);
    this.again = setTimeout(() => this.open(), this.refused ? REFUSED_WAIT_MS : this.wait);
    this.refused = null;
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT_MS);
  }

  // Whether it went out.
  send(message) {
    if (!this.welcome || this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}
