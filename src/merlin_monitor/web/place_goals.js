// SPDX-License-Identifier: Apache-2.0
// Goals for a point of interest: what the application offers for it, and what its operators can make true of it.
import { isA } from "./completion.js";
import { el, of, setText } from "./dom.js";
import { factWords, objectWords } from "./pddl_words.js";
import { t } from "./texts.js";

const MOST = 24; // goals that are offered at once
const MANY = 8; // objects for another variable, beyond which a goal is left out

// [{name, goal, priority}] for the object of this name.
export function goalsOf(place, { control = {}, knowledge = {} }) {
  const found = new Map();
  for (const offered of control.goals || []) {
    if (offered.goal.split(/[\s()]+/).includes(place)) found.set(offered.goal, offered);
  }
  for (const goal of reachable(place, knowledge)) {
    if (!found.has(goal)) found.set(goal, { name: factWords(goal, knowledge.words, true), goal, priority: 0 });
  }
  return [...found.values()].slice(0, MOST);
}

function reachable(place, { domain = {}, objects = {} }) {
  const types = domain.types || {};
  const kind = (of(objects, place) || {}).type;
  const goals = new Set();
  if (!kind) return goals;
  for (const [operator, effects] of Object.entries(domain.adds || {})) {
    const variables = new Map(of(domain.operators, operator) || []);
    for (const [predicate, ...names] of effects) {
      names.forEach((name, at) => {
        if (!variables.has(name) || !isA(kind, variables.get(name), types)) return;
        let ways = [[]];
        names.forEach((other, position) => {
          const choices = position === at ? [place] : variables.has(other) ? all(objects, variables.get(other), types) : [other];
          ways = choices.length > MANY ? [] : ways.flatMap((way) => choices.map((choice) => [...way, choice]));
        });
        for (const way of ways) goals.add(`(${[predicate, ...way].join(" ")})`);
      });
    }
  }
  return goals;
}

const all = (objects, type, types) => Object.keys(objects).filter((name) => isA(objects[name].type, type, types));

// A window with the goals of a place, from which one is sent.
export class PlaceGoals {
  constructor(store, control) {
    this.store = store;
    this.control = control;
    this.title = el("h2", { id: "place-title" });
    this.list = el("div", { id: "place-list", class: "buttons" });
    const close = el("form", { method: "dialog", class: "buttons" }, el("button", { type: "submit" }, t("Close")));
    this.dialog = el("dialog", { id: "place-goals", "aria-labelledby": "place-title" }, this.title, this.list, close);
    document.body.append(this.dialog);
  }

  open(place) {
    const goals = goalsOf(place, this.store.state);
    setText(this.title, t("Goals at {place}", { place: objectWords(place, (this.store.state.knowledge || {}).words) }));
    const buttons = goals.map(({ name, goal, priority }) => el("button", {
      title: goal,
      onclick: () => { this.dialog.close(); this.control.ask("send", { goal, priority }); },
    }, name));
    this.list.replaceChildren(...(buttons.length ? buttons : [el("p", { class: "empty" }, t("No action makes anything true here."))]));
    this.dialog.showModal();
  }
}
