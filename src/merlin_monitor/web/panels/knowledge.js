// SPDX-License-Identifier: Apache-2.0
// Objects, facts, values and goals: searchable, of any number; what changed lights up.
import { byId, clockText, el, has, keyed, of, part, setText } from "../dom.js";
import { VirtualList } from "../virtual_list.js";
import { factWords, objectWords, valueWords } from "../pddl_words.js";
import { t } from "../texts.js";

const KINDS = [["all", t("All")], ["facts", t("Facts")], ["values", t("Values")], ["objects", t("Objects")], ["goals", t("Goals")]];
const NOUNS = { facts: t("fact"), values: t("value"), objects: t("object"), goals: t("goal") };
const ROW = 28; // px
const LIT = 2600; // ms
const MOST_WORDS = 30000; // facts of which the words are kept
const SIGNS = { "+": "+", "-": "−", "=": "±" };

export function show(section, { store }) {
  section.append(
    el("div", { class: "tools" },
      el("input", { id: "search", type: "search", placeholder: t("Search ( / )"), "aria-label": t("Search the knowledge"), spellcheck: "false" }),
      el("div", { id: "kinds", class: "choices", role: "group", "aria-label": t("Kinds of knowledge") })),
    el("div", { id: "knowledge-list", class: "long", tabindex: 0, role: "list", "aria-label": t("Knowledge") }),
    el("h3", {}, t("Latest changes")),
    el("ul", { id: "knowledge-recent", class: "log", tabindex: 0, "aria-label": t("Latest changes") }),
  );
  const keys = { facts: [], values: [], objects: [], goals: [] }; // sorted
  const lit = new Map(); // kind and key → when it changed
  const spoken = new Map(); // kind and key → words
  let kind = "all";
  let words = [];

  const list = new VirtualList(byId("knowledge-list"), ROW, fillRow);
  const buttons = new Map();
  for (const [name, label] of KINDS) {
    const button = el("button", { "aria-pressed": String(name === kind), onclick: () => choose(name) }, label);
    buttons.set(name, button);
    byId("kinds").append(button);
  }
  byId("search").addEventListener("input", (event) => {
    words = event.target.value.toLowerCase().split(/\s+/).filter(Boolean);
    byId("knowledge-list").scrollTop = 0;
    draw();
  });

  function choose(name) {
    kind = name;
    for (const [known, button] of buttons) button.setAttribute("aria-pressed", String(known === name));
    byId("knowledge-list").scrollTop = 0;
    draw();
  }

  store.watch("knowledge", (change) => {
    if (change === null || change[0][1] === "words") spoken.clear();
    if (change === null) {
      for (const name of Object.keys(keys)) keys[name] = sorted(name);
      return;
    }
    const [, name, key] = change[0];
    if (!has(keys, name)) return;
    if (key === undefined) {
      keys[name] = sorted(name);
      return;
    }
    const place = find(keys[name], key);
    const there = keys[name][place] === key;
    if (change.length === 1) {
      if (there) keys[name].splice(place, 1);
    } else {
      if (!there) keys[name].splice(place, 0, key);
      lit.set(`${name} ${key}`, performance.now());
    }
  });

  function sorted(name) {
    return Object.keys((store.state.knowledge || {})[name] || {}).sort();
  }

  // A fact in the reader's words; PDDL is its detail.
  function wordsOf(name, key) {
    const identity = `${name} ${key}`;
    let shown = spoken.get(identity);
    if (shown === undefined) {
      if (spoken.size > MOST_WORDS) spoken.clear();
      shown = wordsIn(name, key);
      spoken.set(identity, shown);
    }
    return shown;
  }

  function wordsIn(name, key) {
    const { words } = store.state.knowledge || {};
    return name === "objects" ? objectWords(key, words) : (name === "values" ? valueWords : factWords)(key, words, name === "goals");
  }

  function entry(name, key) {
    return of((store.state.knowledge || {})[name], key) || {};
  }

  function draw() {
    const knowledge = store.state.knowledge || {};
    const shown = [];
    for (const name of kind === "all" ? ["goals", "facts", "values", "objects"] : [kind]) {
      for (const key of keys[name]) {
        if (words.length) {
          const more = entry(name, key);
          const text = `${key} ${wordsOf(name, key)} ${more.type || ""} ${more.by || ""}`.toLowerCase();
          if (!words.every((word) => text.includes(word))) continue;
        }
        shown.push([name, key]);
      }
    }
    const now = performance.now();
    for (const [key, at] of lit) if (now - at > LIT) lit.delete(key);
    list.show(shown);
    const counts = { all: 0 };
    for (const name of Object.keys(keys)) counts.all += counts[name] = keys[name].length;
    for (const [name, label] of KINDS) setText(buttons.get(name), `${label} ${counts[name]}`);
    setText(byId("knowledge-note"), knowledge.domain ? t("domain {name}", knowledge.domain) : t(knowledge.source || ""));
    byId("knowledge-note").title = t(knowledge.source || "");
    byId("knowledge-list").setAttribute("aria-label", t("Knowledge, {count} shown", { count: shown.length }));
  }

  function fillRow(row, [name, key]) {
    if (!row.firstChild) {
      row.className = "fact";
      row.append(el("span", { class: "kind" }), el("span", { class: "text" }), el("span", { class: "value" }), el("span", { class: "who" }));
    }
    const value = entry(name, key);
    setText(part(row, "kind"), NOUNS[name]);
    setText(part(row, "text"), wordsOf(name, key));
    row.title = key;
    setText(part(row, "value"), name === "values" ? number(value.value) : value.type || "");
    setText(part(row, "who"), value.by ? `${value.by} · ${clockText(value.at)}` : "");
    const since = lit.get(`${name} ${key}`);
    const identity = since ? `${name} ${key} ${since}` : "";
    if (row.litFor !== identity) {
      row.litFor = identity;
      row.classList.remove("lit");
      if (identity) {
        void row.offsetWidth; // begins the animation anew
        row.classList.add("lit");
        clearTimeout(row.litTimer);
        row.litTimer = setTimeout(() => row.classList.remove("lit"), LIT);
      }
    }
  }

  function drawRecent() {
    const recent = Object.entries((store.state.knowledge || {}).recent || {}).sort((a, b) => b[0] - a[0]);
    keyed(byId("knowledge-recent"), recent.slice(0, 40), ([id]) => id,
      () => el("li", {}, el("span", { class: "at" }), el("span", { class: "glyph" }), el("span", { class: "said" }, el("span", { class: "text" }), " ", el("small", { class: "who" }))),
      (row, [, change]) => {
        setText(part(row, "at"), clockText(change.at));
        setText(part(row, "glyph"), of(SIGNS, change.sign));
        const key = change.key === undefined ? change.text : change.key; // as older recordings have it
        const text = has(NOUNS, change.kind) ? wordsOf(change.kind, key) : change.text;
        const shown = typeof change.value === "number" ? `${text} = ${number(change.value)}` : text;
        setText(part(row, "text"), change.kind === "goals" ? t("goal {text}", { text: shown }) : shown);
        part(row, "text").title = change.text;
        setText(part(row, "who"), change.by);
      });
  }

  store.view("knowledge", draw);
  store.view("knowledge", drawRecent);
}

function number(value) {
  return typeof value === "number" ? String(Number(value.toPrecision(6))) : "";
}

// Where a key is, or belongs, in a sorted array.
function find(keys, key) {
  let low = 0;
  let high = keys.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (keys[middle] < key) low = middle + 1;
    else high = middle;
  }
  return low;
}
