// What the robot does now, and why.
import { byId, el, keyed, secondsText, setHidden, setText } from "../dom.js";

export function show(section, { store, control }) {
  section.append(
    el("ol", { id: "now-chain", "aria-label": "From the mission to the state" }),
    el("p", { id: "now-line", "aria-live": "polite" }, el("span", { id: "now-doing" })),
    el("p", { id: "now-trouble", role: "alert", hidden: true }),
    el("p", { id: "now-why" }, el("span", { id: "now-because" }), " ", el("span", { id: "now-step" })),
    el("p", { id: "now-last" }),
    el("div", { id: "robot-control", class: "buttons", hidden: true }),
  );
  const buttons = byId("robot-control");
  const pause = el("button", { type: "button", id: "pause", onclick: () => control.ask(paused() ? "resume" : "pause") });
  buttons.append(pause, el("button", { type: "button", id: "cancel-all", onclick: () => control.ask("cancel_all") }, "Cancel all"));
  const paused = () => Boolean(((store.state.now || {}).executor || {}).paused);
  const showButtons = () => {
    setHidden(buttons, !control.possible() || !(store.state.now || {}).executor);
    setText(pause, paused() ? "Resume" : "Pause");
    pause.title = paused() ? "Lets the next goal begin" : "Lets what runs end, and nothing else begin";
  };
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
    showButtons();
  });
  store.view("meta", showButtons);
}
