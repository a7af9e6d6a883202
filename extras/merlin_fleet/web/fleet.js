// SPDX-License-Identifier: Apache-2.0
// The robots of the fleet: what each does, where, and how old that is; and the goals with their owners.
import { el, keyed, part, secondsText, setHidden, setText, tell } from "../dom.js";
import { language, say, t } from "../texts.js";

const GOOD = ["succeeded", "already true"];
const CALM = ["open", "owned", "cancelling", "cancelled"];
const moment = (at) => new Date(at * 1000).toLocaleString(language);
const OLD = 25; // s since its last word: a robot says each 10 s that it is there
const row = (...more) => el("li", {}, el("div", { class: "head" }, el("span", { class: "title" }), el("span", { class: "end chip" }), ...more), el("div", { class: "does" }), el("div", { class: "more" }));

function fill(item, title, chip, tone, more) {
  setText(part(item, "title"), title);
  part(item, "chip").className = `end chip ${tone}`;
  setText(part(item, "chip"), chip);
  setText(part(item, "more"), more);
}

const about = ({ robot, finish, over, why }) =>
  [robot && (over ? robot : finish ? t("{robot}, which finishes it without the hub too", { robot }) : t("{robot}, on its lease", { robot })), why].filter(Boolean).join(" – ");

// Simulated time says nothing of an age.
const ageOf = ({ spoke }, { simulated, time }) => (simulated || !time || !spoke ? 0 : Math.max(0, time - spoke));
const where = ({ place, at }) => [place && t("at {place}", { place }), at && `(${at.join(", ")}) m`].filter(Boolean).join(" ");

function doing(robot, age) {
  const goals = robot.for && robot.for.length ? t("for {goals}", { goals: say(robot.for) }) : "";
  const words = [[say(robot.does), goals].filter(Boolean).join(", "), where(robot), robot.hold].filter(Boolean).join(" – ") || t("What it does is not known");
  return age ? `${words} – ${t("{age} ago", { age: secondsText(Math.round(age)) })}` : words;
}

export const style = "#fleet-robots .stale :is(.title, .does, .more) { color: var(--soft); filter: grayscale(1); }\n#fleet-robots .stop { background: #b3261e; border-color: #b3261e; color: #fff; }";

export function show(section, { store, control }) {
  const link = el("p", { class: "empty", role: "status" });
  const robots = el("ul", { class: "rows", id: "fleet-robots", "aria-label": t("Robots") });
  const goals = el("ul", { class: "rows", id: "fleet-goals", "aria-label": t("Goals") });
  const more = el("p", { class: "empty" });
  section.append(link, robots, goals, more);
  const goalRow = ({ id }) => row(el("button", { class: "small cancel", type: "button", onclick: () => control.ask("cancel", { request: id }) }, t("Cancel")));
  const robotRow = ([robot]) => row(el("a", { class: "page", target: "_blank", rel: "noreferrer" }, t("Its page")), el("button", { class: "small stop", type: "button", onclick: () => control.ask("stop", { robot }) }, t("Stop")), el("span", { class: "stopping chip bad" }));
  const draw = (fleet) => {
    const meta = store.state.meta || {};
    const { missing, missing_since: since } = fleet;
    setHidden(section, !fleet.robots && !missing);
    tell(link, since ? t("Without the hub since {time}: {why}", { time: moment(since), why: missing }) : missing);
    keyed(robots, Object.entries(fleet.robots || {}), ([name]) => name, robotRow, (item, [name, robot]) => {
      const age = ageOf(robot, meta);
      const lost = !robot.joined || age > OLD;
      item.classList.toggle("stale", lost); // grey: what is said of it is of the moment at which it was heard of
      fill(item, name, lost ? t("not seen since {time}", { time: moment(robot.heard) }) : t("joined"), lost ? "bad" : missing ? "" : "good",
        [robot.is.join(", "), ...robot.has].filter(Boolean).join(" – "));
      setText(part(item, "does"), doing(robot, age));
      setHidden(part(item, "page"), !robot.page);
      if (robot.page) part(item, "page").setAttribute("href", robot.page);
      setHidden(part(item, "stop"), !fleet.controls || !(control.possible() || meta.open_stop));
      tell(part(item, "stopping"), robot.stop && t("stop of {time} NOT confirmed", { time: moment(robot.stop) }));
    });
    keyed(goals, fleet.goals || [], ({ id }) => id, goalRow, (item, goal) => {
      fill(item, goal.text, t(goal.state), GOOD.includes(goal.state) ? "good" : CALM.includes(goal.state) ? "" : "bad", about(goal));
      setHidden(part(item, "cancel"), !fleet.controls || goal.over || goal.state === "cancelling" || !control.possible());
    });
    tell(more, fleet.more ? t("and {count} goals more", { count: fleet.more }) : "");
  };
  store.view("fleet", draw);
  store.view("meta", () => draw(store.state.fleet || {}));
}
