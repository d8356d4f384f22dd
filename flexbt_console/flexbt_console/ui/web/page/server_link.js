// SPDX-License-Identifier: BSD-3-Clause
// Connections to the server, on both pages: opened again whenever they are lost.

const SILENT_MS = 3500, LOOK_MS = 500;  // of the operator's page; how often it is looked whether a server is silent
const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 5000;
const REFUSED_WAIT_MS = 1000;  // the server is there: what it waits for is shown soon when it comes
const FORBIDDEN_WAIT_MS = 20000;  // each wrong token, as of a server that was started again, makes all pages of this computer wait 2 s
const FORBIDDEN = 1008;  // policy violation

// What the browser remembers of both pages, if it does.
export const remembered = (key, usual) => { try { return JSON.parse(localStorage.getItem(`flexbt-${key}`)) ?? usual; } catch { return usual; } };
export const remember = (key, value) => { try { localStorage.setItem(`flexbt-${key}`, JSON.stringify(value)); } catch { /* not beyond this page then */ } };

// Who uses this browser is asked once; until then it has a name of its own, so that two browsers are two operators.
const guest = remembered('guest', `guest-${Math.random().toString(36).slice(2, 6)}`);
remember('guest', guest);
export const operator = () => remembered('operator', '') || guest;

// A connection to a WebSocket of the server at a path, until close(). Who extends it has take(data) and lost(reason), which may call
// retry(). hello() returns what goes with the token in the first message. It is taken for lost when nothing comes for silent ms.
export class Connection {
  constructor(path, search = () => '', hello = () => ({}), silent = Infinity) {
    Object.assign(this, {path, search, hello, silent, socket: null, wait: FIRST_WAIT_MS, heard: 0, looked: 0, stood: false, over: new AbortController()});
    const looking = silent < Infinity && setInterval(() => this.look(), LOOK_MS);
    this.over.signal.addEventListener('abort', () => clearInterval(looking));
    const on = (event, act) => addEventListener(event, act, {signal: this.over.signal});
    on('pagehide', () => this.drop());  // a page that the browser keeps for "back" is not connected
    on('pageshow', (event) => { if (event.persisted) this.open(); });
    on('hashchange', () => { if (this.again) this.open(); });  // another token may be right
  }

  open() {
    this.rest();  // one connection, whoever opens it
    this.heard = performance.now();
    const address = Object.assign(new URL(this.path, location.href), {protocol: location.protocol === 'https:' ? 'wss:' : 'ws:', search: this.search(), hash: ''});
    const socket = this.socket = new WebSocket(address), token = new URLSearchParams(location.hash.slice(1)).get('token');
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => { socket.send(JSON.stringify({hello: token, ...this.hello()})); this.opened?.(); };
    socket.onmessage = ({data}) => { if (this.socket === socket) { this.wait = FIRST_WAIT_MS; this.heard = performance.now(); this.take(data); } };
    socket.onclose = ({code, reason}) => {
      if (this.socket !== socket) return;
      if (code === FORBIDDEN) this.wait = FORBIDDEN_WAIT_MS;
      this.lost(reason);
    };
  }

  rest() { clearTimeout(this.again); this.again = null; }
  drop() { const before = this.socket; this.rest(); this.socket = null; before?.close(); }
  close() { this.over.abort(); this.drop(); }

  look() {
    const now = performance.now();
    this.stood = !this.stood && now - this.looked > this.silent;
    this.looked = now;
    if (this.stood) return;  // the page did not run: what came meanwhile is taken first
    if (this.socket && now - this.heard > this.silent) {
      const {socket} = this;
      this.lost('the server of this page is silent');
      socket.close();
    }
  }

  // Open it again after a while, which grows each time that nothing has come.
  retry(wait = this.wait) {
    this.socket = null;
    this.again = setTimeout(() => this.open(), wait);
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT_MS);
  }
}

// The frame and the cells of a map that came as a message.
export function mapOf(data) {
  const length = new DataView(data).getUint32(0);
  return [JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length))), new Uint8Array(data, 4 + length)];
}

// The link of the operator's page.
export class ServerLink extends Connection {
  // on.parts(parts), on.message(message), on.map(head, cells), on.state(isOpen, word, text): while it is not open, what
  // is wrong, in a word and in a line.
  // search() names the robot, path is that of the server's link for the page.
  constructor(on, search = () => location.search, path = 'link') {
    super(path, search, () => ({operator: operator()}), SILENT_MS);
    Object.assign(this, {on, welcome: false, refused: null});
    this.open();
  }

  open() {
    this.welcome = false;
    super.open();
  }

  take(data) {
    if (data instanceof ArrayBuffer) { this.on.map(...mapOf(data)); return; }
    const message = JSON.parse(data);
    if (message.hello) {
      this.welcome = true;
      this.on.state(true, '', '');
    }
    if (message.refused) this.refused = message.refused;
    if (message.parts) this.on.parts(message.parts);
    else this.on.message(message);
  }

  drop() {
    super.drop();
    this.on.state(false, 'CONNECTING', '');
  }

  // Begin again, as who uses the page now.
  renew() { this.drop(); this.open(); }

  lost(reason) {
    this.welcome = false;
    const {word, text} = this.refused ?? {word: 'NO SERVER', text: reason || 'the server of this page is gone'};
    this.on.state(false, word, text);
    this.retry(this.refused ? REFUSED_WAIT_MS : undefined);
    this.refused = null;
  }

  // Whether it went out.
  send(message) {
    if (!this.welcome || this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}
