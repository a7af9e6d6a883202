// SPDX-License-Identifier: Apache-2.0
// Sends goals in PDDL, completed from the domain and the objects; plans them only; sets facts by hand.
import { byId, el, has, keyed, setHidden, tell } from "../dom.js";
import { complete } from "../completion.js";
import { breakpointsOf } from "../holds.js";
import { PlanPreview } from "../plan_preview.js";
import { say, t } from "../texts.js";

export function show(section, { store, control }) {
  const goal = el("input", {
    id: "goal", class: "code", role: "combobox", "aria-expanded": "false", "aria-controls": "goal-choices",
    "aria-autocomplete": "list", spellcheck: "false", placeholder: "(checked kitchen)",
  });
  const priority = el("input", { id: "priority", type: "number", value: "0", step: "1" });
  const field = (input, label, ...more) => el("div", { class: "field" }, el("label", { for: input.id }, label), input, ...more);
  const goalField = field(goal, t("Goal in PDDL"), el("ul", { id: "goal-choices", role: "listbox", "aria-label": t("Completions"), hidden: true }));
  goalField.classList.add("grow");
  const form = el("form", { id: "goal-form", autocomplete: "off" },
    goalField, field(priority, t("Priority")), el("button", { type: "submit", class: "primary" }, t("Send goal")),
    el("button", { id: "plan-only", title: t("Shows a plan for it, and does nothing"), onclick: () => preview.ask(goal.value) }, t("Plan only")),
    el("button", { id: "set-facts", title: t("Makes it true in the knowledge; the robot does nothing for it"), onclick: () => setFacts() }, t("Set by hand")));
  form.append(el("button", { id: "hold-before", title: t("Holds the robot before this action or goal, * stands for any argument, or before a state, like NAVIGATE/DRIVE"), onclick: () => addBreakpoint() }, t("Hold before")));
  const undo = el("button", { id: "undo", hidden: true, onclick: () => control.ask("change", { facts: undo.title }) });
  form.append(undo);
  const preview = new PlanPreview(control);
  const points = el("div", { id: "breakpoints", class: "choices", role: "group", "aria-label": t("Breakpoints") });
  section.append(form, points, preview.box);
  const offered = el("div", { id: "offered-goals", class: "choices", role: "group", "aria-label": t("Goals of the application") });
  section.append(offered);
  const completion = new Completion(store, goal);
  const send = async (what, fields) => {
    completion.close();
    const sent = goal.value;
    const done = await control.ask(what, fields);
    if (done && goal.value === sent) goal.value = "";
  };
  const setFacts = () => send("change", { facts: goal.value });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    send("send", { goal: goal.value, priority: Number.parseInt(priority.value, 10) || 0 });
  });
  const breakpoints = () => breakpointsOf(store.state);
  const addBreakpoint = () => send("breakpoints", { before: [...new Set([...breakpoints(), goal.value.trim()])] });
  for (const view of ["now", "machines"]) store.view(view, () => keyed(points, breakpoints(), (text) => text,
    (text) => el("button", { title: t("Takes this breakpoint away"), onclick: () => control.ask("breakpoints", { before: breakpoints().filter((each) => each !== text) }) }, `⏸ ${text} ×`),
    () => {}));
  store.view("control", ({ goals = [], undo: back }) => {
    keyed(offered, goals, (each) => each.name,
      (each) => el("button", { title: each.goal, onclick: () => control.ask("send", { goal: each.goal, priority: each.priority }) }, each.name),
      () => {});
    tell(undo, back && t("Set back: {what}", { what: say(back.words) }));
    if (back) undo.title = back.facts;
  });
  store.view("meta", () => setHidden(section, !control.possible() || !control.token));
}

class Completion {
  constructor(store, goal) {
    this.store = store;
    this.choices = [];
    this.chosen = -1;
    goal.addEventListener("input", () => this.suggest());
    goal.addEventListener("click", () => this.suggest());
    goal.addEventListener("keydown", (event) => this.key(event));
    goal.addEventListener("blur", () => setTimeout(() => this.close(), 150));
  }

  suggest() {
    const goal = byId("goal");
    this.choices = complete(goal.value, goal.selectionStart, this.store.state.knowledge || {});
    this.chosen = this.choices.length ? 0 : -1;
    this.draw();
  }

  draw() {
    const list = byId("goal-choices");
    const open = this.choices.length > 0;
    setHidden(list, !open);
    byId("goal").setAttribute("aria-expanded", String(open));
    byId("goal").setAttribute("aria-activedescendant", open ? `choice-${this.chosen}` : "");
    list.replaceChildren(...this.choices.map((choice, index) => el("li", {
      id: `choice-${index}`, role: "option", "aria-selected": String(index === this.chosen),
      onpointerdown: (event) => { event.preventDefault(); this.take(index); },
    }, choice.text, el("span", {}, choice.note))));
    const active = list.children[this.chosen];
    if (active) active.scrollIntoView({ block: "nearest" });
  }

  key(event) {
    if (!this.choices.length) {
      if (event.key === "ArrowDown") this.suggest();
      return;
    }
    const moves = { ArrowDown: 1, ArrowUp: -1 };
    if (has(moves, event.key)) {
      this.chosen = (this.chosen + moves[event.key] + this.choices.length) % this.choices.length;
      this.draw();
    } else if (event.key === "Tab" || (event.key === "Enter" && this.choices[this.chosen].text !== this.choices[this.chosen].typed)) {
      this.take(this.chosen);
    } else if (event.key === "Escape") {
      this.close();
    } else {
      return;
    }
    event.preventDefault();
  }

  take(index) {
    const goal = byId("goal");
    const { text, from, to } = this.choices[index];
    goal.value = goal.value.slice(0, from) + text + goal.value.slice(to);
    goal.setSelectionRange(from + text.length, from + text.length);
    goal.focus();
    this.suggest();
  }

  close() {
    this.choices = [];
    this.draw();
  }
}
