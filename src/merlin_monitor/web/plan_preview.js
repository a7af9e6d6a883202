// A plan that is shown and not carried out, and others: without a step of it.
import { byId, el, part, secondsText, setHidden, setText } from "./dom.js";
import { say, t } from "./texts.js";

export class PlanPreview {
  constructor(control) {
    this.control = control;
    this.box = el("div", { id: "preview", hidden: true },
      el("h3", { class: "title" }),
      el("p", { class: "left-out" }),
      el("ol", { class: "steps" }),
      el("button", { type: "button", class: "close", onclick: () => setHidden(this.box, true) }, t("Close")));
  }

  async ask(goal, without = []) {
    const answer = await this.control.ask("plan", { goal, without });
    if (answer && answer.plan) this.draw(answer.plan);
  }

  draw({ goal, without, steps, seconds }) {
    setText(part(this.box, "title"), steps.length
      ? t("Not carried out: {goal} in {count} steps, {time}", { goal, count: steps.length, time: secondsText(seconds) })
      : t("Not carried out: {goal} holds already", { goal }));
    setText(part(this.box, "left-out"), without.length ? t("Without: {actions}", { actions: without.join(" ") }) : "");
    part(this.box, "steps").replaceChildren(...steps.map((step) => el("li", { title: step.text },
      el("span", { class: "when number" }, secondsText(step.start)),
      el("span", { class: "text" }, say(step.words)),
      el("span", { class: "when number" }, step.duration ? secondsText(step.duration) : ""),
      el("button", {
        type: "button", "aria-label": t("Another plan without {what}", { what: say(step.words) }),
        onclick: () => this.ask(goal, [...without, step.text]),
      }, t("Without this")))));
    setHidden(this.box, false);
    byId("preview").scrollIntoView({ block: "nearest" });
  }
}
