// SPDX-License-Identifier: Apache-2.0
// What the velocity guards say while a base may not drive, or does not drive as it should.
import { el, has, keyed, setHidden, setText } from "../dom.js";
import { say, t } from "../texts.js";

const WORDS = { silent: t("The base is not watched"), holding: t("The base is held") };
const HELD = t("Nothing moves the base until it is released.");
const PARTLY = t("Not all robots are held.");

export function show(section, { store, control }) {
  const says = el("p", { id: "guard-says" });
  const release = el("button", { id: "release", hidden: true, class: "primary", onclick: () => control.ask("release") }, t("Release"));
  section.setAttribute("role", "alert");
  const list = el("ul", { id: "guard-robots" });
  section.append(says, list, release);
  const words = ({ state, reason, warning, held_words: held }) => say(held) || (has(WORDS, state) ? `${WORDS[state]}: ${t(reason)}` : warning || t("not held"));
  const draw = () => {
    const guard = store.state.guard || {};
    const robots = guard.robots || {};
    const held = ["stopped", "partly"].includes(guard.state); // the headline says by whom
    const told = held || has(WORDS, guard.state);
    setHidden(section, !told && !guard.warning);
    setText(says, guard.state === "stopped" ? HELD : held ? PARTLY : told ? `${WORDS[guard.state]}: ${t(guard.reason)}` : guard.warning || "");
    keyed(list, Object.keys(robots).sort(), (name) => name, () => el("li", {}),
      (row, name) => setText(row, `${name || t("the base")}: ${words(robots[name])}`));
    section.dataset.state = guard.state || "";
    setHidden(release, !held || !control.possible());
  };
  store.view("guard", draw);
  store.view("meta", draw);
}
