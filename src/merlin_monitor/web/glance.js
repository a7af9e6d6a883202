// The strip above all: state, worst problem, progress, next step, expected end.
import { clockText, el, has, of, secondsText, setText } from "./dom.js";
import { isHeld, unconfirmed } from "./holds.js";
import { planTimes, stepsOf } from "./plan_times.js";
import { say, t } from "./texts.js";

const ENDED = { succeeded: [t("Finished"), "good"], failed: [t("Failed"), "bad"], cancelled: [t("Cancelled"), "warn"] };
const PLANNER = ["unsolvable", "no plan", "timeout", "crashed", "invalid"];

export function glance(store) {
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
  const draw = () => {
    const state = store.state;
    const [doing, tone] = stateOf(state);
    put(cells.get("state"), doing, tone);
    const problems = problemsOf(state);
    const more = problems.length > 1 ? ` ${t("(and {count} more)", { count: problems.length - 1 })}` : "";
    put(cells.get("problem"), problems.length ? problems[0][1] + more : t("None"), problems.length ? (problems[0][0] < 2 ? "bad" : "warn") : "good");
    const [text, share] = progressOf(state);
    setText(words, text);
    if (bar.value !== share) bar.value = share;
    setText(cells.get("next"), nextOf(state));
    setText(cells.get("end"), endOf(state));
  };
  for (const section of ["now", "plan", "queue", "health", "guard", "map", "machines", "meta"]) store.view(section, draw);
  return strip;
}

function put(cell, text, tone) {
  setText(cell, text);
  if (cell.dataset.tone !== tone) cell.dataset.tone = tone;
}

function stateOf(state) {
  const { now = {}, guard = {} } = state;
  const executor = now.executor || {};
  const mission = now.mission || {};
  if (guard.state === "stopped") return [t("Stopped and held"), "bad"];
  if (now.silent) return [t("Not known"), "bad"];
  if (executor.state === "cancelling") return [t("Stopping"), "warn"];
  if (isHeld(state) || unconfirmed(state).length) return [t("Held"), "warn"];
  if (executor.state === "running") {
    if (executor.paused) return [t("Pausing"), "warn"];
    return (executor.running || []).length ? [t("Working"), "good"] : [t("Preparing"), "good"];
  }
  if (executor.paused || mission.state === "paused") return [t("Paused"), "warn"];
  if (has(ENDED, mission.state)) return ENDED[mission.state];
  return executor.state || mission.state ? [t("Idle"), ""] : [t("Nothing heard yet"), ""];
}

// [rank, text], the worst first: 0 the base, 1 what is gone or failed, 2 warnings.
function problemsOf(state) {
  const { guard = {}, now = {}, health = {}, plan = {}, map = {}, meta = {} } = state;
  const found = [];
  if (guard.state === "stopped") found.push([0, t("Nothing moves the base until it is released.")]);
  if (guard.state === "partly") found.push([0, t("Not all robots are held.")]);
  if (guard.state === "silent") found.push([0, t("The base is not watched")]);
  if (guard.state === "holding") found.push([0, `${t("The base is held")}: ${t(guard.reason)}`]);
  if (guard.warning) found.push([0, guard.warning]);
  for (const phrase of now.trouble_said || []) found.push([1, say(phrase)]);
  for (const { name, title } of meta.panels || []) {
    const { silent } = of(state, name) || {};
    if (silent) found.push([1, t("{what}: no news since {time}", { what: t(title || "Now"), time: clockText(silent.since) })]);
  }
  for (const [name, part] of Object.entries(health.parts || {})) {
    if (part.silent) found.push([1, t("{what} is silent", { what: name })]);
    else if (part.level === "error" || part.level === "stale") found.push([1, `${name}: ${part.message}`]);
    else if (part.level === "warning") found.push([2, `${name}: ${part.message}`]);
  }
  const planner = plan.planner || {};
  if (PLANNER.includes(planner.state)) found.push([1, t("No plan was found")]);
  for (const phrase of [map.stands, map.trouble].filter(Boolean)) found.push([2, say(phrase)]);
  return found.sort(([one], [other]) => one - other);
}

function progressOf({ now = {}, plan = {} }) {
  const mission = now.mission || {};
  const steps = stepsOf(plan);
  const active = Boolean(now.active);
  const done = steps.filter((step) => step.state === "succeeded").length;
  const share = active && steps.length ? done / steps.length : 0;
  const ended = has(ENDED, mission.state);
  const texts = [];
  if (mission.task && mission.tasks) texts.push(t("task {number} of {count}", { number: mission.task, count: mission.tasks }));
  else if (mission.task) texts.push(t("task {number}", { number: mission.task }));
  if (active && steps.length) texts.push(t("{done} of {count} steps done", { done, count: steps.length }));
  if (mission.tasks) {
    const tasks = ended && mission.state === "succeeded" ? mission.tasks : Math.max(0, mission.task - 1) + share;
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
  if (!times || !times.open || !times.known) return "–";
  const left = Math.max(0, times.end - meta.time);
  const late = times.delay > 2 ? ` · ${t("{time} late", { time: secondsText(times.delay) })}` : "";
  return `${t("in {time}", { time: secondsText(Math.round(left)) })} (${clockText(times.end)})${late}`;
}
