// Every state machine: nested, active states marked, the last outcome of each state, userdata on click.
import { byId, clockText, el, keyed, part, setHidden, setText } from "../dom.js";
import { GraphView } from "../graph.js";
import { breakpointsOf, heldStates, namespaceOf, stateName, unconfirmed } from "../holds.js";
import { say, t } from "../texts.js";

export function show(section, { store, control }) {
  section.append(
    el("div", { id: "machine-list" }),
    el("p", { id: "machines-empty", class: "empty" }, t("No machine is shown by any node.")),
    el("div", { id: "userdata", role: "region", "aria-label": t("Userdata"), hidden: true }),
  );
  const opened = new Map(); // path → whether the reader wants it unfolded, until it begins or ends
  const views = new Map();
  let picked = null; // key of the container whose userdata is shown
  let clicked = ""; // the state, as it is drawn: /NAVIGATE/DRIVE

  const containers = () => (store.state.machines || {}).containers || {};

  function draw(machines) {
    const all = machines.containers || {};
    const paths = new Set(Object.values(all).map((container) => `${container.server} ${container.path}`));
    const roots = Object.keys(all).filter((key) => isRoot(all[key], paths)).sort((a, b) => runs(all[b]) - runs(all[a]) || (all[a].path < all[b].path ? -1 : 1));
    setText(byId("machines-note"), roots.length ? t("{running} of {count} running", { count: roots.length, running: roots.filter((key) => runs(all[key])).length }) : "");
    setHidden(byId("machines-empty"), roots.length > 0);
    for (const known of views.keys()) if (!roots.includes(known)) views.delete(known);
    keyed(byId("machine-list"), roots, (key) => key, create, (box, key) => update(box, key, machines));
    drawUserdata();
  }

  function create(key) {
    const title = el("button", { type: "button", class: "name", onclick: () => fold(key) });
    const graph = el("div", { class: "graph", tabindex: 0, role: "group" });
    views.set(key, new GraphView(graph, { onPick: (id) => pick(key, id) }));
    return el("article", { class: "machine" }, el("div", { class: "bar-of" }, title, el("span", { class: "where" })), graph);
  }

  function update(box, key, machines) {
    const all = machines.containers;
    const root = all[key];
    const active = deepest(all, root);
    const running = String(active !== "");
    // Only what runs is unfolded; what the reader wants holds until that changes.
    if (box.dataset.active !== running) opened.delete(root.path);
    box.dataset.active = running;
    const shut = !(opened.has(root.path) ? opened.get(root.path) : active);
    box.classList.toggle("folded", shut);
    setText(part(box, "name"), `${shut ? "▸" : "▾"} ${root.path.replace(/^\//, "")}`);
    part(box, "name").setAttribute("aria-expanded", String(!shut));
    const ended = root.outcome ? t("ended with {outcome}", root) : t("idle");
    setText(part(box, "where"), `${active ? `▶ ${active}` : ended}${root.silent ? ` · ${t("silent")}` : ""}`);
    const graph = part(box, "graph");
    setHidden(graph, shut);
    if (shut) return;
    const view = views.get(key);
    graph.setAttribute("aria-label", `${root.path}: ${active ? t("in {state}", { state: active }) : ended}`);
    view.show((machines.layouts || {})[key], root.path);
    view.mark((id, node) => {
      const cut = id.lastIndexOf(node.kind === "outcome" ? ":" : "/");
      const container = all[`${root.server} ${id.slice(0, cut) || "/"}`] || {};
      if (node.kind === "outcome") {
        const reached = container.outcome === node.text;
        return { reached, label: reached ? t("the last outcome") : "" };
      }
      const on = (container.active || []).includes(node.text);
      const last = (container.last || {})[node.text];
      const name = stateName(root.server, id);
      const waits = waiting(root.server, name);
      const held = waits || heldStates(store.state).includes(name);
      return { active: on, glyph: held ? "⏸" : on ? "▶" : "", label: waits ? t("{outcome} waits for an operator", { outcome: waits }) : held ? t("Held") : on ? t("active") : last ? t("left with {outcome}", { outcome: last.join(" / ") }) : "" };
    });
    view.markClusters((path) => ((all[`${root.server} ${path}`] || {}).active || []).length > 0);
    view.markEdges((edge) => edgeMark(all, root.server, edge));
  }

  function fold(key) {
    const { path } = containers()[key] || {};
    if (!path) return;
    opened.set(path, !(opened.has(path) ? opened.get(path) : runs(containers()[key])));
    store.refresh("machines");
  }

  function pick(root, id) {
    const { server } = containers()[root];
    const key = `${server} ${id.slice(0, id.lastIndexOf("/")) || "/"}`;
    picked = picked === key && clicked === id ? null : key;
    clicked = id;
    drawUserdata();
    if (picked) byId("userdata").scrollIntoView({ block: "nearest" });
  }

  // The outcome with which a state waits for an operator.
  const waiting = (server, name) => (unconfirmed(store.state).find(([state, , within]) => state === name && within === namespaceOf(server)) || [])[1];

  // Its outcomes, where an operator can have the state left with one: while it runs, is held or waits.
  function outcomes(container) {
    const label = clicked.slice(clicked.lastIndexOf("/") + 1);
    if (!control.possible() || !(container.active || []).includes(label)) return [];
    return [...new Set((container.edges || []).filter(([, source]) => source === label).map(([outcome]) => outcome))];
  }

  function leave(outcome) {
    const { server } = containers()[picked];
    control.ask("leave", { state: stateName(server, clicked), outcome, within: namespaceOf(server) });
  }

  function drawUserdata() {
    const box = byId("userdata");
    const container = picked ? containers()[picked] : null;
    setHidden(box, !container);
    if (!container) return;
    if (!box.firstChild) {
      box.append(
        el("div", { class: "bar-of" }, el("span", { class: "title" }),
          el("button", { type: "button", class: "small hold", onclick: () => control.ask("breakpoints", { before: [...new Set([...breakpointsOf(store.state), stateName(containers()[picked].server, clicked)])] }) }),
          el("button", { type: "button", class: "small", onclick: () => { picked = null; drawUserdata(); } }, t("Close"))),
        el("div", { class: "buttons leave", role: "group", "aria-label": t("Leave the state with") }),
        el("p", { class: "empty" }), el("dl", {}), el("ol", { class: "ran", "aria-label": t("Executed steps") }));
    }
    const rows = container.userdata || [];
    setText(part(box, "title"), t("Userdata of {path}", container));
    const name = stateName(container.server, clicked);
    setText(part(box, "hold"), t("Hold before {what}", { what: name }));
    setHidden(part(box, "hold"), !control.possible() || !name.includes("/"));
    const waits = waiting(container.server, name);
    const choices = outcomes(container);
    setHidden(part(box, "leave"), choices.length === 0);
    keyed(part(box, "leave"), choices, (outcome) => outcome,
      (outcome) => el("button", { type: "button", class: "small", onclick: () => leave(outcome) }),
      (button, outcome) => {
        setText(button, outcome === waits ? t("Confirm {outcome}", { outcome }) : t("Leave with {outcome}", { outcome }));
        button.title = outcome === waits ? t("The machine goes on with it") : t("Stops the state, and has the machine go on as if it had ended so");
      });
    setText(part(box, "empty"), container.userdata_error || (rows.length ? "" : t("There is none.")));
    setHidden(part(box, "empty"), rows.length > 0 && !container.userdata_error);
    const cells = box.querySelector("dl");
    keyed(cells, rows.flatMap(([key, value]) => [["dt", key, key], ["dd", key, value]]), ([tag, key]) => `${tag} ${key}`,
      ([tag]) => el(tag, {}), (cell, [, , text]) => setText(cell, text));
    keyed(part(box, "ran"), Object.entries(container.steps || {}), ([number]) => number, () => el("li", {}),
      (item, [, step]) => setText(item, `${clockText(step.at)} ${step.state} → ${step.outcome.join(" / ")}${step.said ? `, ${say(step.said)}` : ""}${step.userdata.map(([key, value]) => `; ${key} = ${value}`).join("")}`));
  }

  store.view("machines", draw);
}

