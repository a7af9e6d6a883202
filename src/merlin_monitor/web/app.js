// SPDX-License-Identifier: Apache-2.0
// Puts the panels together, as the monitor lists them, and lets the keyboard reach them.
import { Control } from "./control.js";
import { byId, clockText, el, setText, tell, useSimulatedTime } from "./dom.js";
import { keys } from "./keys.js";
import { Store } from "./store.js";
import { t } from "./texts.js";
import { wall } from "./wall.js";
import { TimeBar } from "./time_bar.js";
import { newsText } from "./truth.js";

const store = new Store();
const control = new Control(store);
const main = document.querySelector("main");
const links = document.querySelector("nav");
const PRESS = 1000; // ms that a press may take
const TAP = 100; // ms from the end of a touch to its click
let listed = ""; // the panels that are shown, and of which recording

for (const element of document.querySelectorAll("[data-t]")) setText(element, t(element.textContent));
for (const element of document.querySelectorAll("[data-t-label]")) {
  for (const name of ["title", "aria-label"]) if (element.hasAttribute(name)) element.setAttribute(name, t(element.getAttribute(name)));
}
wall();
keys(go);

new TimeBar(store);
store.onConnection(drawConnection);

// What is pressed stays where it is until it is let go: else the browser clicks nothing.
const on = (name, call) => addEventListener(name, call, true);
on("pointerdown", ({ target }) => target.closest("input") || store.hold(PRESS)); // a slider is seen to move
on("pointerup", () => store.held && store.hold(TAP));
on("click", () => store.release());

function drawConnection() {
  const shown = store.past ? "past" : "live"; // t("past")
  byId("connection").dataset.state = store.connected ? shown : "lost";
  setText(byId("connection"), store.connected ? t(shown) : newsText(store.heardAt));
  document.body.dataset.news = store.connected ? shown : "none";
  tell(byId("refused"), store.refused);
}

store.view("meta", (meta) => {
  drawConnection();
  useSimulatedTime(Boolean(meta.simulated));
  setText(byId("robot"), meta.robot);
  setText(byId("clock"), clockText(meta.time + (meta.clock_set || 0)));
  const simulator = meta.simulator;
  setText(byId("simulator"), simulator ? (simulator.paused ? t("simulation paused") : t("simulated, ×{factor}", simulator)) : "");
});

store.viewLive(({ meta = {}, visitor = "" }) => {
  const shown = JSON.stringify([meta.panels || [], meta.archive || "", visitor]);
  if (shown === listed) return;
  if (listed) {
    // Started again with other panels, or a recording is served here now, or none any more.
    const recorded = JSON.parse(listed)[1];
    if (recorded && !meta.archive) history.replaceState(null, "", location.pathname + location.search); // its moments are of another run
    location.reload();
    return;
  }
  listed = shown;
  if (visitor) main.append(el("p", { id: "look", class: "card" }, t(visitor))); // t("Sign in to see what the robot does.")
  Promise.all((meta.panels || []).map(add)).then(() => { document.documentElement.dataset.panels = "shown"; });
});
store.connect();

async function add({ name, title, width }) {
  const section = el("section", { id: name, class: title && "card", "aria-label": t(title || name), tabindex: -1 });
  section.style.setProperty("--columns", width);
  const silent = el("span", { class: "silent", hidden: true });
  if (title) {
    section.append(el("h2", {}, `${t(title)} `, el("span", { class: "aside", id: `${name}-note` }), silent));
    const key = String(links.children.length + 1);
    const link = el("a", { href: `#${name}`, title: t("key {key}", { key }), "data-key": key, onclick: (event) => { event.preventDefault(); go(name); } }, t(title));
    links.append(link);
  } else {
    section.append(silent);
  }
  main.append(section);
  // Grey while the source of the section is gone or hangs.
  store.view(name, ({ silent: what }) => {
    section.toggleAttribute("data-silent", Boolean(what));
    tell(silent, what && t("no news since {time}: {node} {what}", { time: clockText(what.since), node: what.node || t("its source"), what: t(what.what) }));
  });
  try {
    const panel = await import(`./panels/${name}.js`);
    if (panel.style) await dress(panel.style);
    panel.show(section, { store, control });
  } catch (error) {
    console.error(`${name} cannot be drawn`, error); // the other panels still can
    section.append(el("p", { class: "trouble" }, t("This panel cannot be drawn: {error}", { error })));
  }
}

async function dress(text) {
  const sheet = new CSSStyleSheet();
  document.adoptedStyleSheets = [...document.adoptedStyleSheets, await sheet.replace(text)];
}

function go(id) {
  const section = byId(id);
  if (!section) return;
  section.scrollIntoView();
  section.focus({ preventScroll: true });
}
