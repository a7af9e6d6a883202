// Controls the robot, for who has the token: goals in PDDL, cancels, pausing the mission.
import { byId, el, setHidden, setText } from "./dom.js";
import { complete } from "./completion.js";

const TOKEN = "merlin-token";

export class Control {
  constructor(store) {
    this.store = store;
    this.choices = [];
    this.chosen = -1;
    const token = byId("token");
    token.value = sessionStorage.getItem(TOKEN) || "";
    token.addEventListener("input", () => sessionStorage.setItem(TOKEN, token.value));
    const goal = byId("goal");
    goal.addEventListener("input", () => this.suggest());
    goal.addEventListener("click", () => this.suggest());
    goal.addEventListener("keydown", (event) => this.key(event));
    goal.addEventListener("blur", () => setTimeout(() => this.close(), 150));
    byId("goal-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.close();
      this.ask("send", { goal: goal.value, priority: Number.parseInt(byId("priority").value, 10) || 0 });
    });
  }

  possible() {
    return Boolean((this.store.state.meta || {}).control);
  }

  cancel(request) {
    this.ask("cancel", { request });
  }

  showMission(mission) {
    const box = byId("mission-control");
    const state = mission && this.possible() ? mission.state : "";
    const wanted = state === "running" ? "pause" : state === "paused" ? "resume" : "";
    setHidden(box, !wanted);
    if (box.dataset.wanted === wanted) return;
    box.dataset.wanted = wanted;
    box.replaceChildren(...(wanted ? [el("button", { type: "button", onclick: () => this.ask(wanted, {}) }, wanted === "pause" ? "Pause the mission" : "Resume the mission")] : []));
  }

  // Whether it was done; what was said about it stands in the section.
  async ask(what, fields) {
    const said = byId("control-said");
    try {
      const answer = await fetch(`/control/${what}`, {
        method: "POST",
        headers: { "Content-Type": "application/json", "X-Merlin-Token": encodeToken(byId("token").value) },
        body: JSON.stringify(fields),
      });
      const text = await answer.text();
      let words = text;
      try {
        const object = JSON.parse(text);
        words = object.done || object.error || text;
      } catch {
        // a refusal is plain text
      }
      said.toggleAttribute("data-bad", !answer.ok);
      setText(said, words.trim());
      return answer.ok;
    } catch {
      said.toggleAttribute("data-bad", true);
      setText(said, "The monitor does not answer.");
      return false;
    }
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

// A header takes no characters beyond Latin-1.
function encodeToken(token) {
  return unescape(encodeURIComponent(token));
}
