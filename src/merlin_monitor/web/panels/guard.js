// What the velocity guard says while the base may not drive, or does not drive as it should.
import { el, setHidden, setText } from "../dom.js";
import { t } from "../texts.js";

const WORDS = { silent: t("The base is not watched"), holding: t("The base is held") };
const HELD = t("Nothing moves the base until it is released.");

export function show(section, { store, control }) {
  const says = el("p", { id: "guard-says" });
  const release = el("button", { id: "release", type: "button", hidden: true, class: "primary", onclick: () => control.ask("release") }, t("Release"));
  section.setAttribute("role", "alert");
  section.append(says, release);
  const draw = () => {
    const guard = store.state.guard || {};
    const held = guard.state === "stopped"; // the headline says by whom
    const told = held || Object.prototype.hasOwnProperty.call(WORDS, guard.state);
    setHidden(section, !told && !guard.warning);
    setText(says, held ? HELD : told ? `${WORDS[guard.state]}: ${t(guard.reason)}` : guard.warning || "");
    section.dataset.state = guard.state || "";
    setHidden(release, !held || !control.possible());
  };
  store.view("guard", draw);
  store.view("meta", draw);
}
