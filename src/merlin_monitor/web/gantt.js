// SPDX-License-Identifier: Apache-2.0
// Lanes of steps in time, as planned (outlined) and as it was and is (filled); the present as a line.
import { clockText, has, of, secondsText, svg } from "./dom.js";
import { pannable } from "./pan.js";
import { planTimes, stepsOf, stepSpan } from "./plan_times.js";
import { say, t } from "./texts.js";

const LANE = 46; // px
const NAME = 14; // px, of the robot above its lanes
const BAR = 16; // px
const TOP = 20; // px, of the times
const WIDEST = 20000; // px
const READABLE = 84; // px of a step of middle length, at least
const LETTER = 6.4; // px
const TICKS = [1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600];

export class Gantt {
  constructor(box) {
    this.box = box;
    this.zoom = 1;
    this.followed = null; // number of the plan that is followed to the present
    this.root = svg("svg", { role: "img" });
    box.append(this.root);
    pannable(box, { move: (dx, dy) => box.scrollBy(dx, dy), zoom: (factor) => { this.zoom = Math.min(8, Math.max(0.25, this.zoom * factor)); this.paint(...this.last); } });
    this.last = [[], 0, {}, ""];
  }

  // robots: the section of the state; each has lanes of its own.
  draw(plan, now, robots) {
    const times = planTimes(plan, now);
    const steps = stepsOf(plan).filter((step) => step.duration > 0.01 || step.began !== undefined);
    const late = times && times.delay > 2 ? `; ${t("{time} late", { time: secondsText(times.delay) })}` : "";
    this.paint(steps.map((step) => ({ step, ...stepSpan(step, times, now) })), times && now, robots, t("The plan in time, {count} steps", { count: steps.length }) + late);
  }

  // spans: [{step, planned: [from, to], real: the same, due: a time}], of which any may be missing; now: 0 where times are not of a clock.
  paint(given, now, robots, label) {
    this.last = [given, now, robots, label];
    const spans = given.map((span) => ({ ...span, at: span.planned || span.real }));
    this.box.hidden = spans.length === 0;
    if (this.box.hidden) return;
    const ends = spans.flatMap(({ at, real, due }) => [...at, ...(real || []), ...(due ? [due] : [])]);
    const [from, to] = [Math.min(...ends), Math.max(...ends, now || -Infinity)];
    const lengths = spans.map(({ at }) => at[1] - at[0]).sort((a, b) => a - b);
    const room = Math.max(300, this.box.clientWidth - 4);
    const middle = Math.max(0.5, lengths[lengths.length >> 1]);
    const width = Math.min(WIDEST, Math.max(room, ((to - from) / middle) * READABLE)) * this.zoom;
    const x = (at) => 4 + ((width - 60) * (at - from)) / Math.max(0.1, to - from);
    const { tops, names, height } = layOut(spans, robots || {});
    const items = ticks(from, to, x, height, now);
    spans.forEach((span, index) => items.push(...bars(span, x, tops[index])));
    if (now && now <= to) items.push(svg("line", { class: "now", x1: x(now), x2: x(now), y1: 0, y2: height }));
    this.root.replaceChildren(...items);
    this.root.setAttribute("width", width);
    this.root.setAttribute("height", height);
    this.root.setAttribute("aria-label", label);
    if (now && !this.box.matches(":hover, :focus")) this.box.scrollLeft = x(now) - this.box.clientWidth / 2;
    for (const [name, y] of names) this.root.append(svg("text", { class: "robot", x: this.box.scrollLeft + 5, y: y + 11 }, name));
  }
}

// The upper edge of each step, in the first lane that is free when it is planned to begin.
function layOut(spans, { parameters = {}, robots = {} }) {
  const robotOf = ({ step }) => ((step.parameters || []).find(([key, value]) => key === of(parameters, step.name) && has(robots, value)) || [])[1] || "";
  const owners = spans.map(robotOf);
  const tops = [];
  const names = [];
  let height = TOP;
  for (const owner of [...new Set(owners)].sort()) {
    if (owner) { names.push([owner, height]); height += NAME; }
    const free = [];
    const order = [...spans.keys()].filter((index) => owners[index] === owner);
    order.sort((a, b) => spans[a].at[0] - spans[b].at[0]);
    for (const index of order) {
      const { at } = spans[index];
      let lane = free.findIndex((end) => end <= at[0] + 0.01);
      if (lane < 0) lane = free.length;
      free[lane] = at[1];
      tops[index] = height + LANE * lane;
    }
    height += LANE * free.length;
  }
  return { tops, names, height };
}

function bars({ step, planned, real, due, at }, x, y) {
  const rect = (kind, [from, to], top) => svg("rect", { class: kind, x: x(from), y: top, width: Math.max(2, x(to) - x(from) - 1), height: BAR, rx: 4, "data-state": step.state });
  const words = say(step.does || step.words) || step.text;
  const seconds = real ? t("{state} in {time}", { state: t(step.state), time: secondsText(real[1] - real[0]) }) : t(step.state);
  const title = svg("title", {}, `${words}: ${planned ? `${t("planned {time}", { time: secondsText(planned[1] - planned[0]) })}, ` : ""}${seconds}`);
  const shapes = [svg("g", {}, title, planned ? rect("planned", planned, y + 2) : null, real ? rect("real", real, y + 4 + BAR) : null)];
  if (due) shapes.push(svg("line", { class: "due", x1: x(due), x2: x(due), y1: y, y2: y + 6 + 2 * BAR }));
  const letters = Math.floor((x(at[1]) - x(at[0]) - 10) / LETTER);
  if (letters >= 4) shapes.push(svg("text", { x: x(at[0]) + 5, y: y + 14 }, words.length > letters ? `${words.slice(0, letters - 1)}…` : words));
  return shapes;
}

function ticks(from, to, x, height, now) {
  const px = x(1) - x(0); // per s
  const each = TICKS.find((step) => step * px > 90) || 3600 * Math.ceil(0.025 / px);
  const items = [];
  for (let at = Math.ceil(from / each) * each; at <= to; at += each) {
    const text = now ? clockText(at).replace(".0 s", " s") : `${at} s`;
    items.push(svg("line", { class: "tick", x1: x(at), x2: x(at), y1: TOP - 4, y2: height }), svg("text", { class: "at", x: x(at) + 3, y: 12 }, text));
  }
  return items;
}
