// SPDX-License-Identifier: Apache-2.0
// Facts, values and goals of PDDL in words, as text/wording.py makes them, for lists too long to be sent as phrases.
import { has, of } from "./names.js";
import { say } from "./texts.js";

const COMPARISONS = { ">=": "≥", "<=": "≤", ">": ">", "<": "<", "=": "=" };
const NAMES = /^[\p{L}\p{N}_\s()<>=?:.+*/@#-]*$/u; // what else there is, is not PDDL
const DEEPEST = 20; // parentheses within each other that are put into words

// words: of the knowledge, made of the application's sentences; wanted: it is a goal, and need not hold.
export function factWords(text, words, wanted = false) {
  const read = parse(text);
  const shown = read && read.map((part) => formula(part, words || {}, wanted));
  return read ? say(shown.length === 1 ? shown[0] : shown) : text;
}

// What a number is the value of.
export function valueWords(text, words) {
  const [name, ...objects] = text.replace(/[()]/g, " ").split(" ").filter(Boolean);
  if (name === undefined || !NAMES.test(text)) return text;
  return say(atom(name, objects, words || {}, false, (names) => spaced(name, /[_-]/g) + (names.length ? ` of ${names.join(", ")}` : "")));
}

export const objectWords = (name, words) => say(of((words || {}).objects, name.toLowerCase())) || spaced(name);

function atom(name, objects, words, wanted, otherwise) {
  const known = of(words.facts, name.toLowerCase());
  const names = objects.map((object) => objectWords(object, words));
  const template = known && say((wanted && known.goal) || known);
  return template === undefined ? otherwise(names) : template.replace(/\{(\d+)\}/g, (whole, at) => names[at] ?? whole);
}

const spaced = (name, marks = /_/g) => name.replace(marks, " ");

// Nested lists of words; null: it cannot be read.
function parse(text) {
  if (!NAMES.test(text)) return null;
  const stack = [[]];
  for (const [word] of text.matchAll(/[()]|[^\s()]+/g)) {
    if (word === "(") stack.push([]);
    else if (word !== ")") stack[stack.length - 1].push(word);
    else if (stack.length > 1) stack[stack.length - 2].push(stack.pop());
    if (stack.length > DEEPEST) return null;
  }
  return stack.length === 1 && stack[0].length ? stack[0] : null;
}

function formula(part, words, wanted) {
  if (typeof part === "string") return objectWords(part, words);
  const [head, ...rest] = part;
  if (head === undefined) return "";
  const inner = (each, goal = false) => formula(each, words, goal);
  if (head === "and") return rest.map((each) => inner(each, wanted));
  if (head === "not" && rest.length === 1) return { say: "not {what}", what: inner(rest[0]) };
  if (has(COMPARISONS, head) && rest.length === 2) {
    return { say: `{left} ${COMPARISONS[head]} {right}`, left: inner(rest[0]), right: inner(rest[1]) };
  }
  if (!part.every((word) => typeof word === "string")) return part.map((each) => say(inner(each))).join(" ");
  return atom(head, rest, words, wanted, (names) => inEnglish(head, names, wanted));
}

const PREPOSITIONS = new Set(["from", "to", "at", "in", "on", "with", "by", "for", "into", "onto", "through", "near"]);

const CLAIMS = /\b(?:already|is|are|was|were|has been|have been)(?: |$)/g; // that it is so already

function inEnglish(predicate, names, wanted) {
  const all = spaced(predicate, /[_-]/g);
  const words = (wanted && all.replace(CLAIMS, "").trim()) || all;
  const last = words.split(" ").filter(Boolean).pop();
  if (names.length === 1 && last !== undefined && PREPOSITIONS.has(last.toLowerCase())) return `${words} ${names[0]}`;
  return [...names.slice(0, 1), words, ...names.slice(1)].join(" ");
}
