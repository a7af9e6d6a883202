// SPDX-License-Identifier: Apache-2.0
// Takes the page to any moment of the history and back, and says that it is not the present.
import { byId, clockText, el, setHidden, setText } from "./dom.js";
import { ask, momentLink, momentOf, Past } from "./past.js";
import { t, told } from "./texts.js";
import { newsText, truthOf } from "./truth.js";

const SPEEDS = [1, 2, 5, 10, 30, 60];
const AHEAD = 4; // s of playing for which the next segment is fetched early
const SLOWEST = 100; // ms that one picture stands for at the most: a slow browser plays slower, and skips nothing
const LOOK = 1000; // ms between two looks at how far a run has come
const MARKS = { failure: ["✕", "f", t("failure")], cancel: ["⊘", "c", t("cancel")], replan: ["↻", "r", t("replan")] };
const STEPS = ["mission", "goal", "plan", "action", "speech", "sight", "health", "guard", "control", "monitor"];

export class TimeBar {
  constructor(store) {
    this.store = store;
    this.past = new Past(store);
    this.runs = [];
    this.run = null; // that the bar shows
    this.event = null; // that was jumped to
    this.playing = 0; // speed
    this.wall = 0; // s since 1970, while playing
    this.turn = 0; // of the newest request
    this.build();
    document.addEventListener("keydown", (event) => this.key(event));
    // Not by the address: that may be the one of this moment already, or be written over by one that arrives.
    addEventListener("hashchange", (event) => this.follow(new URL(event.newURL).hash));
    document.addEventListener("click", (event) => {
      const link = event.target.closest('a[href^="#moment="]');
      if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
      event.preventDefault();
      this.follow(link.hash);
    });
    store.viewLive((live) => this.drawLive(live));
    store.afterRender = () => this.mark();
  }

  build() {
    const button = (id, text, title, call) => el("button", { id, title, "aria-label": title, onclick: call }, text);
    this.range = el("input", { id: "time-range", type: "range", min: 0, max: 1, step: "any", "aria-label": t("Moment"), oninput: () => this.slide() });
    this.speed = el("select", { id: "time-speed", "aria-label": t("Speed"), onchange: () => { if (this.playing) this.play(); } }, SPEEDS.map((speed) => el("option", { value: speed }, `×${speed}`)));
    byId("time-bar").append(
      button("time-play", "▶", t("Play or stop (k)"), () => this.toggle()), this.speed,
      button("time-back", "◂", t("The event before (,)"), () => this.step(true)),
      button("time-on", "▸", t("The next event (.)"), () => this.step(false)),
      ...Object.entries(MARKS).map(([mark, [glyph, key, word]]) => button(`time-${mark}`, [glyph, el("span", { class: "word" }, ` ${word}`)], t("The next {mark} ({key}); with Shift the one before", { mark: word, key }), (event) => this.jump(mark, event.shiftKey))),
      el("div", { id: "time-line" }, el("div", { id: "time-marks", "aria-hidden": "true" }), this.range),
      el("select", { id: "time-run", "aria-label": t("Run"), hidden: true, onchange: (event) => this.choose(Number(event.target.value)) }),
      el("span", { id: "time-said", role: "status" }),
      el("a", { id: "time-at", href: "#now", title: t("The address of this moment") }),
    );
    this.title = el("strong");
    this.text = el("span", { class: "event-text" });
    this.present = el("span", { class: "present" });
    byId("past-banner").append(
      this.title, this.text, this.present,
      el("button", { id: "time-live", onclick: () => this.live() }, t("Back to live (l)")));
  }

  get archive() {
    return (this.store.live.meta || {}).archive;
  }

  // --- where to

  async look() {
    this.runs = await ask("runs");
    this.drawRun(await ask("marks", { run: this.current() }));
  }

  current() {
    return this.run || (this.store.live.meta || {}).run || (this.runs[this.runs.length - 1] || {}).run || 0;
  }

  bounds() {
    return this.runs.find(({ run }) => run === this.current()) || { began: 0, ended: 1 };
  }

  // Shows a moment; the newest request wins.
  async go(run, wall, after = true, event = null) {
    const turn = ++this.turn;
    this.wanted = after && { wall, event };
    this.pause();
    try {
      if (!this.runs.some((known) => known.run === run)) this.runs = await ask("runs");
      if (!(await this.past.show(run, wall, after, () => turn === this.turn))) return;
      const other = this.run !== run;
      this.run = run;
      this.arrived(event);
      if (other) await this.look();
    } catch (error) {
      if (turn === this.turn) this.failed(error);
    }
  }

