// SPDX-License-Identifier: Apache-2.0
// The plan: its steps with state and time, the same as a graph, replans, and what the planner says.
import { byId, clockText, el, GLYPHS, has, keyed, of, part, secondsText, setHidden, setText, tell } from "../dom.js";
import { Gantt } from "../gantt.js";
import { GraphView } from "../graph.js";
import { say, t } from "../texts.js";

const TROUBLE = ["unsolvable", "no plan", "timeout", "crashed", "invalid"];

export function show(section, { store }) {
  section.append(
    el("p", { id: "planner-reason", class: "trouble", hidden: true }),
    el("ol", { id: "plan-steps", class: "steps", tabindex: 0, "aria-label": t("Steps") }),
    el("p", { id: "plan-empty", class: "empty" }, t("No plan yet.")),
    el("div", { id: "plan-time", class: "gantt", tabindex: 0, role: "group", "aria-label": t("The plan in time"), hidden: true }),
    el("div", { id: "plan-graph", class: "graph", tabindex: 0, role: "group", "aria-label": t("The plan as a graph") }),
    el("div", { id: "plan-replans" }),
    el("details", { id: "planner-words" }, el("summary", {}, t("What the planner printed")), el("pre", {})),
  );
  const graph = new GraphView(byId("plan-graph"), {
    words: ({ id }) => {
      const step = of((store.state.plan || {}).steps, id);
      return step && { text: say(step.words) || step.text, detail: step.text };
    },
  });
  const gantt = new Gantt(byId("plan-time"));
  let followed = ""; // the step that was brought into sight

  function draw(plan) {
    const steps = plan.steps || {};
    const order = (plan.order || []).filter((key) => has(steps, key));
    setHidden(byId("plan-empty"), order.length > 0);
    keyed(byId("plan-steps"), order, (key) => `${plan.number} ${key}`,
      () => el("li", {}, el("span", { class: "glyph", role: "img" }), el("span", { class: "text" }), el("span", { class: "when number" }), el("span", { class: "reason" })),
      (row, key) => {
        const step = steps[key];
        if (row.dataset.state !== step.state) row.dataset.state = step.state;
        setText(part(row, "glyph"), GLYPHS[step.state]);
        part(row, "glyph").setAttribute("aria-label", t(step.state));
        setText(part(row, "text"), say(step.words) || step.text);
        part(row, "text").title = step.text;
        setText(part(row, "when"), whenText(step));
        setText(part(row, "reason"), say(step.reason));
      });
    graph.show(order.length > 1 || plan.layout_error ? plan.layout || (plan.layout_error ? { error: plan.layout_error } : null) : null, t("The plan as a graph"));
    graph.mark((id) => {
      const step = of(steps, id);
      return step && { glyph: GLYPHS[step.state], active: ["running", "dispatched"].includes(step.state), label: t(step.state), state: step.state };
    });
    graph.markEdges((edge) => (of(steps, edge.from) || {}).state === "succeeded" && "taken");
    follow(plan, order.find((key) => ["running", "dispatched"].includes(steps[key].state)));
    gantt.draw(plan, (store.state.meta || {}).time, store.state.robots);
    drawPlanner(plan.planner || {});
    drawReplans(plan.replans || []);
  }

  // Brings the running step into sight, unless the reader looks around.
  function follow(plan, key) {
    const list = byId("plan-steps");
    const name = `${plan.number} ${key}`;
    if (key === undefined || name === followed || list.matches(":hover, :focus")) return;
    followed = name;
    const row = list.querySelector('[data-state="running"], [data-state="dispatched"]');
    if (row) list.scrollTop = row.offsetTop - list.offsetTop - list.clientHeight / 3;
  }

  function drawPlanner(planner) {
    const seconds = planner.seconds ? ` · ${planner.seconds.toFixed(2)} s` : "";
    byId("plan-note").title = planner.planner || "";
    setText(byId("plan-note"), planner.state ? t(planner.state) + seconds : "");
    const trouble = TROUBLE.includes(planner.state);
    tell(byId("planner-reason"), trouble ? `${t(planner.state)}: ${planner.reason}` : "");
    setHidden(byId("planner-words"), !planner.output);
    setText(byId("planner-words").querySelector("pre"), planner.output || "");
  }

  function drawReplans(replans) {
    const box = byId("plan-replans");
    if (!box.firstChild) box.append(el("h3", {}, t("Planned again")), el("ul", {}));
    setHidden(box, replans.length === 0);
    keyed(box.lastChild, replans, (replan, index) => `${index} ${replan.at}`,
      () => el("li", {}, el("span", { class: "at number" }), el("span", { class: "said" })),
      (row, replan) => {
        setText(part(row, "at"), clockText(replan.at));
        setText(part(row, "said"), say(replan.reason) || t("the plan failed"));
      });
  }

  store.view("plan", draw);
  let drawn = 0; // s; the present moves on
  store.view("meta", ({ time }) => {
    if (!time || Math.abs(time - drawn) < 1) return;
    drawn = time;
    gantt.draw(store.state.plan || {}, time, store.state.robots);
  });
}

function whenText(step) {
  const planned = step.duration > 0.01 ? t("planned {time}", { time: secondsText(step.duration) }) : "";
  if (step.ended !== undefined && step.began !== undefined) return t("{state} in {time}", { state: t(step.state), time: secondsText(step.ended - step.began) });
  if (step.began !== undefined) return t("since {time}", { time: clockText(step.began) }) + (planned ? `, ${planned}` : "");
  return planned;
}
