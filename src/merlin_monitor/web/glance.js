// SPDX-License-Identifier: Apache-2.0
// The strip above all: state, worst problem, progress, next step, expected end.
import { clockText, el, secondsText, setHidden, setText } from "./dom.js";
import { planTimes, stepsOf } from "./plan_times.js";
import { say, t } from "./texts.js";
import { truthOf } from "./truth.js";

export function glance(store, control) {
  const cells = new Map();
  const strip = el("dl", { id: "glance", "aria-label": t("At a glance") });
  for (const [name, title] of [["state", t("State")], ["problem", t("Worst problem")], ["progress", t("Progress")], ["next", t("Next step")], ["end", t("Expected end")]]) {
    const value = el("dd", { id: `glance-${name}` });
    cells.set(name, value);
    strip.append(el("div", {}, el("dt", {}, title), value));
  }
  const bar = el("progress", { max: 1, value: 0, "aria-label": t("Progress") });
  const words = el("span", {});
  cells.get("progress").append(words, bar);
  const problem = el("span", {});
  const known = el("button", { id: "acknowledge", class: "small", hidden: true, onclick: () => control.ask("acknowledge", { problem: known.dataset.key }) }, t("I know"));
  cells.get("problem").append(problem, " ", known);
  // The worst one that no operator knows about yet.
  const drawProblem = (problems) => {
    if (!problems) return put(problem, "–", ""); // an older history has none
    const [worst] = problems;
    const fresh = problems.filter(({ by }) => !by).length;
    const more = problems.length > 1 ? ` ${t("(and {count} more)", { count: problems.length - 1 })}` : "";
    const text = !worst ? t("None") : (worst.by ? t("{client} knows: {what}", { client: worst.by, what: say(worst.said) }) : say(worst.said)) + more;
    put(problem, text, !worst ? "good" : !fresh ? "" : worst.rank < 2 ? "bad" : "warn");
    known.dataset.key = fresh ? worst.key : "";
    setHidden(known, !known.dataset.key || !control.possible());
  };
  const draw = () => {
    const state = store.state;
    const truth = truthOf(state, store.alive, store.heardAt);
    put(cells.get("state"), truth.state, truth.tone);
    drawProblem(truth.problems);
    const [text, share] = truth.known ? progressOf(state) : ["–", 0];
    setText(words, text);
    if (bar.value !== share) bar.value = share;
    setText(cells.get("next"), truth.expected ? nextOf(state) : "–");
    setText(cells.get("end"), truth.expected ? endOf(state) : "–");
  };
  for (const section of ["now", "plan", "queue", "meta"]) store.view(section, draw);
  return strip;
}

function put(cell, text, tone) {
  setText(cell, text);
  if (cell.dataset.tone !== tone) cell.dataset.tone = tone;
}

function progressOf({ now = {}, plan = {} }) {
  const mission = ((now.executor || {}).mission !== false && now.mission) || {}; // an operator's goal is not a task of it
  const steps = stepsOf(plan);
  const active = Boolean(now.active);
  const done = steps.filter((step) => step.state === "succeeded").length;
  const share = active && steps.length ? done / steps.length : 0;
  const texts = [];
  if (mission.task && mission.tasks) texts.push(t("task {number} of {count}", { number: mission.task, count: mission.tasks }));
  else if (mission.task) texts.push(t("task {number}", { number: mission.task }));
  if (active && steps.length) texts.push(t("{done} of {count} steps done", { done, count: steps.length }));
  if (mission.tasks) {
    const tasks = mission.state === "succeeded" ? mission.tasks : Math.max(0, mission.task - 1) + share;
    return [texts.join(", "), Math.min(1, tasks / mission.tasks)];
  }
  return [texts.join(", ") || "–", share];
}

function nextOf({ now = {}, plan = {}, queue = {} }) {
  const step = now.active ? stepsOf(plan).find(({ state }) => state === "waiting") : null;
  if (step) return say(step.words) || step.text;
  const [waiting] = queue.waiting || [];
  return waiting ? say(waiting.words) : "–";
}

function endOf({ now = {}, plan = {}, meta = {} }) {
  const times = now.active ? planTimes(plan, meta.time) : null;
  const texts = [];
  const left = (end) => secondsText(Math.round(Math.max(0, end - meta.time)));
  const expected = times && times.open && times.known;
  if (expected) texts.push(`${t("in {time}", { time: left(times.end) })} (${clockText(times.end + (meta.clock_set || 0))})`);
  if (expected && times.delay > 2) texts.push(t("{time} late", { time: secondsText(times.delay) }));
  const { task, tasks, since, pace } = now.mission || {};
  if (pace) { // its present task takes as long as the others, or as the plan, unless that is an operator's
    const own = (now.executor || {}).mission !== false;
    const end = Math.max(since + pace, own && expected ? times.end : meta.time) + pace * (tasks - task);
    texts.push(t("mission in about {time}", { time: left(end) }));
  }
  return texts.join(" · ") || "–";
}
