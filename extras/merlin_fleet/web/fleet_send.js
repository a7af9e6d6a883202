// SPDX-License-Identifier: Apache-2.0
// Sends a goal to the fleet, for operators.
import { el, keyed, setHidden } from "../dom.js";
import { t } from "../texts.js";

export function show(section, { store, control }) {
  const goal = el("input", { id: "goal", class: "code", spellcheck: "false", placeholder: "(checked kitchen)" });
  const names = el("datalist", { id: "robot-names" });
  const robot = el("input", { id: "for-robot", list: "robot-names" });
  const groups = el("input", { id: "for-groups", placeholder: "ward, night" });
  const needs = el("input", { id: "for-needs", placeholder: "arm, lamp" });
  const beginBy = el("input", { id: "begin-by", type: "number", min: "1", step: "any" });
  const value = el("input", { id: "value", type: "number", value: "0", step: "any" });
  const finish = el("input", { id: "finish", type: "checkbox", title: t("Its owner finishes it without the hub too") });
  const field = (input, label, ...more) => el("div", { class: "field" }, el("label", { for: input.id }, label), input, ...more);
  const goalField = field(goal, t("Goal in PDDL"));
  goalField.classList.add("grow");
  const form = el("form", { id: "goal-form", autocomplete: "off" }, goalField, field(robot, t("Robot"), names), field(groups, t("Groups")), field(needs, t("Capabilities")),
    field(beginBy, t("Begin within s")), field(value, t("Value")), field(finish, t("Finish")), el("button", { type: "submit", class: "primary" }, t("Send goal")));
  section.append(form);
  const number = (input) => (input.value === "" ? null : Number(input.value));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const sent = goal.value;
    const fields = { goal: sent, robot: robot.value, groups: groups.value, needs: needs.value, begin_by: number(beginBy), value: number(value), finish: finish.checked };
    if ((await control.ask("send", fields)) && goal.value === sent) goal.value = "";
  });
  store.view("fleet", ({ robots = {} }) => keyed(names, Object.keys(robots), (name) => name, (name) => el("option", { value: name }), () => {}));
  store.view("meta", () => setHidden(section, !control.possible()));
}
