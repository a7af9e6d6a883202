// SPDX-License-Identifier: Apache-2.0
// Robots on the map, with their ways, their trails, what is seen, points of interest and people. Metres; y grows upwards,
// so it is negated.
import { byId, el, has, keyed, pressed, setText, svg, tell } from "../dom.js";
import { pannable } from "../pan.js";
import { objectWords } from "../pddl_words.js";
import { PlaceGoals } from "../place_goals.js";
import { say, t } from "../texts.js";

const MARGIN = 0.9; // m around what is seen where there is no map
const CLOSEST = 1.5; // m that are at least in sight
const TEXT = 12; // px
const AFAR = 19; // px on a wall
const PERSON = "M0 -.26a.1 .1 0 1 1 .001 0M-.17 .16a.17 .2 0 0 1 .34 0z";
const ROBOT = "M.19 0L-.1 .12L-.04 0L-.1 -.12Z";
const GOAL = "M-.16 -.16L.16 .16M-.16 .16L.16 -.16";

export function show(section, { store, control }) {
  const goals = new PlaceGoals(store, control);
  const image = svg("image", { preserveAspectRatio: "none" });
  const trail = svg("polyline", { class: "map-trail" });
  const path = svg("polyline", { class: "map-path" });
  const seen = svg("path", { class: "map-seen" });
  const points = svg("g", {});
  const people = svg("g", {});
  const robots = svg("g", {}); // of one plan, with their names
  const ways = svg("g", {}); // of those
  const goal = svg("path", { class: "map-goal", d: GOAL });
  const robot = svg("g", { class: "map-robot" }, svg("circle", { r: 0.27 }), svg("path", { d: ROBOT }));
  const root = svg("svg", { role: "group", "aria-label": t("Map") }, image, trail, path, ways, seen, goal, points, people, robots, robot);
  const picture = el("div", { id: "map-picture", tabindex: 0, role: "group", "aria-label": t("Map") }, root);
  const button = (text, label, action) => el("button", { class: "small", title: label, "aria-label": label, onclick: action }, text);
  section.append(
    el("p", { id: "map-why", class: "trouble", role: "status", hidden: true }),
    picture,
    el("div", { id: "map-tools", class: "tools" },
      legend(), el("span", { class: "buttons" }, button("+", t("larger"), () => zoom(1.4)), button("−", t("smaller"), () => zoom(1 / 1.4)), button("⤢", t("whole map"), () => { view = null; redraw(); }))),
  );
  let shownGrid = "";
  let shownControl = false; // whether goals can be sent
  let view = null; // {x, y, w, h}; null: all of it
  let frame = null;
  pannable(picture, { move: (dx, dy) => shift(dx, dy), zoom });
  new ResizeObserver(() => redraw()).observe(picture);
  const redraw = () => draw(store.state.map || {});

  // Metres per pixel, with what is in sight now.
  function scale() {
    const box = root.getBoundingClientRect();
    const now = view || frame;
    return Math.max(now.w / (box.width || 500), now.h / (box.height || 500));
  }

  function zoom(factor) {
    if (!frame) return;
    const now = view || frame;
    const share = Math.max(1 / factor, CLOSEST / Math.max(now.w, now.h));
    const [w, h] = [now.w * share, now.h * share];
    const robotAt = (store.state.map || {}).robot;
    const [x, y] = view || !robotAt ? [now.x + now.w / 2, now.y + now.h / 2] : [robotAt[0], -robotAt[1]];
    view = w >= frame.w && h >= frame.h ? null : { x: x - w / 2, y: y - h / 2, w, h };
    redraw();
  }

  function shift(dx, dy) {
    if (!view) return;
    const unit = scale();
    view = { ...view, x: view.x + dx * unit, y: view.y + dy * unit };
    redraw();
  }

  function draw(map) {
    const grid = map.grid;
    const key = grid ? JSON.stringify(grid) : "";
    if (key !== shownGrid) {
      shownGrid = key;
      if (grid) image.setAttribute("href", `map.png?version=${grid.version}`);
    }
    frame = bounds(map);
    const why = [map.trouble, map.stands].filter(Boolean).map(say);
    tell(byId("map-why"), why.join(" · "));
    if (!frame) {
      root.style.display = "none";
      setText(byId("map-note"), t("no map yet"));
      return;
    }
    root.style.display = "";
    const now = view || frame;
    root.setAttribute("viewBox", `${now.x} ${now.y} ${now.w} ${now.h}`);
    const px = scale();
    image.style.display = grid ? "" : "none";
    if (grid) place(image, { y: -grid.height, width: grid.width, height: grid.height, transform: `translate(${grid.x} ${-grid.y}) rotate(${(-(grid.yaw || 0) * 180) / Math.PI})` });
    drawWay(trail, path, goal, map, px);
    keyed(ways, Object.entries(map.ways || {}), ([name]) => name,
      () => svg("g", {}, svg("polyline", { class: "map-trail" }), svg("polyline", { class: "map-path" }), svg("path", { class: "map-goal", d: GOAL })),
      (group, [, way]) => drawWay(...group.children, way, px));
    place(seen, { d: (map.seen || []).map(([x, y]) => `M${x} ${-y}h.001`).join(""), "stroke-width": 5 * px });
    drawPoints(map, px);
    keyed(people, (map.people || []).map((person, index) => [index, person]), ([index]) => index,
      () => svg("g", { class: "map-person" }, svg("path", { d: PERSON }), svg("text", {})),
      (person, [, [x, y, name]]) => {
        place(person, { transform: `translate(${x} ${-y})`, "stroke-width": 0.02 });
        setText(person.lastChild, name || "");
        place(person.lastChild, { y: -0.5, "font-size": textSize() * px, "stroke-width": 3 * px });
      });
    keyed(robots, Object.entries(map.robots || {}), ([name]) => name,
      ([name]) => svg("g", { class: "map-robot" }, svg("g", {}, svg("circle", { r: 0.27 }), svg("path", { d: ROBOT })), svg("text", {}, name)),
      (group, [, pose]) => {
        setPlace(group.firstChild, pose, 0.03, Math.max(1, (9 * px) / 0.27));
        place(group.lastChild, { x: pose[0], y: -pose[1] - Math.max(0.35, 12 * px), "font-size": textSize() * px, "stroke-width": 3 * px });
      });
    setPlace(robot, map.robot, 0.03, Math.max(1, (9 * px) / 0.27));
    const others = Object.keys(map.robots || {}).length;
    setText(byId("map-note"), others && !map.robot ? t("{count} robots", { count: others }) : map.robot ? t("robot at {x}, {y} m", { x: map.robot[0].toFixed(1), y: map.robot[1].toFixed(1) }) : t("robot not located"));
    const crowd = (map.people || []).length ? `; ${t("{count} people", { count: map.people.length })}` : "";
    root.setAttribute("aria-label", `${t("Map")}; ${byId("map-note").textContent}${crowd}`);
  }

  function drawPoints(map, px) {
    const { facts = {}, words } = store.state.knowledge || {};
    keyed(points, Object.entries(map.points || {}), ([name]) => name,
      ([name]) => {
        const group = svg("g", { class: "map-point" }, svg("circle", {}), svg("text", {}));
        pressed(group, () => control.possible() && goals.open(name));
        return group;
      },
      (group, [name, [x, y]]) => {
        const shown = objectWords(name, words);
        setText(group.lastChild, shown);
        place(group.firstChild, { cx: x, cy: -y, r: 5 * px, "stroke-width": 1.6 * px });
        place(group.lastChild, { x, y: -y - 10 * px, "font-size": textSize() * px, "stroke-width": 3.5 * px });
        // Only an operator that may send goals gets a hint that there are some.
        const possible = control.possible();
        place(group, possible ? { tabindex: 0, role: "button", "aria-label": t("Goals at {place}", { place: shown }) } : { role: "presentation" });
        if (!possible) for (const attribute of ["tabindex", "aria-label"]) group.removeAttribute(attribute);
        group.classList.toggle("checked", has(facts, `(checked ${name})`));
      });
  }

  store.view("map", draw);
  store.view("knowledge", redraw);
  store.view("meta", ({ control: possible }) => { if (possible !== shownControl) { shownControl = possible; redraw(); } });
}

