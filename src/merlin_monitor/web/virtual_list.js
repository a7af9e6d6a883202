// SPDX-License-Identifier: Apache-2.0
// A list of any length of which only the rows in sight exist; on paper, the first ones.
import { el } from "./dom.js";
import { t } from "./texts.js";

const AROUND = 6; // rows beyond the edge
const ON_PAPER = 300; // rows
const paper = matchMedia("print");

export class VirtualList {
  constructor(container, height, fill) {
    this.container = container;
    this.height = height;
    this.fill = fill; // (row element, item) → void
    this.items = [];
    this.spacer = el("div", { class: "spacer" });
    this.rows = [];
    container.append(this.spacer);
    container.addEventListener("scroll", () => this.draw(), { passive: true });
    new ResizeObserver(() => this.draw()).observe(container);
    paper.addEventListener("change", () => this.draw());
  }

  show(items) {
    this.items = items;
    this.spacer.style.height = `${items.length * this.height}px`;
    this.draw();
  }

  draw() {
    const first = paper.matches ? 0 : Math.max(0, Math.floor(this.container.scrollTop / this.height) - AROUND);
    const count = paper.matches ? ON_PAPER : Math.ceil(this.container.clientHeight / this.height) + 2 * AROUND;
    const more = paper.matches ? this.items.length - ON_PAPER : 0;
    this.container.toggleAttribute("data-more", more > 0);
    if (more > 0) this.container.dataset.more = t("and {count} more", { count: more });
    const last = Math.min(this.items.length, first + count);
    const wanted = Math.max(0, last - first);
    while (this.rows.length < wanted) {
      const row = el("div", { role: "listitem" });
      this.rows.push(row);
      this.spacer.append(row);
    }
    this.rows.forEach((row, index) => {
      const place = first + index;
      row.hidden = index >= wanted;
      if (row.hidden) return;
      row.style.top = `${place * this.height}px`;
      row.setAttribute("aria-setsize", this.items.length);
      row.setAttribute("aria-posinset", place + 1);
      this.fill(row, this.items[place]);
    });
  }
}
