// What happened: bars of goals and actions over time, and events, newest first, back to the first one kept.
import { byId, clockText, el, keyed, svg } from "../dom.js";

const KINDS = ["mission", "goal", "plan", "action", "machine", "knowledge", "health", "guard", "control", "monitor"];
const QUIET = new Set(["machine", "knowledge"]); // not shown until asked for
const GLYPHS = { mission: "◆", goal: "◎", plan: "≡", action: "▶", machine: "⬡", knowledge: "+", health: "♥", control: "✎", monitor: "·" };
const BAD = /\b(failed|error|unsolvable|no plan|refused|timeout|crashed|invalid|internal|silent)\b/;
const PAGE = 200; // events asked for at once
const MOST = 3000; // events on the page; the export has them all
const FEW = 30; // rows that need not be scrolled
const SPAN = 180; // s of the timeline
const SHORTEST = 60;
const LATE = 2; // s that the clock of the state may be behind
const LANES = ["goal", "action"];

export function show(section, { store }) {
  byId("history-note").append(el("a", { href: "/history.json", download: true }, "export as JSON"));
  section.append(
    el("div", { id: "timeline", role: "img", "aria-label": "Goals and actions over time" }),
    el("div", { id: "history-kinds", class: "choices", role: "group", "aria-label": "Kinds of events" }),
    el("div", { id: "history-list", class: "log long", tabindex: 0, role: "list", "aria-label": "Events, newest first" }),
  );
  const shown = new Set(KINDS.filter((kind) => !QUIET.has(kind)));
  const kept = new Map(); // id → event, of the shown kinds and the timeline: those of the state, and older ones
  let exhausted = false;
  let loading = false;

  for (const kind of KINDS) {
    byId("history-kinds").append(el("button", {
      type: "button", "aria-pressed": String(shown.has(kind)),
      onclick: (event) => {
        if (!shown.delete(kind)) shown.add(kind);
        event.target.setAttribute("aria-pressed", String(shown.has(kind)));
        forgetOlder(); // they are of the kinds shown until now
        draw();
      },
    }, `${GLYPHS[kind]} ${kind}`));
  }
  const list = byId("history-list");
  list.addEventListener("scroll", () => {
    if (list.scrollTop + list.clientHeight > list.scrollHeight - 300) loadOlder();
  }, { passive: true });

  store.watch("history", (change) => {
    if (change === null) forgetOlder(); // another run may have begun, or another file
  });

  function forgetOlder() {
    kept.clear();
    exhausted = false;
  }

  function events() {
    for (const event of Object.values((store.state.history || {}).events || {})) {
      if (shown.has(event.kind) || LANES.includes(event.kind)) kept.set(event.id, event);
    }
    const all = [...kept.values()].sort((a, b) => b.id - a.id);
    for (const event of all.splice(MOST)) kept.delete(event.id);
    return all;
  }

  async function loadOlder() {
    const recorded = (store.state.meta || {}).run !== undefined;
    if (!recorded || loading || exhausted || !shown.size || kept.size >= MOST) return;
    loading = true;
    const kinds = [...shown].join(",");
    try {
      const all = events();
      const first = all.length ? `&before=${all[all.length - 1].id}` : "";
      const answer = await fetch(`/history?limit=${PAGE}&kinds=${kinds}${first}`);
      const page = answer.ok ? await answer.json() : [];
      if (kinds !== [...shown].join(",")) return; // they were chosen anew meanwhile
      exhausted = page.length < PAGE;
      for (const event of page) kept.set(event.id, event);
    } catch {
      return; // no connection: the next scroll asks again
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
    keyed(list, rows, (row) => (row.heading !== undefined ? `run ${row.heading}` : row.event.id), create, () => {});
    if (rows.length < FEW) loadOlder();
  }

  function create({ event, heading }) {
    if (heading !== undefined) return el("div", { class: "run" }, `before ${new Date(event.wall * 1000).toLocaleString()}: an earlier run`);
    const time = el("time", { class: "at", datetime: new Date(event.wall * 1000).toISOString() }, clockText(event.at));
    time.title = new Date(event.wall * 1000).toLocaleString();
    return el("div", { class: "event", role: "listitem", "data-kind": event.kind, "data-bad": BAD.test(event.text) && event.kind !== "knowledge" },
      time, el("span", { class: "glyph", role: "img", "aria-label": event.kind }, GLYPHS[event.kind] || "·"), el("span", { class: "said" }, event.text));
  }

  const lanes = svg("svg", {});
  byId("timeline").append(lanes);
  function drawTimeline(all) {
    const current = (store.state.meta || {}).run;
    const now = (store.state.meta || {}).time || 0; // after the simulator began anew, bars of before are of no time
    const bars = all.filter((event) => event.run === current && event.detail && event.detail.ended !== undefined && event.detail.began <= now + LATE);
    const running = Object.values((store.state.plan || {}).steps || {}).filter((step) => step.state === "running" && step.began);
    const end = Math.max(now, ...bars.map((event) => Math.min(event.detail.ended, now + LATE)));
    const width = byId("timeline").clientWidth || 500;
    const left = 46;
    const begin = Math.max(end - SPAN, Math.min(end - SHORTEST, ...all.filter((event) => event.run === current && event.at).map((event) => event.at)));
    const x = (at) => left + ((width - left - 4) * (Math.max(at, begin) - begin)) / (end - begin);
    const items = [];
    LANES.forEach((lane, index) => {
      const y = 8 + index * 30;
      items.push(svg("text", { class: "lane", x: 0, y: y + 16 }, `${lane}s`), svg("line", { class: "track", x1: left, x2: width, y1: y + 26, y2: y + 26 }));
      for (const { detail } of bars.filter((event) => event.detail.lane === lane && event.detail.ended > begin)) items.push(...bar(detail, lane, x, y));
    });
    for (const step of running) items.push(...bar({ began: step.began, ended: end, outcome: "running", label: step.text }, "action", x, 38));
    for (let at = Math.ceil(begin / 30) * 30; at <= end; at += 30) {
      if (at >= 0 && x(at) < width - 30) items.push(svg("text", { class: "tick", x: x(at), y: 84 }, clockText(at).replace(".0 s", " s")));
    }
    lanes.replaceChildren(...items);
    byId("timeline").setAttribute("aria-label", `Goals and actions of the last ${SPAN} s: ${bars.length} ended`);
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
  const shape = svg("rect", { class: `stretch ${lane} ${kind}`, x: from, y: y + 3, width, height: 18, rx: 5 }, svg("title", {}, `${detail.label} ${detail.outcome}`));
  const text = String(detail.label || "").replace(/[()]/g, "");
  const room = Math.floor((width - 10) / 5.6);
  if (room < 4) return [shape];
  return [shape, svg("text", { class: "label", x: from + 6, y: y + 16 }, text.length > room ? `${text.slice(0, room - 1)}…` : text)];
}
