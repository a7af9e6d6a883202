// The stop button, and what the velocity guard says.
import { byId, setHidden, setText } from "./dom.js";

const WORDS = { stopped: "The base is stopped", silent: "The base is not watched", holding: "The base is held" };

export function showGuard(store, control) {
  for (const what of ["stop", "release"]) {
    byId(what).addEventListener("click", async () => {
      if (!(await control.ask(what, {}))) byId("control").scrollIntoView({ block: "center" });
    });
  }
  const draw = () => {
    const guard = store.state.guard || {};
    const told = Object.prototype.hasOwnProperty.call(WORDS, guard.state);
    setHidden(byId("guard"), !told);
    setText(byId("guard-says"), told ? `${WORDS[guard.state]}: ${guard.reason}` : "");
    byId("guard").dataset.state = guard.state || "";
    setHidden(byId("release"), guard.state !== "stopped" || !control.possible());
    setHidden(byId("stop"), !control.possible());
  };
  store.view("guard", draw);
  store.view("meta", draw);
}
