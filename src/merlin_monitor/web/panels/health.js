// What every part of the robot tells about itself; problems first, silent ones marked.
import { byId, el, keyed, part, setHidden, setText } from "../dom.js";

const ORDER = { error: 0, stale: 1, warning: 2, ok: 3 };
const GLYPHS = { ok: "✓", warning: "!", error: "✕", stale: "?", silent: "…" };
const TONES = { ok: "good", warning: "warn", error: "bad", stale: "warn", silent: "bad" };

export function show(section, { store }) {
  section.append(el("ul", { id: "health-list", class: "rows" }), el("p", { id: "health-empty", class: "empty" }, "Nothing on /diagnostics yet."));
  store.view("health", (health) => {
    const parts = Object.entries(health.parts || {});
    const word = (entry) => (entry.silent ? "silent" : entry.level || "stale");
    const rank = (entry) => (entry.silent ? -1 : ORDER[entry.level] ?? 1);
    parts.sort(([a, one], [b, other]) => rank(one) - rank(other) || (a < b ? -1 : 1));
    const ill = parts.filter(([, entry]) => word(entry) !== "ok").length;
    setText(byId("health-note"), parts.length ? (ill ? `${ill} of ${parts.length} need attention` : `all ${parts.length} well`) : "");
    setHidden(byId("health-empty"), parts.length > 0);
    keyed(byId("health-list"), parts, ([name]) => name,
      ([name]) => el("li", {}, el("details", {},
        el("summary", {}, el("div", { class: "head" }, el("span", { class: "title" }, name), el("span", { class: "end chip level" })), el("div", { class: "more" })),
        el("dl", {}))),
      (row, [, entry]) => {
        const level = word(entry);
        const chip = part(row, "level");
        chip.className = `end chip level ${TONES[level] || "warn"}`;
        setText(chip, `${GLYPHS[level] || "?"} ${level}`);
        setText(part(row, "more"), entry.message);
        const cells = (entry.values || []).flatMap(([key, value], index) => [["dt", index, key], ["dd", index, value]]);
        keyed(row.querySelector("dl"), cells, ([tag, index]) => `${tag} ${index}`, ([tag]) => el(tag, {}), (cell, [, , text]) => setText(cell, text));
      });
  });
}
