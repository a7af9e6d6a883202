// The plan: its steps with state and time, the same as a graph, replans, and what the planner says.
import { byId, clockText, el, GLYPHS, keyed, part, secondsText, setHidden, setText } from "../dom.js";
import { GraphView } from "../graph.js";

const TROUBLE = ["unsolvable", "no plan", "timeout", "crashed", "invalid"];

export function show(section, { store }) {
  section.append(
    el("p", { id: "planner-reason", class: "trouble", hidden: true }),
    el("ol", { id: "plan-steps", class: "steps" }),
    el("p", { id: "plan-empty", class: "empty" }, "No plan yet."),
    el("div", { id: "plan-graph", class: "graph", tabindex: 0, role: "group", "aria-label": "The plan as a graph" }),
    el("div", { id: "plan-replans" }),
    el("details", { id: "planner-words" }, el("summary", {}, "What the planner printed"), el("pre", {})),
  );
  const graph = new GraphView(byId("plan-graph"));

  function draw(plan) {
    const steps = plan.steps || {};
    const order = (plan.order || []).filter((key) => steps[key]);
    setHidden(byId("plan-empty"), order.length > 0);
    keyed(byId("plan-steps"), order, (key) => `${plan.number} ${key}`,
      () => el("li", {}, el("span", { class: "glyph", role: "img" }), el("span", { class: "text" }), el("span", { class: "when number" }), el("span", { class: "reason" })),
      (row, key) => {
        const step = steps[key];
        if (row.dataset.state !== step.state) row.dataset.state = step.state;
        setText(part(row, "glyph"), GLYPHS[step.state]);
        part(row, "glyph").setAttribute("aria-label", step.state);
        setText(part(row, "text"), step.text);
        setText(part(row, "when"), whenText(step));
        setText(part(row, "reason"), step.reason || "");
      });
    graph.show(order.length > 1 || plan.layout_error ? plan.layout || (plan.layout_error ? { error: plan.layout_error } : null) : null, "The plan as a graph");
    graph.mark((id) => {
      const step = steps[id];
      return step && { glyph: GLYPHS[step.state], active: ["running", "dispatched"].includes(step.state), label: step.state, state: step.state };
    });
    graph.markEdges((edge) => steps[edge.from] && steps[edge.from].state === "succeeded" && "taken");
    drawPlanner(plan.planner || {});
    drawReplans(plan.replans || []);
  }

  function drawPlanner(planner) {
    const seconds = planner.seconds ? ` · ${planner.seconds.toFixed(2)} s` : "";
    setText(byId("plan-note"), planner.state ? `${planner.planner || "planner"} · ${planner.state}${seconds}` : "");
    const trouble = TROUBLE.includes(planner.state);
    setHidden(byId("planner-reason"), !trouble);
    setText(byId("planner-reason"), trouble ? `${planner.state}: ${planner.reason}` : "");
    setHidden(byId("planner-words"), !planner.output);
    setText(byId("planner-words").querySelector("pre"), planner.output || "");
  }

  function drawReplans(replans) {
    const box = byId("plan-replans");
    if (!box.firstChild) box.append(el("h3", {}, "Planned again"), el("ul", {}));
    setHidden(box, replans.length === 0);
    keyed(box.lastChild, replans, (replan, index) => `${index} ${replan.at}`,
      () => el("li", {}, el("span", { class: "at number" }), el("span", { class: "said" })),
      (row, replan) => {
        setText(part(row, "at"), clockText(replan.at));
        setText(part(row, "said"), replan.reason || "the plan failed");
      });
  }

  store.view("plan", draw);
}

function whenText(step) {
  const planned = step.duration > 0.01 ? `planned ${secondsText(step.duration)}` : "";
  if (step.ended !== undefined && step.began !== undefined) return `${step.state} in ${secondsText(step.ended - step.began)}`;
  if (step.began !== undefined) return `since ${clockText(step.began)}${planned ? `, ${planned}` : ""}`;
  return planned;
}
