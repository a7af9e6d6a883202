// The goals that are served and that wait.
import { byId, el, keyed, part, setHidden, setText } from "../dom.js";

export function show(section, { store, control }) {
  section.append(el("ol", { id: "queue-list", class: "rows" }), el("p", { id: "queue-empty", class: "empty" }, "No goals wait."));
  const draw = () => {
    const { now = {}, queue = {} } = store.state;
    const executor = now.executor || {};
    const requests = [];
    if (executor.request) {
      requests.push({ request: executor.request, goals: executor.goals, priority: executor.priority, running: true, note: `${executor.state}, ${executor.done} of ${executor.total} steps done` });
    }
    for (const waiting of queue.waiting || []) {
      const words = waiting.interrupted ? ["interrupted, resumed afterwards"] : ["waits"];
      if (waiting.on_interrupt === "drop") words.push("dropped when interrupted");
      requests.push({ ...waiting, note: `${words.join(", ")}; from ${waiting.by}` });
    }
    const count = (queue.waiting || []).length;
    setText(byId("queue-note"), count ? `${count} waiting` : "");
    setHidden(byId("queue-empty"), requests.length > 0);
    keyed(byId("queue-list"), requests, (item) => item.request, create, update);
  };

  function create(item) {
    const cancel = el("button", { class: "small cancel", type: "button", onclick: () => control.ask("cancel", { request: item.request }) }, "Cancel");
    return el("li", {},
      el("div", { class: "head" }, el("span", { class: "glyph", "aria-hidden": "true" }), el("span", { class: "title" }), el("span", { class: "end chip priority" }), cancel),
      el("div", { class: "more" }));
  }

  function update(row, item) {
    setText(part(row, "glyph"), item.running ? "▶" : "○");
    setText(part(row, "title"), (item.goals || []).join(" ") || item.request);
    setText(part(row, "priority"), `priority ${item.priority}`);
    setText(part(row, "more"), item.note);
    setHidden(part(row, "cancel"), !control.possible());
  }

  store.view("queue", draw);
  store.view("now", draw);
  store.view("meta", draw);
}
