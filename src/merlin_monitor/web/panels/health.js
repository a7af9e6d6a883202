// SPDX-License-Identifier: Apache-2.0
// What each part reports about itself: what is not well in sight, the well ones folded.
import { byId, drawPairs, el, keyed, of, part, setHidden, setText } from "../dom.js";
import { t } from "../texts.js";

const ORDER = { error: 0, stale: 1, warning: 2, ok: 3 };
const GLYPHS = { ok: "✓", warning: "!", error: "✕", stale: "?", silent: "…" };
const TONES = { ok: "good", warning: "warn", error: "bad", stale: "warn", silent: "bad" };

const word = (entry) => (entry.silent ? "silent" : entry.level || "stale");
const rank = (entry) => (entry.silent ? -1 : of(ORDER, entry.level) ?? 1);

export function show(section, { store }) {
  const ill = el("ul", { class: "rows" });
  const well = el("ul", { class: "rows" });
  const summary = el("summary", {});
  const folded = el("details", { id: "health-well", hidden: true }, summary, well);
  section.append(
    el("div", { id: "health-list", tabindex: 0, role: "group", "aria-label": t("Parts of the robot") }, ill, folded),
    el("p", { id: "health-empty", class: "empty" }, t("No part has reported yet.")),
  );
  store.view("health", (health) => {
    const parts = Object.entries(health.parts || {});
    parts.sort(([a, one], [b, other]) => rank(one) - rank(other) || (a < b ? -1 : 1));
    const poor = parts.filter(([, entry]) => word(entry) !== "ok");
    const good = parts.slice(poor.length);
    const count = parts.length;
    setText(byId("health-note"), count ? (poor.length ? t("{ill} of {count} need attention", { ill: poor.length, count }) : t("all {count} well", { count })) : "");
    setHidden(byId("health-empty"), count > 0);
    setHidden(folded, good.length === 0);
    setText(summary, t("{count} are well", { count: good.length }));
    draw(ill, poor);
    draw(well, good);
  });
}

function draw(list, parts) {
  keyed(list, parts, ([name]) => name,
    ([name]) => el("li", {}, el("details", {},
      el("summary", {}, el("div", { class: "head" }, el("span", { class: "title" }, name), el("span", { class: "end chip level" })), el("div", { class: "more" })),
      el("dl", {}))),
    (row, [, entry]) => {
      const level = word(entry);
      const chip = part(row, "level");
      chip.className = `end chip level ${of(TONES, level) || "warn"}`;
      setText(chip, `${of(GLYPHS, level) || "?"} ${t(level)}`);
      setText(part(row, "more"), entry.message);
      drawPairs(row.querySelector("dl"), entry.values || []);
    });
}
