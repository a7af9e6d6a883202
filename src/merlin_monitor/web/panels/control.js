// Sends goals in PDDL, completed from the domain and the objects.
import { byId, el, setHidden } from "../dom.js";
import { complete } from "../completion.js";

export function show(section, { store, control }) {
  const goal = el("input", {
    id: "goal", class: "code", role: "combobox", "aria-expanded": "false", "aria-controls": "goal-choices",
    "aria-autocomplete": "list", spellcheck: "false", placeholder: "(checked kitchen)",
  });
  const priority = el("input", { id: "priority", type: "number", value: "0", step: "1" });
  const field = (input, label, ...more) => el("div", { class: "field" }, el("label", { for: input.id }, label), input, ...more);
  const goalField = field(goal, "Goal in PDDL", el("ul", { id: "goal-choices", role: "listbox", "aria-label": "Completions", hidden: true }));
  goalField.classList.add("grow");
  const form = el("form", { id: "goal-form", autocomplete: "off" },
    goalField, field(priority, "Priority"), el("button", { type: "submit", class: "primary" }, "Send goal"));
  section.append(form);
  const completion = new Completion(store, goal);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    completion.close();
    const sent = goal.value;
    const done = await control.ask("send", { goal: sent, priority: Number.parseInt(priority.value, 10) || 0 });
    if (done && goal.value === sent) goal.value = "";
  });
  store.view("meta", () => setHidden(section, !control.possible()));
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
    if (event.key in moves) {
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
