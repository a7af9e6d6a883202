// SPDX-License-Identifier: Apache-2.0
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
      el("button", { class: "close", onclick: () => setHidden(this.box, true) }, t("Close")));
  }

  async ask(goal, without = []) {
    const answer = await this.control.ask("plan", { goal, without });
    if (answer && answer.plan) this.draw(answer.plan);
  }

  draw({ goal, words, after, without, steps, seconds }) {
    const what = say(words);
    setText(part(this.box, "title"), steps.length
      ? t("Not carried out: {goal} in {count} steps, {time}", { goal: what, count: steps.length, time: secondsText(seconds) })
      : t("Not carried out: {goal} holds already", { goal: what }));
    setText(part(this.box, "left-out"), [after.length ? t("Begins when this has ended: {what}", { what: say(after) }) : "", without.length ? t("Without: {actions}", { actions: without.join(" ") }) : ""].join(" "));
    part(this.box, "steps").replaceChildren(...steps.map((step) => el("li", { title: step.text },
      el("span", { class: "when number" }, secondsText(step.start)),
      el("span", { class: "text" }, say(step.words)),
      el("span", { class: "when number" }, step.duration ? secondsText(step.duration) : ""),
      el("button", {
        "aria-label": t("Another plan without {what}", { what: say(step.words) }),
        onclick: () => this.ask(goal, [...without, step.text]),
      }, t("Without this")))));
    setHidden(this.box, false);
    byId("preview").scrollIntoView({ block: "nearest" });
  }
}
