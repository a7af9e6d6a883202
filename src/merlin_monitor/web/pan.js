// SPDX-License-Identifier: Apache-2.0
// Moving what is larger than its box: by dragging, and with + − and the arrows while it has the focus.
import { has } from "./names.js";

const SLACK = 4; // px until a press is a drag and not a click
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

// move(dx, dy): by px of the pointer or, from keys, in steps of 40; zoom(factor).
export function pannable(box, { move, zoom }) {
  let from = null;
  let dragged = false;
  box.addEventListener("pointerdown", (event) => {
    dragged = false;
    if (event.pointerType !== "touch" && event.button === 0) from = [event.clientX, event.clientY];
  });
  box.addEventListener("pointermove", (event) => {
    if (!from) return;
    const [dx, dy] = [event.clientX - from[0], event.clientY - from[1]];
    if (!dragged && Math.hypot(dx, dy) < SLACK) return;
    if (!dragged) box.setPointerCapture(event.pointerId);
    dragged = true;
    from = [event.clientX, event.clientY];
    move(-dx, -dy);
  });
  for (const name of ["pointerup", "pointercancel"]) box.addEventListener(name, () => { from = null; });
  box.addEventListener("click", (event) => {
    if (dragged) event.stopPropagation(); // it was moved, not pressed
    dragged = false;
  }, true);
  box.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (has(ARROWS, event.key)) move(...ARROWS[event.key].map((step) => 40 * step));
    else if (event.key === "+" || event.key === "=") zoom(1.25);
    else if (event.key === "-") zoom(0.8);
    else return;
    event.preventDefault();
  });
  box.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return; // the wheel alone scrolls the page
    event.preventDefault();
    zoom(event.deltaY < 0 ? 1.15 : 0.87);
  }, { passive: false });
}
