// SPDX-License-Identifier: Apache-2.0
// Asks the robot why, and shows its answers with what shows each claim.
import { clockText, el, keyed, part, setHidden, setText, tell } from "../dom.js";
import { say } from "../texts.js";

const pddl = ({ name, parameters }) => `(${[name, ...parameters.map(([, value]) => value)].join(" ")})`;
const QUESTIONS = { why: "Why", waiting: "Why waits", failed: "Why failed", so: "Why is so", doing: "What are you doing", no_plan: "Why no plan", what_if: "What if" };

export const style = ".why-answers .sentence { font-size: 1.1em; } .why-answers pre { white-space: pre-wrap; margin: 0 0 6px 18px; }";

export function show(section, { store, control }) {
  const ask = (question, fields = {}) => control.ask("why", { question, ...fields });
  const choices = el("div", { class: "choices", role: "group", "aria-label": "Questions" });
  const facts = el("input", { id: "why-facts", class: "code", spellcheck: "false", placeholder: "(robot_at kitchen)" });
  const goals = el("input", { id: "why-goals", class: "code", spellcheck: "false", placeholder: "the present goals" });
  const field = (input, label) => el("div", { class: "field grow" }, el("label", { for: input.id }, label), input);
  const form = el("form", { id: "what-if", autocomplete: "off" }, field(facts, "What if this were so"), field(goals, "for the goal"), el("button", { type: "submit" }, "What if"));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    ask("what_if", { facts: facts.value, goals: goals.value });
  });
  const asked = el("p", { class: "why-asked" });
  const cancel = el("button", { class: "small why-cancel", onclick: () => control.ask("why_not_wanted") }, "Take the question back");
  const answers = el("ul", { class: "rows why-answers" });
  section.append(choices, form, asked, cancel, answers);

  function offer() {
    const { now = {}, queue = {} } = store.state;
    const executor = now.executor || {};
    const offered = [["What are you doing?", "doing", ""], ["Why did the last thing fail?", "failed", ""], ["What does the next step wait for?", "waiting", ""]];
    if (executor.request) for (const goal of executor.goals) offered.push([`Why ${goal}?`, "why", goal]);
    for (const action of executor.running || []) offered.push([`Why ${pddl(action)}?`, "why", pddl(action)]);
    for (const waiting of queue.waiting || []) offered.push([`Why does ${say(waiting.words) || waiting.request} wait?`, "waiting", waiting.request]);
    keyed(choices, offered, ([, question, about]) => `${question} ${about}`, ([label, question, about]) => el("button", { onclick: () => ask(question, { about }) }, label), () => {});
    for (const each of [choices, form]) setHidden(each, !control.possible());
  }
  for (const view of ["now", "queue", "meta"]) store.view(view, offer);

  const title = ({ question, about, facts: so, goals: wanted }) => [`${QUESTIONS[question] || question}`, about, ...so, ...(wanted.length ? ["for", ...wanted] : [])].filter(Boolean).join(" ");
  store.view("why", ({ asked: open, answers: given = [] }) => {
    tell(asked, open && `${open.by} asks: ${title(open)}? It is being answered.`);
    setHidden(cancel, !open || !control.possible());
    keyed(answers, given, ({ number }) => number, (answer) => el("li", {},
      el("div", { class: "head" }, el("span", { class: "title" }, `${title(answer)}?`), el("span", { class: "end" }, `${answer.by}, ${clockText(answer.at)}`)),
      el("p", { class: "sentence" }),
      answer.claims.length ? el("details", {}, el("summary", {}, "What shows it"), el("ul", {}, answer.claims.map(({ text, evidence }) => el("li", {}, text, evidence.map((each) => el("pre", { class: "code" }, each)))))) : null),
    (row, { ok, sentence }) => {
      setText(part(row, "sentence"), ok ? sentence : `Not answered: ${sentence}`);
    });
  });
}
