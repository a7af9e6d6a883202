// SPDX-License-Identifier: Apache-2.0
// Every state machine: nested, active states marked, the last outcome of each state, userdata on click.
import { byId, clockText, drawPairs, el, keyed, of, part, setHidden, setText, tell } from "../dom.js";
import { GraphView } from "../graph.js";
import { breakpointsOf, heldStates, namespaceOf, stateName, unconfirmed } from "../holds.js";
import { say, t } from "../texts.js";

export function show(section, { store, control }) {
  section.append(
    el("div", { id: "machine-list" }),
    el("p", { id: "machines-empty", class: "empty" }, t("No machine is shown by any node.")),
    el("div", { id: "userdata", role: "region", "aria-label": t("Userdata"), hidden: true }),
  );
  const opened = new Map(); // key → whether the reader wants it unfolded, until it begins or ends
  const views = new Map();
  let picked = null; // key of the container whose userdata is shown
  let clicked = {}; // the state, as it is drawn
  let names = new Map(); // key of a machine → its name

  const containers = () => (store.state.machines || {}).containers || {};

  function draw(machines) {
    const all = machines.containers || {};
    const within = new Set(Object.entries(all).flatMap(([key, { path, children = [] }]) => children.map((label) => beside(all, key, inside(path, label))).filter((inner) => inner !== key)));
    const roots = Object.keys(all).filter((key) => !within.has(key)).sort((a, b) => runs(all[b]) - runs(all[a]) || (all[a].path < all[b].path ? -1 : 1));
    names = namesOf(all, roots);
    setText(byId("machines-note"), roots.length ? t("{running} of {count} running", { count: roots.length, running: roots.filter((key) => runs(all[key])).length }) : "");
    setHidden(byId("machines-empty"), roots.length > 0);
    for (const known of views.keys()) if (!roots.includes(known)) views.delete(known);
    keyed(byId("machine-list"), roots, (key) => key, create, (box, key) => update(box, key, machines));
    drawUserdata();
  }

  function create(key) {
    const title = el("button", { class: "name", onclick: () => fold(key) });
    const graph = el("div", { class: "graph", tabindex: 0, role: "group" });
    views.set(key, new GraphView(graph, { onPick: (node) => pick(key, node) }));
    return el("article", { class: "machine" }, el("div", { class: "bar-of" }, title, el("span", { class: "where" })), graph);
  }

  function update(box, key, machines) {
    const all = machines.containers;
    const root = all[key];
    const active = deepest(all, key);
    const running = String(active !== "");
    // Only what runs is unfolded; what the reader wants holds until that changes.
    if (box.dataset.active !== running) opened.delete(key);
    box.dataset.active = running;
    const shut = !(opened.has(key) ? opened.get(key) : active);
    box.classList.toggle("folded", shut);
    setText(part(box, "name"), `${shut ? "▸" : "▾"} ${names.get(key)}`);
    part(box, "name").title = [root.node, root.server, root.path].filter(Boolean).join(" ");
    part(box, "name").setAttribute("aria-expanded", String(!shut));
    const ended = root.outcome ? t("ended with {outcome}", root) : t("idle");
    setText(part(box, "where"), `${active ? `▶ ${active}` : ended}${root.silent ? ` · ${t("silent")}` : ""}`);
    box.toggleAttribute("data-silent", Boolean(root.silent));
    const graph = part(box, "graph");
    setHidden(graph, shut);
    if (shut) return;
    const view = views.get(key);
    graph.setAttribute("aria-label", `${names.get(key)}: ${active ? t("in {state}", { state: active }) : ended}`);
    view.show(of(machines.layouts, key), names.get(key));
    const containerAt = (path) => of(all, beside(all, key, path)) || {};
    view.mark((id, node) => {
      const container = containerAt(homeOf(node));
      if (node.kind === "outcome") {
        const reached = container.outcome === node.text;
        return { reached, label: reached ? t("the last outcome") : "" };
      }
      const on = (container.active || []).includes(node.text);
      const last = of(container.last, node.text);
      const name = stateName(root.server, id);
      const waits = waiting(root.server, name);
      const held = waits || heldStates(store.state, root.node).includes(name);
      return { active: on, glyph: held ? "⏸" : on ? "▶" : "", label: waits ? t("{outcome} waits for an operator", { outcome: waits }) : held ? t("Held") : on ? t("active") : last ? t("left with {outcome}", { outcome: last.join(" / ") }) : "" };
    });
    view.markClusters((path) => runs(containerAt(path)));
    view.markEdges((edge, from, to) => edgeMark(containerAt, view.frames, edge, from, to));
  }

  function fold(key) {
    const container = of(containers(), key);
    if (!container) return;
    opened.set(key, !(opened.has(key) ? opened.get(key) : runs(container)));
    store.refresh("machines");
  }

  function pick(root, node) {
    const key = beside(containers(), root, homeOf(node));
    picked = picked === key && clicked.id === node.id ? null : key;
    clicked = node;
    drawUserdata();
    if (picked) byId("userdata").scrollIntoView({ block: "nearest" });
  }

  // The outcome with which a state waits for an operator.
  const waiting = (server, name) => (unconfirmed(store.state).find(([state, , within]) => state === name && within === namespaceOf(server)) || [])[1];

  // Its outcomes, where an operator can have the state left with one: while it runs, is held or waits.
  function outcomes(container) {
    if (!control.possible() || !(container.active || []).includes(clicked.text)) return [];
    return [...new Set((container.edges || []).filter(([, source]) => source === clicked.text).map(([outcome]) => outcome))];
  }

  function leave(outcome) {
    const { server } = containers()[picked];
    control.ask("leave", { state: stateName(server, clicked.id), outcome, within: namespaceOf(server) });
  }

  function drawUserdata() {
    const box = byId("userdata");
    const container = picked ? of(containers(), picked) : null;
    setHidden(box, !container);
    if (!container) return;
    if (!box.firstChild) {
      box.append(
        el("div", { class: "bar-of" }, el("span", { class: "title" }),
          el("button", { class: "small hold", onclick: () => control.ask("breakpoints", { before: [...new Set([...breakpointsOf(store.state), stateName(containers()[picked].server, clicked.id)])] }) }),
          el("button", { class: "small", onclick: () => { picked = null; drawUserdata(); } }, t("Close"))),
        el("div", { class: "buttons leave", role: "group", "aria-label": t("Leave the state with") }),
        el("p", { class: "empty" }), el("dl", {}), el("ol", { class: "ran", "aria-label": t("Executed steps") }));
    }
    const rows = container.userdata || [];
    setText(part(box, "title"), t("Userdata of {path}", container));
    const name = stateName(container.server, clicked.id);
    setText(part(box, "hold"), t("Hold before {what}", { what: name }));
    setHidden(part(box, "hold"), !control.possible() || !name.includes("/"));
    const waits = waiting(container.server, name);
    const choices = outcomes(container);
    setHidden(part(box, "leave"), choices.length === 0);
    keyed(part(box, "leave"), choices, (outcome) => outcome,
      (outcome) => el("button", { class: "small", onclick: () => leave(outcome) }),
      (button, outcome) => {
        setText(button, outcome === waits ? t("Confirm {outcome}", { outcome }) : t("Leave with {outcome}", { outcome }));
        button.title = outcome === waits ? t("The machine goes on with it") : t("Stops the state, and has the machine go on as if it had ended so");
      });
    tell(part(box, "empty"), container.userdata_error || (rows.length ? "" : t("There is none.")));
    drawPairs(box.querySelector("dl"), rows);
    keyed(part(box, "ran"), Object.entries(container.steps || {}), ([number]) => number, () => el("li", {}),
      (item, [, step]) => setText(item, `${clockText(step.at)} ${step.state} → ${step.outcome.join(" / ")}${step.said ? `, ${say(step.said)}` : ""}${step.userdata.map(([key, value]) => `; ${key} = ${value}`).join("")}`));
  }

  store.view("machines", draw);
}

