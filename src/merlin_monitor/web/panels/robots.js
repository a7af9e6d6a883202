// SPDX-License-Identifier: Apache-2.0
// Which robot of the plan does what, and why one takes no actions.
import { el, keyed, part, setHidden, setText } from "../dom.js";
import { say, t } from "../texts.js";

export function show(section, { store }) {
  const list = el("ul", { id: "robots-list", "aria-label": t("Robots") });
  section.append(list);
  const draw = () => {
    const robots = (store.state.robots || {}).robots || {};
    setHidden(section, !Object.keys(robots).length);
    keyed(list, Object.keys(robots).sort(), (name) => name,
      () => el("li", {}, el("b", {}), " ", el("span", { class: "does" })),
      (row, name) => {
        const { away, does = [], words = does } = robots[name];
        setText(row.firstChild, name);
        row.toggleAttribute("data-away", Boolean(away));
        setText(part(row, "does"), away || words.map(say).join(", ") || t("waits"));
        row.title = does.join(" ");
      });
  };
  store.view("robots", draw);
}