const textSize = () => (document.body.hasAttribute("data-wall") ? AFAR : TEXT);

function legend() {
  const sign = (shape, words) => el("li", {}, svg("svg", { viewBox: "-.3 -.3 .6 .6", width: 16, height: 16, "aria-hidden": "true" }, shape), words);
  const line = (kind) => svg("path", { class: kind, d: "M-.3 0H.3", "stroke-width": 0.08, "stroke-dasharray": kind === "map-path" ? ".2 .1" : undefined });
  return el("ul", { id: "map-legend", "aria-label": t("Legend") },
    sign(svg("g", { class: "map-robot" }, svg("circle", { r: 0.28 }), svg("path", { d: ROBOT })), t("robot")),
    sign(svg("path", { class: "map-goal", d: GOAL, "stroke-width": 0.09 }), t("its goal")),
    sign(line("map-path"), t("its way")),
    sign(line("map-trail"), t("where it was")),
    sign(svg("path", { class: "map-seen", d: "M0 0h.001", "stroke-width": 0.25 }), t("seen, not on the map")),
    sign(svg("path", { class: "sign-person", d: PERSON, "stroke-width": 0.02 }), t("person")),
    sign(svg("g", { class: "map-point" }, svg("circle", { r: 0.2, "stroke-width": 0.06 })), t("point of interest")));
}

// Where a robot was, where it is going and which way.
function drawWay(trail, path, goal, way, px) {
  const line = (points) => points.map(([x, y]) => `${x},${-y}`).join(" ");
  const was = way.trail || {};
  place(trail, { points: line(Object.keys(was).sort((a, b) => a - b).map((at) => was[at])), "stroke-width": 2 * px });
  place(path, { points: line(way.path || []), "stroke-width": 2.5 * px, "stroke-dasharray": `${9 * px} ${6 * px}` });
  setPlace(goal, way.goal, Math.max(0.06, 3 * px), Math.max(1, (9 * px) / 0.16));
}

function place(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    const text = String(value);
    if (element.getAttribute(name) !== text) element.setAttribute(name, text);
  }
}

function setPlace(element, pose, stroke, scale) {
  element.style.display = pose ? "" : "none";
  if (pose) place(element, { transform: `translate(${pose[0]} ${-pose[1]}) rotate(${(-pose[2] * 180) / Math.PI}) scale(${scale})`, "stroke-width": stroke / scale });
}

function bounds(map) {
  const box = map.grid && (map.grid.box || map.grid);
  if (box) return { x: box.x, y: -box.y - box.height, w: box.width, h: box.height };
  const seen = [...Object.values(map.points || {}), ...(map.path || []), ...(map.people || []), ...(map.robot ? [map.robot] : []), ...Object.values(map.robots || {})];
  if (!seen.length) return null;
  const xs = seen.map(([x]) => x);
  const ys = seen.map(([, y]) => -y);
  const [left, top] = [Math.min(...xs) - MARGIN, Math.min(...ys) - MARGIN];
  return { x: left, y: top, w: Math.max(...xs) - left + MARGIN, h: Math.max(...ys) - top + MARGIN };
}
