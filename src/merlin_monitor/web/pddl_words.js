// SPDX-License-Identifier: Apache-2.0
// Facts, values and goals of PDDL in words, as text/phrase.py makes them, for lists too long to be sent as phrases.
import { has } from "./names.js";
import { say } from "./texts.js";

const COMPARISONS = { ">=": "≥", "<=": "≤", ">": ">", "<": "<", "=": "=" };
const NAMES = /^[\p{L}\p{N}_\s()<>=?:.+*/@#-]*$/u; // what else there is, is not PDDL
const DEEPEST = 20; // parentheses within each other that are put into words

export function factWords(text) {
  const read = parse(text);
  return read ? say(read.length === 1 ? formula(read[0]) : read.map(formula)) : text;
}

// What a number is the value of.
export function valueWords(text) {
  const [name, ...objects] = text.replace(/[()]/g, " ").split(" ").filter(Boolean);
  if (name === undefined || !NAMES.test(text)) return text;
  const of = objects.map((object) => spaced(object));
  return say({ fact: name, english: spaced(name, /[_-]/g) + (of.length ? ` of ${of.join(", ")}` : ""), of });
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

function formula(part) {
  if (typeof part === "string") return spaced(part);
  const [head, ...rest] = part;
  if (head === undefined) return "";
  if (head === "and") return rest.map(formula);
  if (head === "not" && rest.length === 1) return { say: "not {what}", what: formula(rest[0]) };
  if (has(COMPARISONS, head) && rest.length === 2) {
    return { say: `{left} ${COMPARISONS[head]} {right}`, left: formula(rest[0]), right: formula(rest[1]) };
  }
  if (!part.every((word) => typeof word === "string")) return part.map((each) => say(formula(each))).join(" ");
  const of = rest.map((name) => spaced(name));
  return { fact: head, english: inEnglish(head, of), of };
}

const PREPOSITIONS = new Set(["from", "to", "at", "in", "on", "with", "by", "for", "into", "onto", "through", "near"]);

function inEnglish(predicate, names) {
  const words = spaced(predicate, /[_-]/g);
  const last = words.split(" ").filter(Boolean).pop();
  if (names.length === 1 && last !== undefined && PREPOSITIONS.has(last.toLowerCase())) return `${words} ${names[0]}`;
  return [...names.slice(0, 1), words, ...names.slice(1)].join(" ");
}
