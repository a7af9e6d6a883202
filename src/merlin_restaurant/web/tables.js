// SPDX-License-Identifier: Apache-2.0
// The tables with what they want, and the clients at the entrance, from what the robot knows.
import { el, keyed, part, setHidden, setText } from "../dom.js";

const STATES = { needs_serving: "needs serving", already_served: "served", needs_cleaning: "needs cleaning", ready: "ready" };
const TONES = { needs_serving: "warn", needs_cleaning: "warn", already_served: "good", ready: "good" };
const ORDERS = { carrying: "on the tray", prepared: "on the bar", ordered: "ordered" };
const CLIENTS = { seated: "seated", greeted: "greeted", waiting: "waits at the entrance" };

export const style = ".guests { display: grid; grid-template-columns: repeat(auto-fill, minmax(190px, 1fr)); gap: 0 26px; }";

export function show(section, { store }) {
  const list = el("ul", { class: "rows guests" });
  const empty = el("p", { class: "empty" }, "No tables are known.");
  section.append(list, empty);

  store.view("knowledge", ({ objects = {}, facts = {} }) => {
    const known = Object.keys(facts).map((fact) => fact.replace(/[()]/g, "").split(" "));
    const first = (words, name) => Object.keys(words).find((word) => known.some(([head, ...of]) => head === word && of.includes(name)));
    const rows = Object.entries(objects).filter(([, { type }]) => ["table", "client"].includes(type)).map(([name, { type }]) => {
      const state = first(type === "table" ? STATES : CLIENTS, name);
      const wanted = known.filter(([head, of]) => head === "wants" && of === name).map(([, , item]) => item.replace(/_/g, " "));
      const order = ORDERS[first(ORDERS, name)];
      return { name, state: (type === "table" ? STATES : CLIENTS)[state] || "not known yet", tone: TONES[state] || "", more: wanted.join(", ") + (wanted.length && order ? ` – ${order}` : "") };
    });
    setHidden(empty, rows.length > 0);
    keyed(list, rows.sort((a, b) => (a.name < b.name ? -1 : 1)), ({ name }) => name,
      ({ name }) => el("li", {}, el("div", { class: "head" }, el("span", { class: "title" }, name.replace(/_/g, " ")), el("span", { class: "end chip state" })), el("div", { class: "more" })),
      (row, { state, tone, more }) => {
        part(row, "state").className = `end chip state ${tone}`;
        setText(part(row, "state"), state);
        setText(part(row, "more"), more);
      });
  });
}
