// Puts the sections together and lets the keyboard reach them.
import { byId } from "./dom.js";
import { Control } from "./control.js";
import { showFreshness } from "./freshness.js";
import { showGuard } from "./guard.js";
import { showHealth } from "./health.js";
import { showHistory } from "./history.js";
import { showKnowledge } from "./knowledge.js";
import { showMachines } from "./machines.js";
import { showMap } from "./map.js";
import { showConnection, showNow } from "./now.js";
import { showPlan } from "./plan.js";
import { showQueue } from "./queue.js";
import { Store } from "./store.js";

const store = new Store();
const control = new Control(store);
showConnection(store);
showNow(store, control);
showGuard(store, control);
showQueue(store, control);
showPlan(store);
showMachines(store);
showMap(store);
showKnowledge(store);
showHistory(store);
showHealth(store);
showFreshness(store);
store.connect();

function go(id) {
  const section = byId(id);
  section.scrollIntoView();
  section.focus({ preventScroll: true });
}

for (const link of document.querySelectorAll("nav a")) {
  link.title = `key ${link.dataset.key}`;
  link.addEventListener("click", (event) => {
    event.preventDefault();
    go(link.hash.slice(1));
  });
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, textarea")) {
    if (event.key === "Escape") event.target.blur();
    return;
  }
  if (event.key === "/") {
    event.preventDefault();
    go("knowledge");
    byId("search").focus();
    return;
  }
  if (event.key === "0") go("now");
  const link = document.querySelector(`nav a[data-key="${CSS.escape(event.key)}"]`);
  if (link) go(link.hash.slice(1));
});
