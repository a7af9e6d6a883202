// SPDX-License-Identifier: Apache-2.0
// Draws what Graphviz has laid out, once per layout; afterwards only marks change.
import { el, pressed, setText, svg } from "./dom.js";
import { pannable } from "./pan.js";

const LONGEST = 34; // characters, as the layout reckons
const LETTER = 8.2; // px of one of them
const EDGES = 30; // px of a node beside its text
const SIZES = [0.3, 2.5]; // of the size it was laid out in, in which all texts can be read

export class GraphView {
  constructor(container, { onPick, words } = {}) {
    this.container = container;
    this.onPick = onPick;
    this.words = words; // node → {text, detail} in the reader's language, where the layout has only English
    this.layout = undefined;
    this.nodes = new Map();
    this.clusters = new Map();
    this.edges = [];
    this.followed = "";
    this.zoom = 1;
    pannable(container, { move: (dx, dy) => container.scrollBy(dx, dy), zoom: (factor) => this.resize(factor) });
  }

  resize(factor) {
    const root = this.container.querySelector("svg");
    if (!root) return;
    this.zoom = Math.min(SIZES[1], Math.max(SIZES[0], this.zoom * factor));
    const { scrollLeft, scrollTop, clientWidth, clientHeight } = this.container;
    this.setSize(root);
    this.container.scrollTo((scrollLeft + clientWidth / 2) * factor - clientWidth / 2, (scrollTop + clientHeight / 2) * factor - clientHeight / 2);
  }

  setSize(root) {
    root.style.width = `${this.layout.width * this.zoom}px`;
    this.container.style.width = `${this.layout.width * this.zoom + 4}px`;
  }

  // Draws a layout if it is another one than before.
  show(layout, label) {
    if (layout === this.layout) return;
    const same = JSON.stringify(layout) === JSON.stringify(this.layout);
    this.layout = layout;
    if (same) return;
    this.nodes.clear();
    this.clusters.clear();
    this.edges = [];
    this.followed = "";
    this.container.replaceChildren();
    if (!layout) return;
    if (layout.error) {
      this.container.append(el("p", { class: "empty" }, layout.error));
      return;
    }
    const { width, height } = layout;
    this.frames = new Map(layout.clusters.map((cluster) => [cluster.id, cluster]));
    const root = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "group", "aria-label": label });
    for (const cluster of layout.clusters) {
      const frame = svg("rect", { class: "cluster", x: cluster.x, y: cluster.y, width: cluster.w, height: cluster.h, rx: 10 });
      const text = svg("text", { class: "cluster-text", x: cluster.x + 12, y: cluster.y + 14 }, cut(cluster.text));
      this.clusters.set(cluster.id, frame);
      root.append(frame, text);
    }
    for (const edge of layout.edges) root.append(this.drawEdge(edge));
    for (const node of layout.nodes) root.append(this.drawNode(node));
    this.setSize(root);
    this.container.append(root);
  }

  drawEdge(edge) {
    const [start, ...rest] = edge.points;
    let path = `M${start}`;
    for (let at = 0; at + 2 < rest.length; at += 3) path += `C${rest[at]} ${rest[at + 1]} ${rest[at + 2]}`;
    const last = edge.points[edge.points.length - 1];
    const group = svg("g", { class: "edge" }, svg("path", { d: path }), tip(last, edge.tip));
    if (edge.text && edge.label) group.append(svg("text", { x: edge.label[0], y: edge.label[1] }, cut(edge.text)));
    this.edges.push({ edge, group });
    return group;
  }

  drawNode(node) {
    const pickable = this.onPick && node.kind !== "outcome";
    const group = svg("g", {
      class: `node ${node.kind}${pickable ? " clickable" : ""}`,
      transform: `translate(${node.x - node.w / 2} ${node.y - node.h / 2})`,
      tabindex: pickable ? 0 : undefined,
      role: pickable ? "button" : undefined,
    });
    const { text, detail = text } = (this.words && this.words(node)) || node;
    const mark = svg("text", { class: "glyph", x: 13, y: node.h / 2 });
    const indent = node.kind === "outcome" ? 0 : 8;
    group.append(
      svg("title", {}, detail),
      svg("rect", { class: "box", width: node.w, height: node.h, rx: node.kind === "outcome" ? node.h / 2 : 8 }),
      svg("text", { x: node.w / 2 + indent, y: node.h / 2 + 0.5, "text-anchor": "middle" }, this.words ? cut(text, Math.floor((node.w - EDGES) / LETTER)) : cut(text)),
    );
    if (node.kind !== "outcome") group.append(mark);
    if (pickable) pressed(group, () => this.onPick(node));
    this.nodes.set(node.id, { node, group, mark, text });
    return group;
  }

  // marks: id → {glyph, active, label, state}
  mark(marks) {
    let first = null;
    for (const [id, { node, group, mark, text }] of this.nodes) {
      const { glyph = "", active = false, reached = false, label = "", state = "" } = marks(id, node) || {};
      group.classList.toggle("active", active);
      if (active && !first) first = node;
      group.classList.toggle("reached", reached);
      if (group.dataset.state !== state) group.dataset.state = state;
      setText(mark, glyph);
      const name = label ? `${text}, ${label}` : text;
      if (group.getAttribute("aria-label") !== name) group.setAttribute("aria-label", name);
    }
    if (first && first.id !== this.followed) this.follow(first);
  }

  // Scrolls to a node, unless the user is looking around.
  follow(node) {
    const box = this.container;
    const root = box.querySelector("svg");
    const shown = root ? root.clientWidth : 0;
    if (!shown) return;
    this.followed = node.id;
    const small = box.scrollWidth <= box.clientWidth + 1 && box.scrollHeight <= box.clientHeight + 1;
    if (small || box.matches(":hover, :focus-within")) return;
    const scale = shown / this.layout.width;
    box.scrollTo({ left: node.x * scale - box.clientWidth / 2, top: node.y * scale - box.clientHeight / 2, behavior: "instant" });
  }

  markClusters(active) {
    for (const [id, frame] of this.clusters) frame.classList.toggle("active", active(id));
  }

  // taken: edge, and the nodes that it joins → false, "taken", or "maybe" (one of several)
  markEdges(taken) {
    for (const { edge, group } of this.edges) {
      const mark = taken(edge, ...[edge.from, edge.to].map((id) => (this.nodes.get(id) || {}).node));
      group.classList.toggle("taken", Boolean(mark));
      group.classList.toggle("maybe", mark === "maybe");
    }
  }
}

function tip(from, to) {
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]) || 1;
  const [dx, dy] = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
  const points = [to, [to[0] - 8 * dx + 3.2 * dy, to[1] - 8 * dy - 3.2 * dx], [to[0] - 8 * dx - 3.2 * dy, to[1] - 8 * dy + 3.2 * dx]];
  return svg("polygon", { class: "tip", points: points.map((point) => point.map((value) => value.toFixed(1)).join(",")).join(" ") });
}

function cut(text, most = LONGEST) {
  return text.length > most ? `${text.slice(0, most - 1)}…` : text;
}
