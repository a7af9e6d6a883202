// SPDX-License-Identifier: Apache-2.0
// Making and keeping elements. Texts are only ever set as text, so no name can become markup.

export { has, of } from "./names.js";

const SVG = "http://www.w3.org/2000/svg";

export const byId = (id) => document.getElementById(id);

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  for (const child of children.flat()) {
    if (child === null || child === undefined) continue;
    element.append(child instanceof Node ? child : document.createTextNode(String(child)));
  }
  return element;
}

export function el(tag, attributes, ...children) {
  const element = document.createElement(tag);
  if (tag === "button") element.type = tag; // none sends a form unless it says so
  return fill(element, attributes, children);
}
export const svg = (tag, attributes, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);

export function setText(element, text) {
  const shown = text === undefined || text === null ? "" : String(text);
  if (element.textContent !== shown) element.textContent = shown;
}

// Shows a text, and nothing where there is none.
export function tell(element, text) {
  setText(element, text);
  setHidden(element, !text);
}

export function setHidden(element, hidden) {
  if (element.hidden !== hidden) element.hidden = hidden;
}

// Makes the children of an element those of the items. Elements of items that stay are moved only where their order
// changes: one that is taken out and put in again loses the focus, and a click that has begun.
export function keyed(parent, items, keyOf, create, update) {
  const known = parent.keyedChildren || new Map();
  const kept = new Map();
  items.forEach((item, index) => {
    const key = keyOf(item, index);
    if (!kept.has(key)) kept.set(key, known.get(key) || create(item, index));
    update(kept.get(key), item, index);
  });
  for (const [key, child] of known) if (!kept.has(key)) child.remove();
  let place = parent.firstChild;
  for (const child of kept.values()) {
    if (child === place) place = place.nextSibling;
    else parent[parent.moveBefore && child.isConnected ? "moveBefore" : "insertBefore"](child, place);
  }
  parent.keyedChildren = kept;
}

// A list of names and values.
export function drawPairs(list, pairs) {
  const cells = pairs.flatMap(([key, value], index) => [["dt", index, key], ["dd", index, value]]);
  keyed(list, cells, ([tag, index]) => `${tag} ${index}`, ([tag]) => el(tag), (cell, [, , text]) => setText(cell, text));
}

// What is a button, though it is drawn in a picture.
export function pressed(element, call) {
  element.addEventListener("click", call);
  element.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    call();
  });
}

export const part = (element, name) => element.querySelector(`:scope .${name}`);

let simulated = false;
export function useSimulatedTime(yes) {
  simulated = yes;
}

// ROS time in s, as a clock shows it.
export function clockText(at) {
  if (typeof at !== "number" || !at) return "";
  if (simulated || at < 1e8) return `${at.toFixed(1)} s`;
  return new Date(at * 1000).toLocaleTimeString();
}

export function secondsText(seconds) {
  if (typeof seconds !== "number") return "";
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 120) return `${Math.round(seconds)} s`;
  return `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s`;
}

export const GLYPHS = {
  waiting: "○", dropped: "·", dispatched: "◔", running: "▶", succeeded: "✓", failed: "✕", cancelled: "⊘",
};
