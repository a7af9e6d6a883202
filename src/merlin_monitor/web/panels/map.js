// The robot, its path, points of interest and people on the map. Metres; y grows upwards, so it is negated.
import { byId, el, keyed, setText, svg } from "../dom.js";

const MARGIN = 0.3; // m

export function show(section, { store }) {
  const image = svg("image", { preserveAspectRatio: "none" });
  const path = svg("polyline", { class: "map-path" });
  const points = svg("g", {});
  const people = svg("g", {});
  const goal = svg("path", { class: "map-goal", d: "M-.16 -.16L.16 .16M-.16 .16L.16 -.16" });
  const robot = svg("g", { class: "map-robot" }, svg("circle", { r: 0.27 }), svg("path", { d: "M.19 0L-.1 .12L-.04 0L-.1 -.12Z" }));
  const root = svg("svg", { role: "img", "aria-label": "Map" }, image, path, points, people, goal, robot);
  section.append(el("div", { id: "map-picture" }, root));
  let shownGrid = "";

  function draw(map) {
    const grid = map.grid;
    const key = grid ? JSON.stringify(grid) : "";
    if (key !== shownGrid) {
      shownGrid = key;
      if (grid) image.setAttribute("href", `/map.png?version=${grid.version}`);
    }
    const frame = bounds(map);
    if (!frame) {
      root.style.display = "none";
      setText(byId("map-note"), "no map yet");
      return;
    }
    root.style.display = "";
    root.setAttribute("viewBox", `${frame.x} ${frame.y} ${frame.w} ${frame.h}`);
    const unit = Math.max(frame.w, frame.h) / 12; // of texts and strokes
    if (grid) place(image, { x: grid.x, y: -grid.y - grid.height, width: grid.width, height: grid.height });
    path.setAttribute("points", (map.path || []).map(([x, y]) => `${x},${-y}`).join(" "));
    path.setAttribute("stroke-width", 0.05 * unit);
    const facts = (store.state.knowledge || {}).facts || {};
    keyed(points, Object.entries(map.points || {}), ([name]) => name,
      ([name]) => svg("g", { class: "map-point" }, svg("circle", {}), svg("text", {}, name.replace(/_/g, " "))),
      (group, [name, [x, y]]) => {
        place(group.firstChild, { cx: x, cy: -y, r: 0.11 * unit, "stroke-width": 0.035 * unit });
        place(group.lastChild, { x, y: -y - 0.27 * unit, "font-size": 0.34 * unit, "stroke-width": 0.09 * unit });
        group.classList.toggle("checked", `(checked ${name})` in facts);
      });
    keyed(people, (map.people || []).map((person, index) => [index, person]), ([index]) => index,
      () => svg("path", { class: "map-person", d: "M0 -.26a.1 .1 0 1 1 .001 0M-.17 .16a.17 .2 0 0 1 .34 0z" }),
      (person, [, [x, y]]) => place(person, { transform: `translate(${x} ${-y})`, "stroke-width": 0.02 }));
    setPlace(goal, map.goal, 0.06);
    setPlace(robot, map.robot, 0.03);
    setText(byId("map-note"), map.robot ? `robot at ${map.robot[0].toFixed(1)}, ${map.robot[1].toFixed(1)} m` : "robot not located");
    root.setAttribute("aria-label", `Map; ${byId("map-note").textContent}${(map.people || []).length ? `; ${map.people.length} people` : ""}`);
  }

  store.view("map", draw);
  store.view("knowledge", () => draw(store.state.map || {}));
}

function place(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    const text = String(value);
    if (element.getAttribute(name) !== text) element.setAttribute(name, text);
  }
}

function setPlace(element, pose, stroke) {
  element.style.display = pose ? "" : "none";
  if (pose) place(element, { transform: `translate(${pose[0]} ${-pose[1]}) rotate(${(-pose[2] * 180) / Math.PI})`, "stroke-width": stroke });
}

function bounds(map) {
  if (map.grid) return { x: map.grid.x, y: -map.grid.y - map.grid.height, w: map.grid.width, h: map.grid.height };
  const seen = [...Object.values(map.points || {}), ...(map.path || []), ...(map.people || []), ...(map.robot ? [map.robot] : [])];
  if (!seen.length) return null;
  const xs = seen.map(([x]) => x);
  const ys = seen.map(([, y]) => -y);
  const [left, top] = [Math.min(...xs) - 3 * MARGIN, Math.min(...ys) - 3 * MARGIN];
  return { x: left, y: top, w: Math.max(...xs) - left + 3 * MARGIN, h: Math.max(...ys) - top + 3 * MARGIN };
}
