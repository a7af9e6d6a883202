// What the robot does now, and why.
import { byId, clockText, el, keyed, secondsText, setHidden, setText, useSimulatedTime } from "./dom.js";

export function showNow(store, control) {
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
    control.showMission(now.mission);
  });
  store.view("meta", (meta) => {
    useSimulatedTime(Boolean(meta.simulated));
    setText(byId("robot"), meta.robot);
    setText(byId("clock"), clockText(meta.time));
    const simulator = meta.simulator;
    setText(byId("simulator"), simulator ? (simulator.paused ? "simulation paused" : `simulated, ×${simulator.factor}`) : "");
    setHidden(byId("control"), !meta.control);
  });
}

export function showConnection(store) {
  const shown = byId("connection");
  store.onConnection((connected) => {
    shown.dataset.state = connected ? "live" : "lost";
    const since = store.heardAt ? `no news since ${store.heardAt.toLocaleTimeString()}` : "no connection";
    setText(shown, connected ? "live" : since);
    document.body.dataset.news = connected ? "live" : "none";
  });
}
