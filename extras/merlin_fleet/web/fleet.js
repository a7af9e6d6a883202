// SPDX-License-Identifier: Apache-2.0
// The robots of the fleet, when one was not heard of, and the goals with their owners.
import { el, keyed, part, setHidden, setText } from "../dom.js";
import { language, t } from "../texts.js";

const GOOD = ["succeeded", "already true"];
const CALM = ["open", "owned", "cancelling", "cancelled"];
const moment = (at) => new Date(at * 1000).toLocaleString(language);
const row = (...more) => el("li", {}, el("div", { class: "head" }, el("span", { class: "title" }), el("span", { class: "end chip" }), ...more), el("div", { class: "more" }));

function fill(item, title, chip, tone, more) {
  setText(part(item, "title"), title);
  part(item, "chip").className = `end chip ${tone}`;
  setText(part(item, "chip"), chip);
  setText(part(item, "more"), more);
}

const about = ({ robot, finish, over, why }) =>
  [robot && (over ? robot : finish ? t("{robot}, which finishes it without the hub too", { robot }) : t("{robot}, on its lease", { robot })), why].filter(Boolean).join(" – ");

export const style = "#fleet-robots .stale :is(.title, .more) { color: var(--soft); filter: grayscale(1); }";

export function show(section, { store, control }) {
  const link = el("p", { class: "empty", role: "status" });
  const robots = el("ul", { class: "rows", id: "fleet-robots", "aria-label": t("Robots") });
  const goals = el("ul", { class: "rows", id: "fleet-goals", "aria-label": t("Goals") });
  const more = el("p", { class: "empty" });
  section.append(link, robots, goals, more);
  const goalRow = ({ id }) => row(el("button", { class: "small cancel", type: "button", onclick: () => control.ask("cancel", { request: id }) }, t("Cancel")));
  const draw = (fleet) => {
    const { missing, missing_since: since } = fleet;
    setHidden(section, !fleet.robots && !missing);
    setHidden(link, !missing);
    setText(link, since ? t("Without the hub since {time}: {why}", { time: moment(since), why: missing }) : missing || "");
    keyed(robots, Object.entries(fleet.robots || {}), ([name]) => name, () => row(), (item, [name, robot]) => {
      item.classList.toggle("stale", !robot.joined); // grey: what is said of it is of the moment at which it was heard of
      fill(item, name, robot.joined ? t("joined") : t("not seen since {time}", { time: moment(robot.heard) }), robot.joined ? (missing ? "" : "good") : "bad",
        [robot.is.join(", "), ...robot.has].filter(Boolean).join(" – "));
    });
    keyed(goals, fleet.goals || [], ({ id }) => id, goalRow, (item, goal) => {
      fill(item, goal.text, t(goal.state), GOOD.includes(goal.state) ? "good" : CALM.includes(goal.state) ? "" : "bad", about(goal));
      setHidden(part(item, "cancel"), !fleet.cancels || goal.over || goal.state === "cancelling" || !control.possible());
    });
    setHidden(more, !fleet.more);
    setText(more, t("and {count} goals more", { count: fleet.more || 0 }));
  };
  store.view("fleet", draw);
  store.view("meta", () => draw(store.state.fleet || {}));
}
