// Every state machine: nested, active states marked, the last outcome of each state, userdata on click.
import { byId, el, keyed, part, setHidden, setText } from "../dom.js";
import { GraphView } from "../graph.js";

const FOLDED = "merlin-folded-machines";

export function show(section, { store }) {
  section.append(
    el("div", { id: "machine-list" }),
    el("p", { id: "machines-empty", class: "empty" }, "No machine is shown by any node."),
    el("div", { id: "userdata", role: "region", "aria-label": "Userdata", hidden: true }),
  );
  const folded = new Set(JSON.parse(localStorage.getItem(FOLDED) || "[]"));
  const views = new Map();
  let picked = null; // key of the container whose userdata is shown

  const containers = () => (store.state.machines || {}).containers || {};

  function draw(machines) {
    const all = machines.containers || {};
    const paths = new Set(Object.values(all).map((container) => `${container.server} ${container.path}`));
    const roots = Object.keys(all).filter((key) => isRoot(all[key], paths)).sort((a, b) => size(machines, b) - size(machines, a) || (all[a].path < all[b].path ? -1 : 1));
    setText(byId("machines-note"), roots.length ? `${roots.length}, ${roots.filter((key) => (all[key].active || []).length).length} running` : "");
    setHidden(byId("machines-empty"), roots.length > 0);
    for (const known of views.keys()) if (!roots.includes(known)) views.delete(known);
    keyed(byId("machine-list"), roots, (key) => key, create, (box, key) => update(box, key, machines));
    drawUserdata();
  }

  function create(key) {
    const title = el("button", { type: "button", class: "name", onclick: () => fold(key) });
    const graph = el("div", { class: "graph", tabindex: 0 });
    views.set(key, new GraphView(graph, { onPick: (id) => pick(key, id) }));
    return el("article", { class: "machine" }, el("header", {}, title, el("span", { class: "where" })), graph);
  }

  function update(box, key, machines) {
    const all = machines.containers;
    const root = all[key];
    const active = deepest(all, root);
    const shut = folded.has(root.path);
    box.classList.toggle("folded", shut);
    box.dataset.active = String(active !== "");
    setText(part(box, "name"), `${shut ? "▸" : "▾"} ${root.path.replace(/^\//, "")}`);
    part(box, "name").setAttribute("aria-expanded", String(!shut));
    const ended = root.outcome ? `ended with ${root.outcome}` : "idle";
    setText(part(box, "where"), `${active ? `▶ ${active}` : ended}${root.silent ? " · silent" : ""}`);
    const graph = part(box, "graph");
    setHidden(graph, shut);
    if (shut) return;
    const view = views.get(key);
    graph.setAttribute("aria-label", `${root.path}: ${active ? `in ${active}` : ended}`);
    view.show((machines.layouts || {})[key], root.path);
    view.mark((id, node) => {
      const cut = id.lastIndexOf(node.kind === "outcome" ? ":" : "/");
      const container = all[`${root.server} ${id.slice(0, cut) || "/"}`] || {};
      if (node.kind === "outcome") {
        const reached = container.outcome === node.text;
        return { reached, label: reached ? "the last outcome" : "" };
      }
      const on = (container.active || []).includes(node.text);
      const last = (container.last || {})[node.text];
      return { active: on, glyph: on ? "▶" : "", label: on ? "active" : last ? `left with ${last.join(" or ")}` : "" };
    });
    view.markClusters((path) => ((all[`${root.server} ${path}`] || {}).active || []).length > 0);
    view.markEdges((edge) => edgeMark(all, root.server, edge));
  }

  function fold(key) {
    const { path } = containers()[key] || {};
    if (!path) return;
    if (!folded.delete(path)) folded.add(path);
    localStorage.setItem(FOLDED, JSON.stringify([...folded]));
    store.refresh("machines");
  }

  function pick(root, id) {
    const { server } = containers()[root];
    const key = `${server} ${id.slice(0, id.lastIndexOf("/")) || "/"}`;
    picked = picked === key ? null : key;
    drawUserdata();
    if (picked) byId("userdata").scrollIntoView({ block: "nearest" });
  }

  function drawUserdata() {
    const box = byId("userdata");
    const container = picked ? containers()[picked] : null;
    setHidden(box, !container);
    if (!container) return;
    if (!box.firstChild) {
      box.append(
        el("header", {}, el("span", { class: "title" }), el("button", { type: "button", class: "small", onclick: () => { picked = null; drawUserdata(); } }, "Close")),
        el("p", { class: "empty" }), el("dl", {}));
    }
    const rows = container.userdata || [];
    setText(part(box, "title"), `Userdata of ${container.path}`);
    setText(part(box, "empty"), container.userdata_error || (rows.length ? "" : "There is none."));
    setHidden(part(box, "empty"), rows.length > 0 && !container.userdata_error);
    keyed(box.lastChild, rows.flatMap(([key, value]) => [["dt", key, key], ["dd", key, value]]), ([tag, key]) => `${tag} ${key}`,
      ([tag]) => el(tag, {}), (cell, [, , text]) => setText(cell, text));
  }

  store.view("machines", draw);
}

// Large machines first, so that small ones find room beside each other; it does not change while they run.
function size(machines, key) {
  const layout = (machines.layouts || {})[key];
  return layout && layout.width ? Math.round((layout.width * layout.height) / 40000) : 0;
}

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
