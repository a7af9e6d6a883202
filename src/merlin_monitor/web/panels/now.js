// What the robot does now, and why.
import { byId, el, keyed, secondsText, setHidden, setText } from "../dom.js";

export function show(section, { store, control }) {
  section.append(
    el("ol", { id: "now-chain", "aria-label": "From the mission to the state" }),
    el("p", { id: "now-line", "aria-live": "polite" }, el("span", { id: "now-doing" })),
    el("p", { id: "now-trouble", role: "alert", hidden: true }),
    el("p", { id: "now-why" }, el("span", { id: "now-because" }), " ", el("span", { id: "now-step" })),
    el("p", { id: "now-last" }),
    el("div", { id: "mission-control", class: "buttons", hidden: true }),
  );
  const box = byId("mission-control");
  function showPause(mission) {
    const state = mission && control.possible() ? mission.state : "";
    const wanted = state === "running" ? "pause" : state === "paused" ? "resume" : "";
    setHidden(box, !wanted);
    if (box.dataset.wanted === wanted) return;
    box.dataset.wanted = wanted;
    const label = wanted === "pause" ? "Pause the mission" : "Resume the mission";
    box.replaceChildren(...(wanted ? [el("button", { type: "button", onclick: () => control.ask(wanted, {}) }, label)] : []));
  }
  store.view("now", (now) => {
    setText(byId("now-doing"), now.doing);
    setText(byId("now-because"), now.because);
    setText(byId("now-step"), now.step);
    keyed(
      byId("now-chain"), now.chain || [], ([what]) => what,
      ([what]) => el("li", {}, el("span", { class: "what" }, `${what}: `), el("span", { class: "text" })),
      (item, [, text]) => setText(item.lastChild, text),
    );
    const last = now.last;
    const reason = last && last.reason && !["succeeded", "already true"].includes(last.outcome) ? `: ${last.reason}` : "";
    setText(byId("now-last"), last ? `Before: ${last.goals.join(" ") || "a request"} ${last.outcome} after ${secondsText(last.seconds)}${reason}` : "");
    const trouble = now.trouble || [];
    setHidden(byId("now-trouble"), trouble.length === 0);
    setText(byId("now-trouble"), trouble.join(" · "));
    document.title = now.doing ? `${now.doing} – MERLIN` : "MERLIN";
    showPause(now.mission);
  });
  store.view("meta", () => showPause((store.state.now || {}).mission));
}
