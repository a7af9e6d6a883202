// What the velocity guard says while the base may not drive.
import { el, setHidden, setText } from "../dom.js";

const WORDS = { stopped: "The base is stopped", silent: "The base is not watched", holding: "The base is held" };

export function show(section, { store, control }) {
  const says = el("p", { id: "guard-says" });
  const release = el("button", { id: "release", type: "button", hidden: true, onclick: () => control.ask("release", {}) }, "Release");
  section.setAttribute("role", "alert");
  section.append(says, release);
  const draw = () => {
    const guard = store.state.guard || {};
    const told = Object.prototype.hasOwnProperty.call(WORDS, guard.state);
    setHidden(section, !told);
    setText(says, told ? `${WORDS[guard.state]}: ${guard.reason}` : "");
    section.dataset.state = guard.state || "";
    setHidden(release, guard.state !== "stopped" || !control.possible());
  };
  store.view("guard", draw);
  store.view("meta", draw);
}