  arrived(event) {
    this.event = event;
    this.say("");
    document.body.dataset.time = "past";
    this.wall = this.past.wall;
    history.replaceState(null, "", momentLink(this.past));
    if (!this.looking) this.looking = setInterval(() => this.refresh(), LOOK);
    this.draw();
    if (!event) this.caption();
  }

  // The event that was the last one at this moment.
  async caption() {
    const { run, wall } = this.past;
    const kinds = STEPS.join(",");
    const event = await ask("event", { run, wall: wall + 1e-6, back: 1, kinds }).catch(() => null);
    if (this.store.past && this.past.segment && this.past.wall === wall && !this.event) {
      setText(this.text, event ? told(event) : "");
    }
  }

  live() {
    this.turn += 1;
    this.pause();
    if (this.archive || !this.store.past) return;
    clearInterval(this.looking);
    this.looking = 0;
    this.run = this.event = null;
    this.past.forget();
    delete document.body.dataset.time;
    history.replaceState(null, "", location.pathname + location.search);
    this.store.showLive();
    this.draw();
  }

  follow(hash = location.hash) {
    const moment = momentOf(hash);
    if (moment) this.go(moment.run, moment.wall);
  }

  // One place at a time: a slider that is dragged passes many.
  async slide() {
    this.slid = true;
    if (this.sliding) return;
    this.sliding = true;
    while (this.slid) {
      this.slid = false;
      const { began, ended } = this.bounds();
      await this.go(this.current(), began + Number(this.range.value) * (ended - began), false);
    }
    this.sliding = false;
  }

  choose(run) {
    const { began } = this.runs.find((known) => known.run === run);
    this.go(run, began);
  }

  step(back) {
    this.then(() => this.find(back, { kinds: STEPS.join(",") }, t("event")));
  }

  jump(mark, back) {
    this.then(() => this.find(back, { marks: mark }, MARKS[mark][2]));
  }

  // Two steps asked for at once are two steps.
  then(call) {
    this.steps = (this.steps || Promise.resolve()).then(call);
  }

  async find(back, wanted, word) {
    try {
      if (!this.runs.length) await this.look();
      const run = this.current();
      const wall = this.store.past ? this.past.wall : Number.MAX_SAFE_INTEGER;
      const found = await ask("event", { run, wall, id: this.event ? this.event.id : undefined, back: back ? 1 : undefined, ...wanted });
      if (!found) this.say(back ? t("There is no earlier {mark} in this run.", { mark: word }) : t("There is no later {mark} in this run.", { mark: word }));
      else await this.go(run, found.wall, true, found);
    } catch (error) {
      this.unanswered(error);
    }
  }

  // --- playing

  async toggle() {
    if (this.playing) {
      this.pause();
      this.arrived(null);
      return;
    }
    if (!this.runs.length) await this.look().catch(this.unanswered);
    if (!this.runs.length) return;
    const { began, ended } = this.bounds();
    if (!this.store.past || (this.past.wall >= ended - 0.01 && this.archive)) await this.go(this.current(), began);
    if (this.store.past) this.play();
  }

  play() {
    const starts = !this.playing;
    this.playing = Number(this.speed.value);
    this.event = null;
    if (starts) {
      this.ticked = performance.now();
      this.tick = requestAnimationFrame((now) => this.advance(now));
    }
    this.draw();
  }

  pause() {
    cancelAnimationFrame(this.tick);
    this.playing = 0;
    this.draw();
  }

  advance(now) {
    const run = this.run;
    const wall = this.wall + (this.playing * Math.min(SLOWEST, Math.max(0, now - this.ticked))) / 1000;
    this.ticked = now;
    const { ended } = this.bounds();
    // What is not here yet is waited for: the clock stands.
    if (this.past.showKnown(run, Math.min(wall, ended))) this.wall = Math.min(wall, ended);
    else this.past.fetch(run, wall).catch((error) => { this.pause(); this.failed(error); });
    const { next } = this.past.segment;
    if (next !== null && wall + AHEAD * this.playing > next && !this.past.known(run, next)) this.past.fetch(run, next).catch(() => {});
    this.draw();
    if (this.wall >= ended && (this.archive || run !== (this.store.live.meta || {}).run)) {
      this.pause();
      this.arrived(null);
      this.say(t("The end of this run."));
      return;
    }
    this.tick = requestAnimationFrame((next) => this.advance(next));
  }

  // --- what is seen

  // The end of a run that goes on moves, and new events come.
  async refresh() {
    if (!this.store.connected || this.archive || this.run !== (this.store.live.meta || {}).run) {
      if (this.playing) this.caption();
      return;
    }
    const turn = this.turn;
    await this.look().catch(() => {});
    if (this.playing) this.caption();
    // What belongs to an event may be recorded up to 0.2 s after it.
    else if (turn === this.turn && this.past.segment && this.past.segment.next === null && this.past.wall < this.wanted.wall) this.go(this.run, this.wanted.wall, true, this.wanted.event);
    else this.draw();
  }

