// SPDX-License-Identifier: Apache-2.0
// The state as the monitor has it: the whole on connecting, then changes.
// What is shown is that, or a moment of the past.
import { whyNoSocket } from "./answers.js";
import { of } from "./names.js";

const FIRST_RETRY = 250; // ms
const LAST_RETRY = 3000;
const STALLED = 2000; // ms without a message, after which nothing that is shown counts as true
const ABANDONED = 6000; // ms without a message, after which a connection is given up
const LOOK = 250; // ms between two looks at the last message

function put(object, key, value) {
  // A fact may be called __proto__; as a plain assignment that would not be a key.
  if (key === "__proto__") {
    Object.defineProperty(object, key, { value, writable: true, enumerable: true, configurable: true });
  } else {
    object[key] = value;
  }
}

export function applyChange(state, change) {
  const [path] = change;
  let parent = state;
  for (const part of path.slice(0, -1)) {
    const child = of(parent, part);
    if (!child || typeof child !== "object" || Array.isArray(child)) {
      put(parent, part, {}); // also for what is gone: it may have been all its parent was made for
    }
    parent = parent[part];
  }
  const last = path[path.length - 1];
  if (change.length === 1) delete parent[last];
  else put(parent, last, change[1]);
}

export class Store {
  constructor() {
    this.live = {}; // the present
    this.state = this.live; // what is shown
    this.past = false; // whether that is a moment of the past
    this.liveViews = [];
    this.afterRender = () => {};
    this.version = 0;
    this.connected = false;
    this.refused = ""; // why there is no connection
    this.suspected = ""; // the same, said once: a monitor that begins may have said it
    this.socket = null;
    this.heard = performance.now(); // when the last message came, or the connection was begun
    this.heardAt = null; // the same as a date, of the last message
    this.views = new Map(); // section → functions
    this.watchers = [];
    this.dirty = new Set();
    this.retry = FIRST_RETRY;
    this.frame = 0;
    this.held = 0; // timer, while nothing is drawn
  }

  // Calls view(section, state) once per frame in which the section changed.
  view(section, call) {
    if (!this.views.has(section)) this.views.set(section, []);
    this.views.get(section).push(call);
    if (this.version) this.refresh(section); // a panel that is loaded late is drawn at once
  }

  // Calls watch(change) for every single change of a section, at once; watch(null) when all is new.
  watch(section, call) {
    this.watchers.push([section, call]);
    if (this.version) call(null);
  }

  // Calls view(live) once per frame in which the present changed, whatever is shown.
  viewLive(call) {
    this.liveViews.push(call);
    if (this.version) this.refresh("");
  }

  showPast(state) {
    this.past = true;
    this.show(state);
  }

  // A later moment of the past.
  changePast(changes) {
    for (const change of changes) this.change(change);
    this.schedule();
  }

  showLive() {
    this.past = false;
    this.show(this.live);
  }

  show(state) {
    this.state = state;
    if (this.past) state.history = this.live.history; // all events, also the later ones
    for (const section of this.views.keys()) this.dirty.add(section);
    for (const [, watch] of this.watchers) watch(null);
    this.schedule();
  }

  change(change) {
    applyChange(this.state, change);
    const section = change[0][0];
    this.dirty.add(section);
    for (const [wanted, watch] of this.watchers) if (wanted === section) watch(change);
  }

  onConnection(call) {
    this.connectionChanged = call;
  }

  connect() {
    const address = new URL("live", document.baseURI);
    address.protocol = address.protocol.replace("http", "ws");
    const socket = new WebSocket(address);
    this.answered = false;
    this.socket = socket;
    this.heard = performance.now();
    socket.onmessage = (event) => this.receive(JSON.parse(event.data));
    socket.onclose = () => this.lost();
    if (!this.watchdog) this.watchdog = setInterval(() => this.look(), LOOK);
  }

  // A connection that is closed says so; one that stalls, or a monitor that hangs, does not.
  look() {
    const silence = performance.now() - this.heard;
    if (this.connected && silence > STALLED) this.told(false);
    if (this.socket && silence > ABANDONED) {
      this.socket.onmessage = this.socket.onclose = null; // its closing handshake would be waited for
      this.socket.close();
      this.lost();
    }
  }

  lost() {
    this.socket = null;
    this.told(false);
    if (!this.answered) this.askWhy();
    setTimeout(() => this.connect(), this.retry);
    this.retry = Math.min(LAST_RETRY, this.retry * 1.7);
  }

  async askWhy() {
    const reason = await whyNoSocket(ABANDONED);
    if (this.connected) return;
    this.refused = reason === this.suspected ? reason : "";
    this.suspected = reason;
    this.told(false);
  }

  receive(message) {
    this.answered = true;
    this.refused = this.suspected = "";
    this.heard = performance.now();
    this.heardAt = new Date();
    if (!this.connected) this.told(true);
    this.retry = FIRST_RETRY;
    if (message.version !== undefined) this.version = message.version;
    this.dirty.add("");
    if (message.state) {
      this.live = message.state;
      this.show(this.past ? this.state : this.live);
    } else if (this.past) {
      for (const change of message.changes) {
        applyChange(this.live, change);
        if (change[0][0] === "history") this.dirty.add("history");
      }
    } else {
      for (const change of message.changes) this.change(change);
    }
    this.schedule();
  }

  refresh(section) {
    this.dirty.add(section);
    this.schedule();
  }

  schedule() {
    if (!this.frame && !this.held) this.frame = requestAnimationFrame(() => this.render());
  }

  // Draws nothing for so many ms, or until the release.
  hold(longest) {
    this.release();
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.held = setTimeout(() => this.release(), longest);
  }

  release() {
    clearTimeout(this.held);
    this.held = 0;
    this.schedule();
  }

  render() {
    this.frame = 0;
    const dirty = [...this.dirty];
    this.dirty.clear();
    for (const section of dirty) {
      const calls = section ? this.views.get(section) : this.liveViews;
      for (const call of calls || []) {
        try {
          call(section ? of(this.state, section) || {} : this.live, this.state);
        } catch (error) {
          console.error(`${section} cannot be drawn`, error); // the other sections still can
        }
      }
    }
    this.afterRender();
    document.documentElement.dataset.version = String(this.version);
  }

  // Whether what is shown is the present, or a moment of the past, as it was.
  get alive() {
    return this.past || this.connected;
  }

  told(connected) {
    this.connected = connected;
    if (this.version) for (const section of ["", "now", "plan"]) this.refresh(section); // what they say depends on it
    if (this.connectionChanged) this.connectionChanged(connected);
  }
}