const runs = (container) => (container.active || []).length > 0;

const inside = (path, label) => (path === "/" ? `/${label}` : `${path}/${label}`);

// The key of another container of the same machine, by its path.
const beside = (all, key, path) => key.slice(0, key.length - all[key].path.length) + path;

// The path of a node's container; in older recordings only the node's name has it.
const homeOf = ({ id, kind, in: home }) => home ?? (id.slice(0, id.lastIndexOf(kind === "outcome" ? ":" : "/")) || "/");

// Names of machines: paths, and where several have one, server and node.
function namesOf(all, roots) {
  const texts = [1, 2, 3].map((count) => roots.map((key) => [all[key].path.replace(/^\/+/, "") || all[key].server, all[key].server, all[key].node].slice(0, count).join(" · ")));
  return new Map(roots.map((key, at) => [key, (texts.find((each) => each.indexOf(each[at]) === each.lastIndexOf(each[at])) || texts[2])[at]]));
}

// The innermost active state: DRIVE, or ASK/SAY.
function deepest(all, key) {
  const names = [];
  let container = all[key];
  while (container && runs(container) && names.length < 20) {
    names.push(container.active.join(" + "));
    container = of(all, beside(all, key, inside(container.path, container.active[0])));
  }
  return names.join(" / ");
}

function edgeMark(containerAt, frames, edge, from, to) {
  if (!from || !to) return false;
  // An edge that begins at an outcome belongs to the container that has it: done of /A/B → state B of /A.
  const fromOutcome = from.kind === "outcome";
  const frame = frames.get(homeOf(from)) || {};
  const [home, label] = fromOutcome ? [frame.in ?? frame.id.slice(0, frame.id.lastIndexOf("/")), frame.text] : [homeOf(from), from.text];
  const last = of(containerAt(home).last, label);
  if (!last || !last.length) return false;
  const target = to.kind === "outcome" && homeOf(to) === home ? to.text : null;
  const labels = fromOutcome ? [from.text] : edge.text ? edge.text.split(", ") : [target];
  if (!labels.some((each) => last.includes(each))) return false;
  return last.length > 1 && !fromOutcome && !last.every((outcome) => labels.includes(outcome)) ? "maybe" : "taken";
}
