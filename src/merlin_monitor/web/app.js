// Puts the panels together, as the monitor lists them, and lets the keyboard reach them.
import { Control } from "./control.js";
import { byId, clockText, el, setHidden, setText, useSimulatedTime } from "./dom.js";
import { Store } from "./store.js";

const store = new Store();
const control = new Control(store);
const main = document.querySelector("main");
const links = document.querySelector("nav");
let listed = ""; // the panels that are shown

store.onConnection((connected) => {
  const since = store.heardAt ? `no news since ${store.heardAt.toLocaleTimeString()}` : "no connection";
  byId("connection").dataset.state = connected ? "live" : "lost";
  setText(byId("connection"), connected ? "live" : since);
  document.body.dataset.news = connected ? "live" : "none";
});

store.view("meta", (meta) => {
  useSimulatedTime(Boolean(meta.simulated));
  setText(byId("robot"), meta.robot);
  setText(byId("clock"), clockText(meta.time));
  const simulator = meta.simulator;
  setText(byId("simulator"), simulator ? (simulator.paused ? "simulation paused" : `simulated, ×${simulator.factor}`) : "");
  const panels = JSON.stringify(meta.panels || []);
  if (panels === listed) return;
  if (listed) location.reload(); // the monitor was started again, with others
  listed = panels;
  Promise.all(meta.panels.map(add)).then(() => { document.documentElement.dataset.panels = "shown"; });
});
store.connect();

async function add({ name, title, width }) {
  const section = el("section", { id: name, class: title && "card", "aria-label": title || name, tabindex: -1 });
  section.style.setProperty("--columns", width);
  const silent = el("span", { class: "silent", hidden: true });
  if (title) {
    section.append(el("h2", {}, `${title} `, el("span", { class: "aside", id: `${name}-note` }), silent));
    const key = String(links.children.length + 1);
    const link = el("a", { href: `#${name}`, title: `key ${key}`, "data-key": key, onclick: (event) => { event.preventDefault(); go(name); } }, title);
    links.append(link);
  } else {
    section.append(silent);
  }
  main.append(section);
  // Grey while the source of the section is gone or hangs.
  store.view(name, ({ silent: what }) => {
    section.toggleAttribute("data-silent", Boolean(what));
    setHidden(silent, !what);
    setText(silent, what && `no news since ${clockText(what.since)}: ${what.node || "its source"} ${what.what}`);
  });
  try {
    const panel = await import(`/panels/${name}.js`);
    if (panel.style) await dress(panel.style);
    panel.show(section, { store, control });
  } catch (error) {
    console.error(`${name} cannot be drawn`, error); // the other panels still can
    section.append(el("p", { class: "trouble" }, `This panel cannot be drawn: ${error}`));
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

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, textarea")) {
    if (event.key === "Escape") event.target.blur();
    return;
  }
  if (event.key === "/" && byId("search")) {
    event.preventDefault();
    go("knowledge");
    byId("search").focus();
    return;
  }
  if (event.key === "0") go("now");
  const link = links.querySelector(`a[data-key="${CSS.escape(event.key)}"]`);
  if (link) link.click();
});
