// SPDX-License-Identifier: Apache-2.0
// What the robot does now, and why.
import { byId, el, keyed, secondsText, setHidden, setText, tell } from "../dom.js";
import { glance } from "../glance.js";
import { LEVELS, autonomyOf, isHeld, unconfirmed } from "../holds.js";
import { say, t } from "../texts.js";
import { truthOf } from "../truth.js";

export function show(section, { store, control }) {
  section.append(
    el("ol", { id: "now-chain", "aria-label": t("From the mission to the state") }),
    el("p", { id: "now-line", "aria-live": "polite" }, el("span", { id: "now-doing" })),
    el("p", { id: "now-trouble", role: "alert", hidden: true }),
    el("p", { id: "now-why" }, el("span", { id: "now-because" }), " ", el("span", { id: "now-step" })),
    glance(store, control),
    el("p", { id: "now-last" }),
    el("div", { id: "robot-control", class: "buttons", hidden: true }),
  );
  const buttons = byId("robot-control");
  const shownIcon = document.querySelector("link[rel=icon]");
  const pause = el("button", { id: "pause", onclick: () => control.ask(pause.value) });
  buttons.append(pause, el("button", { id: "cancel-all", onclick: () => control.ask("cancel_all") }, t("Cancel all")));
  const held = el("span", { class: "buttons" },
    el("button", { id: "step", title: t("One action or state begins, and the next one is held"), onclick: () => control.ask("step") }, t("Step")),
    el("button", { id: "go-on", title: t("Goes on up to the next breakpoint"), onclick: () => control.ask("continue") }, t("Continue")));
  const confirm = el("span", { class: "buttons" });
  const level = el("select", { id: "autonomy", onchange: () => setAutonomy(level.value) },
    LEVELS.map((each) => el("option", { value: each }, t(each))));
  const autonomy = el("label", { class: "buttons", title: t("Outcomes that require a higher level wait until an operator confirms them") }, t("Autonomy"), level);
  const showLevel = () => { if (level.value !== autonomyOf(store.state)) level.value = autonomyOf(store.state); };
  const setAutonomy = (wanted) => {
    showLevel(); // what is chosen is shown when it is so
    control.ask("autonomy", { level: wanted });
  };
  buttons.append(held, confirm, autonomy);
  const paused = () => Boolean(((store.state.now || {}).executor || {}).paused) || ((store.state.now || {}).mission || {}).state === "paused";
  const showButtons = () => {
    setHidden(buttons, !control.possible() || !(store.state.now || {}).executor);
    setHidden(held, !isHeld(store.state));
    keyed(confirm, unconfirmed(store.state), (each) => each.join(" "),
      ([state, outcome, within]) => el("button", { class: "primary", title: state, onclick: () => control.ask("leave", { state, within }) }, t("Confirm {outcome}", { outcome })),
      (button, each, index) => (index ? button.removeAttribute("id") : button.setAttribute("id", "confirm"))); // the key takes the first one
    setHidden(autonomy, !autonomyOf(store.state));
    showLevel();
    setHidden(pause, ["stopped", "partly"].includes((store.state.guard || {}).state)); // nothing begins before the release
    pause.value = paused() ? "resume" : "pause"; // what it says is what it does
    setText(pause, paused() ? t("Resume") : t("Pause"));
    pause.title = paused() ? t("Lets the next goal begin") : t("Lets what runs end, and nothing else begin");
  };
  store.view("now", (now) => {
    const { doing, because, step, tone } = truthOf({ now }, store.alive, store.heardAt);
    setText(byId("now-doing"), doing);
    setText(byId("now-because"), because);
    setText(byId("now-step"), step);
    keyed(
      byId("now-chain"), now.chain || [], ([what]) => what,
      ([what]) => el("li", {}, el("span", { class: "what" }, `${t(what)}: `), el("span", { class: "text" })),
      (item, [, words, detail = ""]) => {
        setText(item.lastChild, say(words));
        if (item.title !== detail) item.title = detail; // the same in PDDL
      },
    );
    const last = now.last;
    const why = last ? say(last.said) : "";
    const reason = why && `: ${why}`;
    byId("now-last").title = why ? last.reason : "";
    setText(byId("now-last"), last ? t("Before: {goals} {outcome} after {time}", { goals: say(last.words) || t("a request"), outcome: t(last.outcome), time: secondsText(last.seconds) }) + reason : "");
    tell(byId("now-trouble"), (now.trouble_said || []).map(say).join(" · "));
    document.title = doing ? `${tone === "bad" ? "⚠ " : ""}${doing} – MERLIN` : "MERLIN";
    const icon = tone === "bad" ? "icon-bad.svg" : "icon.svg";
    if (shownIcon.getAttribute("href") !== icon) shownIcon.setAttribute("href", icon);
    showButtons();
  });
  store.view("machines", showButtons);
  store.view("meta", showButtons);
  store.view("guard", showButtons);
}
