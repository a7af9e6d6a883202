// SPDX-License-Identifier: Apache-2.0
// The goals that are served and that wait, and the same in time: as was expected first, and as it was and is.
import { byId, clockText, el, keyed, part, setHidden, setText } from "../dom.js";
import { Gantt } from "../gantt.js";
import { say, t } from "../texts.js";

const SHOWN = 3600; // s before and after the present

export function show(section, { store, control }) {
  section.append(el("ol", { id: "queue-list", class: "rows" }), el("p", { id: "queue-empty", class: "empty" }, t("No goals wait.")), el("div", { id: "queue-time", class: "gantt", tabindex: 0, role: "group", "aria-label": t("The queue in time"), hidden: true }));
  const gantt = new Gantt(byId("queue-time"));
  const draw = () => {
    const { now = {}, queue = {}, meta = {} } = store.state;
    const at = (time) => ({ time: clockText(time + (meta.clock_set || 0)) });
    const times = (of) => [say(of.late), of.not_before && t("not before {time}", at(of.not_before)), of.deadline && t("done by {time}", at(of.deadline)), of.expected_begin && t("expected to begin at {time}", at(of.expected_begin)), of.expected_end && t("expected to end at {time}", at(of.expected_end))];
    const executor = now.executor || {};
    const requests = [];
    if (executor.request) {
      requests.push({ ...executor, running: true, note: [t(executor.state), t("{done} of {count} steps done", { done: executor.done, count: executor.total }), ...times(executor)].filter(Boolean).join(", ") });
    }
    for (const waiting of [...(executor.together || []), ...(queue.waiting || [])]) {
      const words = [waiting.interrupted && t("interrupted"), say(waiting.waits) || t("waits"), waiting.on_interrupt === "drop" && t("dropped when interrupted"), waiting.survives && t("survives"), t("asked for by {client}", { client: waiting.by }), ...times(waiting)];
      requests.push({ ...waiting, note: words.filter(Boolean).join(", ") });
    }
    const count = (queue.waiting || []).length;
    setText(byId("queue-note"), count ? t("{count} waiting", { count }) : "");
    setHidden(byId("queue-empty"), requests.length > 0);
    keyed(byId("queue-list"), requests, (item) => item.request, create, update);
    const clock = meta.time || 0;
    const [from, to] = [clock - SHOWN, clock + SHOWN];
    const inside = (times) => times && times[1] && times[1] >= from && times[0] <= to ? times.map((time) => Math.min(to, Math.max(from, time))) : null;
    const span = (item, state, planned, real) => ({ step: { ...item, state, text: item.request, words: say(item.words) }, planned: inside(planned), real: inside(real), due: item.deadline > from && item.deadline < to && item.deadline });
    gantt.paint([
      ...(queue.ended || []).map((item) => span(item, item.state, item.planned, item.real)),
      ...requests.filter((item) => item.running && item.began).map((item) => span(item, "running", item.planned, [item.began, clock])),
      ...(queue.waiting || []).map((item) => span(item, "waiting", [item.expected_begin, item.expected_end], null)),
    ].filter(({ planned, real }) => planned || real), clock, {}, t("The queue in time"));
  };

  function create(item) {
    const cancel = el("button", { class: "small cancel", onclick: () => control.ask("cancel", { request: item.request }) }, t("Cancel"));
    return el("li", {},
      el("div", { class: "head" }, el("span", { class: "glyph", "aria-hidden": "true" }), el("span", { class: "title" }), el("span", { class: "end chip priority" }), cancel),
      el("div", { class: "more" }));
  }

  function update(row, item) {
    setText(part(row, "glyph"), item.running ? "▶" : "○");
    setText(part(row, "title"), say(item.words) || item.request);
    part(row, "title").title = (item.goals || []).join(" ");
    setText(part(row, "priority"), t("priority {number}", { number: item.priority }));
    setText(part(row, "more"), item.note);
    setHidden(part(row, "cancel"), !control.possible());
  }

  store.view("queue", draw);
  store.view("now", draw);
  store.view("meta", draw);
}