const runs = (container) => (container.active || []).length > 0;

function isRoot(container, known) {
  const parts = container.path.replace(/^\//, "").split("/");
  for (let length = 1; length < parts.length; length += 1) {
    if (known.has(`${container.server} /${parts.slice(0, length).join("/")}`)) return false;
  }
  return true;
}

// The innermost active state: DRIVE, or ASK/SAY.
function deepest(all, root) {
  const names = [];
  let container = root;
  while (container && (container.active || []).length && names.length < 20) {
    names.push(container.active.join(" + "));
    container = all[`${container.server} ${container.path.replace(/\/$/, "")}/${container.active[0]}`];
  }
  return names.join(" / ");
}

function edgeMark(all, server, edge) {
  // An edge that begins at an outcome belongs to the container that has it: /A/B:done → state B of /A.
  const fromOutcome = edge.from.lastIndexOf(":") > edge.from.lastIndexOf("/");
  const path = fromOutcome ? edge.from.slice(0, edge.from.lastIndexOf(":")) : edge.from;
  const cut = path.lastIndexOf("/");
  const parent = all[`${server} ${path.slice(0, cut) || "/"}`];
  const last = parent && parent.last && parent.last[path.slice(cut + 1)];
  if (!last || !last.length) return false;
  const target = edge.to.startsWith(`${parent.path}:`) ? edge.to.slice(parent.path.length + 1) : null;
  const labels = fromOutcome ? [edge.from.slice(path.length + 1)] : edge.text ? edge.text.split(", ") : [target];
  if (!labels.some((label) => last.includes(label))) return false;
  return last.length > 1 && !fromOutcome && !last.every((outcome) => labels.includes(outcome)) ? "maybe" : "taken";
}
