// SPDX-License-Identifier: Apache-2.0
// Bars of goals and actions over time, and events, newest first, back to the first one kept.
import { byId, clockText, el, has, keyed, of, svg, tell } from "../dom.js";
import { askFor } from "../answers.js";
import { say, t, told } from "../texts.js";
import { momentLink } from "../past.js";

const GLYPHS = { mission: "◆", goal: "◎", plan: "≡", action: "▶", speech: "❝", sight: "◉", machine: "⬡", knowledge: "+", health: "♥", guard: "·", control: "✎", monitor: "·" };
const KINDS = Object.keys(GLYPHS);
const QUIET = new Set(["machine", "knowledge"]); // not shown until asked for
const WORDS = new Set(["knowledge", "speech", "sight"]); // words of others: they report no fault
const BAD = /\b(failed|error|unsolvable|no plan|refused|timeout|crashed|invalid|internal|silent)\b/;
const PAGE = 200; // events asked for at once
const MOST = 3000; // events on the page; the export has them all
const FEW = 30; // rows that need not be scrolled
const SPAN = 180; // s of the timeline
const SHORTEST = 60;
const LATE = 2; // s that the clock of the state may be behind
const LANES = { goal: t("goals"), action: t("actions") };

export function show(section, { store }) {
  byId("history-note").append(el("a", { href: "history.json", download: true }, t("export as JSON")));
  section.append(
    el("p", { id: "history-trouble", class: "trouble", role: "status", hidden: true }),
    el("div", { id: "timeline", role: "img", "aria-label": t("Goals and actions over time") }),
    el("div", { id: "history-kinds", class: "choices", role: "group", "aria-label": t("Kinds of events") }),
    el("div", { id: "history-list", class: "log long", tabindex: 0, role: "list", "aria-label": t("Events, newest first") }),
  );
  const shown = new Set(KINDS.filter((kind) => !QUIET.has(kind)));
  let kept = new Map(); // id → event, of the shown kinds and the timeline: those of the state, and older ones
  let exhausted = false;
  let loading = false;

  for (const kind of KINDS) {
    byId("history-kinds").append(el("button", {
      "aria-pressed": String(shown.has(kind)),
      onclick: (event) => {
        if (!shown.delete(kind)) shown.add(kind);
        event.target.setAttribute("aria-pressed", String(shown.has(kind)));
        forgetOlder(); // they are of the kinds shown until now
        draw();
      },
    }, `${GLYPHS[kind]} ${t(kind)}`));
  }
  const list = byId("history-list");
  const atEnd = () => list.clientHeight && list.scrollTop + list.clientHeight > list.scrollHeight - 300;
  list.addEventListener("scroll", () => atEnd() && loadOlder(), { passive: true });
  let above = 0; // px of news above what the pointer is at, which stays there
  list.addEventListener("pointerleave", () => { if (list.scrollTop <= above) list.scrollTop = 0; });

  store.watch("history", (change) => {
    if (change === null) forgetOlder(); // another run may have begun, or another file
  });

  function forgetOlder() {
    kept = new Map();
    exhausted = false;
  }

  function events() {
    for (const event of Object.values((store.state.history || {}).events || {})) {
      if (shown.has(event.kind) || has(LANES, event.kind)) kept.set(event.id, event);
    }
    const all = [...kept.values()].sort((a, b) => b.id - a.id);
    for (const event of all.splice(MOST)) kept.delete(event.id);
    return all;
  }

  async function loadOlder() {
    const recorded = (store.state.meta || {}).run !== undefined;
    if (!recorded || loading || exhausted || !shown.size || kept.size >= MOST) return;
    loading = true;
    const before = kept;
    try {
      const all = events();
      const first = all.length ? `&before=${all[all.length - 1].id}` : "";
      const page = await askFor(`history?limit=${PAGE}&kinds=${[...shown].join(",")}${first}`);
      if (kept === before) { // else the page does not follow what is kept: kinds were chosen, or a run began
        exhausted = page.length < PAGE;
        for (const event of page) kept.set(event.id, event);
      }
      tell(byId("history-trouble"));
    } catch (error) {
      if (error instanceof TypeError) return; // no connection: the next scroll asks again
      tell(byId("history-trouble"), t("The history does not answer: {reason}", { reason: error.message }));
      if (error.cause) return; // it hangs: likewise
      exhausted = kept === before;
    } finally {
      loading = false;
    }
    draw();
  }

  function draw() {
    const all = events();
    drawTimeline(all);
    const rows = [];
    let run = null;
    for (const event of all) {
      if (!shown.has(event.kind)) continue;
      if (run !== null && event.run !== run) rows.push({ heading: event.run, event });
      run = event.run;
      rows.push({ event });
    }
    const first = list.firstChild;
    keyed(list, rows, (row) => (row.heading !== undefined ? `run ${row.heading}` : row.event.id), create, () => {});
    if (first && (list.scrollTop || list.matches(":hover"))) {
      above += first.offsetTop;
      list.scrollTop += first.offsetTop;
    } else above = 0;
    if (rows.length < FEW || atEnd()) loadOlder();
  }

  function create({ event, heading }) {
    if (heading !== undefined) return el("div", { class: "run" }, t("before {time}: an earlier run", { time: new Date(event.wall * 1000).toLocaleString() }));
    const clock = new Date(event.wall * 1000);
    const link = event.id ? { href: momentLink(event), title: t("{time}: show this moment", { time: clock.toLocaleString() }) } : {};
    const time = el("a", { class: "at", ...link }, el("time", { datetime: clock.toISOString() }, clockText(event.at) || clock.toLocaleTimeString()));
    const go = (click) => { if (!click.target.closest("a") && getSelection().isCollapsed) time.click(); };
    return el("div", { class: "event", role: "listitem", onclick: go, "data-wall": event.wall, "data-kind": event.kind, "data-bad": BAD.test(event.text) && !WORDS.has(event.kind) },
      time, el("span", { class: "glyph", role: "img", "aria-label": t(event.kind) }, of(GLYPHS, event.kind) || "·"), el("span", { class: "said" }, told(event)));
  }

  const lanes = svg("svg", {});
  byId("timeline").append(lanes);
  function drawTimeline(all) {
    const { run: current, time: now = 0 } = store.state.meta || {}; // after the simulator began anew, bars of before are of no time
    const ours = all.filter((event) => event.run === current);
    const bars = ours.map(({ detail }) => detail).filter((each) => each && each.ended !== undefined && each.began <= now + LATE);
    const running = Object.values((store.state.plan || {}).steps || {}).filter((step) => step.state === "running" && step.began);
    const end = Math.max(now, ...bars.map(({ ended }) => Math.min(ended, now + LATE)));
    const width = byId("timeline").clientWidth || 500;
    const left = 46;
    const begin = Math.max(end - SPAN, Math.min(end - SHORTEST, ...ours.filter((event) => event.at).map((event) => event.at)));
    const x = (at) => left + ((width - left - 4) * (Math.max(at, begin) - begin)) / (end - begin);
    const items = [];
    Object.keys(LANES).forEach((lane, index) => {
      const y = 8 + index * 30;
      items.push(svg("text", { class: "lane", x: 0, y: y + 16 }, LANES[lane]), svg("line", { class: "track", x1: left, x2: width, y1: y + 26, y2: y + 26 }));
      for (const each of bars) if (each.lane === lane && each.ended > begin) items.push(...bar(each, lane, x, y));
    });
    for (const step of running) items.push(...bar({ began: step.began, ended: end, outcome: "running", label: step.text, words: step.words }, "action", x, 38));
    for (let at = Math.ceil(begin / 30) * 30; at <= end; at += 30) {
      if (at >= 0 && x(at) < width - 30) items.push(svg("text", { class: "tick", x: x(at), y: 84 }, clockText(at).replace(".0 s", " s")));
    }
    lanes.replaceChildren(...items);
    byId("timeline").setAttribute("aria-label", t("Goals and actions of the last {seconds} s: {count} ended", { seconds: SPAN, count: bars.length }));
  }

  let pending = 0;
  const redrawTimeline = () => {
    if (pending) return;
    pending = setTimeout(() => { pending = 0; drawTimeline(events()); }, 1000);
  };
  store.view("history", draw);
  store.view("meta", redrawTimeline);
}

function bar(detail, lane, x, y) {
  const from = x(detail.began);
  const width = Math.max(2, x(detail.ended) - from);
  const kind = detail.outcome === "cancelled" ? "cancelled" : ["succeeded", "already true", "running"].includes(detail.outcome) ? "" : "bad";
  const words = detail.words === undefined ? String(detail.label || "").replace(/[()]/g, "") : say(detail.words); // as older files have it
  const shape = svg("rect", { class: `stretch ${lane} ${kind}`, x: from, y: y + 3, width, height: 18, rx: 5 }, svg("title", {}, `${words}: ${t(detail.outcome)}`));
  const room = Math.floor((width - 10) / 5.6);
  if (room < 4) return [shape];
  return [shape, svg("text", { class: "label", x: from + 6, y: y + 16 }, words.length > room ? `${words.slice(0, room - 1)}…` : words)];
}
