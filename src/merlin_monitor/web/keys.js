// SPDX-License-Identifier: Apache-2.0
// What the keyboard does, and the list of it.
import { byId, el, of } from "./dom.js";
import { t } from "./texts.js";

const HELP = [
  ["1 – 9", t("to a section, in the order of the links at the top")],
  ["0", t("to what the robot does now")],
  ["/", t("search the knowledge")],
  ["g", t("write a goal")],
  ["p", t("pause or resume")],
  ["Shift + S", t("stop and hold")],
  ["Shift + X", t("cancel all")],
  ["s, n", t("where it is held: one step; on to the next breakpoint")],
  ["y", t("confirm the outcome that waits")],
  ["a", t("choose the autonomy level")],
  ["o", t("sign in or out")],
  ["w", t("wall display on or off")],
  ["+ and −, arrows", t("in the map and in graphs: larger, smaller, move")],
  [", and .", t("to the event before, to the next one")],
  ["f, c, r", t("to the next failure, cancel, replan; with Shift to the one before")],
  ["k", t("play what happened, or stop that")],
  ["t, arrows", t("to any moment of the history")],
  ["l, Esc", t("back to the present")],
  ["Tab, Enter", t("to the next button, press it")],
  ["Esc", t("leave a field, close a window")],
  ["?", t("this list")],
];

export function keys(go) {
  const list = el("dl", {}, HELP.flatMap(([key, what]) => [el("dt", {}, el("kbd", {}, key)), el("dd", {}, what)]));
  const close = el("button", { type: "submit", class: "primary" }, t("Close"));
  const help = el("dialog", { id: "keys", "aria-labelledby": "keys-title" },
    el("h2", { id: "keys-title" }, t("Keys")), list, el("form", { method: "dialog", class: "buttons" }, close));
  document.body.append(help);
  const open = () => help.open || help.showModal();
  byId("keys-open").addEventListener("click", open);
  const press = (id) => { const button = byId(id); if (button && button.checkVisibility()) button.click(); };
  const does = {
    "?": open,
    0: () => go("now"),
    "/": () => { go("knowledge"); focus("search"); },
    g: () => { go("control"); focus("goal"); },
    p: () => press("pause"),
    S: () => press("stop"),
    X: () => press("cancel-all"),
    s: () => press("step"),
    n: () => press("go-on"),
    y: () => press("confirm"),
    a: () => { go("now"); focus("autonomy"); },
    o: () => press("operator"),
    w: () => press("wall"),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || document.querySelector("dialog[open]")) return;
    const field = event.target.closest("input, textarea, select");
    if (field && field.checkVisibility()) { // one of a window that was just closed may have the focus for a moment
      if (event.key === "Escape") event.target.blur();
      return;
    }
    const link = document.querySelector(`nav a[data-key="${CSS.escape(event.key)}"]`);
    const act = link ? () => link.click() : of(does, event.key);
    if (!act) return;
    event.preventDefault();
    act();
  });
}

function focus(id) {
  const field = byId(id);
  if (field && field.checkVisibility()) field.focus();
}