  drawLive(live) {
    const meta = live.meta || {};
    setHidden(byId("time-bar"), meta.run === undefined && !meta.archive);
    setHidden(byId("time-live"), Boolean(meta.archive));
    const { connected, heardAt } = this.store;
    const { doing } = truthOf(live, connected, heardAt);
    setText(this.present, meta.archive || !doing ? "" : t("Now, in fact: {what}", { what: doing }));
    if (connected !== this.connected) {
      this.connected = connected;
      this.draw();
    }
    if (this.opened) return;
    this.opened = true;
    const moment = momentOf(location.hash);
    if (moment) this.follow();
    else if (meta.archive) this.look().then(() => this.go(this.current(), this.bounds().ended), this.unanswered);
    else if (meta.run !== undefined) this.look().catch(() => {});
    this.draw();
  }

  drawRun(marked) {
    const { began, ended } = this.bounds();
    const left = (wall) => (100 * Math.min(1, Math.max(0, wall - began) / (ended - began || 1))).toFixed(2);
    byId("time-marks").replaceChildren(...marked.map(([, wall, mark]) => {
      const tick = el("i", { class: mark });
      tick.style.left = `${left(wall)}%`;
      return tick;
    }));
    const runs = byId("time-run");
    setHidden(runs, this.runs.length < 2);
    const shown = this.runs.map(({ run }) => run).join();
    if (runs.dataset.shown !== shown) {
      runs.dataset.shown = shown;
      runs.replaceChildren(...this.runs.map(({ run, began: at }) => el("option", { value: run }, t("run {run}, {time}", { run, time: new Date(at * 1000).toLocaleString() }))));
    }
    runs.value = String(this.current());
  }

  draw() {
    const { past, store } = this;
    const shown = store.past && past.segment !== null;
    setHidden(byId("past-banner"), !shown);
    setText(byId("time-play"), this.playing ? "⏸" : "▶");
    const { began, ended } = this.bounds();
    const wall = this.playing ? this.wall : shown ? past.wall : ended;
    if (document.activeElement !== this.range || this.playing) this.range.value = String((wall - began) / (ended - began || 1));
    const time = shown ? momentText(past) : store.connected ? t("live") : newsText(store.heardAt);
    byId("time-bar").toggleAttribute("data-lost", !store.alive);
    this.range.setAttribute("aria-valuetext", time);
    setText(byId("time-at"), time);
    byId("time-at").setAttribute("href", shown ? momentLink(past) : "#now");
    if (!shown) return;
    setText(this.title, this.archive ? t("RECORDING of {what} · {time}", { what: this.archive, time }) : t("PAST · {time}", { time }));
    if (past.broken) this.say(t("What came next cannot be read: the history is damaged."));
    if (this.event) setText(this.text, told(this.event));
    for (const row of document.querySelectorAll(".event[data-wall]")) row.toggleAttribute("data-later", Number(row.dataset.wall) > past.wall);
  }

  // After all panels: they know nothing of the past.
  mark() {
    if (!this.store.past) {
      for (const row of document.querySelectorAll(".event[data-later]")) row.removeAttribute("data-later");
    } else if (!document.title.startsWith(t("PAST"))) {
      document.title = `${t("PAST")} · ${document.title}`;
    }
  }

  failed({ message }) {
    this.say(t("This moment cannot be shown: {reason}", { reason: message }));
  }

  unanswered = ({ message }) => this.say(t("The history does not answer: {reason}", { reason: message }));

  say(words) {
    setText(byId("time-said"), words);
  }

  key(event) {
    const typing = event.target.closest("input:not([type=range]), textarea, select");
    if (byId("time-bar").hidden || event.ctrlKey || event.metaKey || event.altKey || typing || document.querySelector("dialog[open]")) return;
    const mark = Object.keys(MARKS).find((name) => MARKS[name][1] === event.key.toLowerCase());
    if (mark) this.jump(mark, event.shiftKey);
    else if (event.key === ",") this.step(true);
    else if (event.key === ".") this.step(false);
    else if (event.key === "k") this.toggle();
    else if (event.key === "t") this.range.focus();
    else if (event.key === "l" || (event.key === "Escape" && this.store.past)) this.live();
  }
}

function momentText({ wall, at }) {
  const date = new Date(wall * 1000);
  const day = date.toDateString() === new Date().toDateString() ? "" : `${date.toLocaleDateString()} `;
  const clock = clockText(at);
  return `${day}${date.toLocaleTimeString()}${clock.endsWith(" s") ? ` (${clock})` : ""}`;
}
