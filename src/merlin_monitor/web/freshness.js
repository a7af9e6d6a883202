// Greys a section whose source is gone or hangs, and says since when.
import { byId, clockText, el, part, setHidden, setText } from "./dom.js";

const SECTIONS = ["now", "plan", "queue", "map", "knowledge"];

export function showFreshness(store) {
  for (const name of SECTIONS) {
    const section = byId(name);
    (section.querySelector("h2") || section).append(el("span", { class: "silent", hidden: true }));
    store.view(name, ({ silent }) => {
      const since = silent && `no news since ${clockText(silent.since)}: ${silent.node || "its source"} ${silent.what}`;
      section.toggleAttribute("data-silent", Boolean(silent));
      setText(part(section, "silent"), since);
      setHidden(part(section, "silent"), !silent);
    });
  }
}
