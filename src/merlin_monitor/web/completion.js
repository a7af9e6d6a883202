// SPDX-License-Identifier: Apache-2.0
// Completes a goal in PDDL from the domain and the objects.
import { of } from "./names.js";

const MOST = 40;
const WORDS = [["and", "all of these"], ["not", "the opposite"], [">=", "comparison"], ["<=", "comparison"], [">", "comparison"], ["<", "comparison"], ["=", "comparison"]];

// Choices for the word at the caret: {text, note, from, to, typed}.
export function complete(text, caret, knowledge) {
  const domain = knowledge.domain || {};
  const before = text.slice(0, caret);
  const typed = /[^\s()]*$/.exec(before)[0];
  const from = caret - typed.length;
  const to = caret + /^[^\s()]*/.exec(text.slice(caret))[0].length;
  const choice = (word, note) => ({ text: word, note, from, to, typed });
  const stack = opened(before.slice(0, from));
  if (!stack.length) {
    if (before.trim()) return [];
    return heads(domain, "").map(([word, note]) => choice(`(${word} `, note)).slice(0, MOST);
  }
  const inside = stack[stack.length - 1];
  const fits = (word) => word.toLowerCase().startsWith(typed.toLowerCase());
  if (!inside.length) {
    const outer = stack.length > 1 ? stack[stack.length - 2][0] : "";
    return heads(domain, outer).filter(([word]) => fits(word)).map(([word, note]) => choice(word + (arity(domain, word) ? " " : ")"), note)).slice(0, MOST);
  }
  const signature = find(domain, inside[0]);
  const parameter = signature && signature[inside.length - 1];
  if (!parameter) return [];
  const last = inside.length === signature.length;
  return Object.entries(knowledge.objects || {})
    .filter(([name, object]) => fits(name) && isA(object.type, parameter[1], domain.types || {}))
    .map(([name, object]) => choice(name + (last ? ")" : " "), object.type))
    .slice(0, MOST);
}

// The words of every parenthesis that is still open.
function opened(text) {
  const stack = [];
  for (const [word] of text.matchAll(/[()]|[^\s()]+/g)) {
    if (word === "(") stack.push([]);
    else if (word === ")") {
      stack.pop();
      if (stack.length) stack[stack.length - 1].push("()");
    } else if (stack.length) stack[stack.length - 1].push(word);
  }
  return stack;
}

function heads(domain, outer) {
  const signature = (table) => Object.entries(table || {}).map(([name, parameters]) => [name, parameters.map(([variable, type]) => `?${variable} - ${type}`).join(" ")]);
  if ([">=", "<=", ">", "<", "="].includes(outer)) return signature(domain.functions);
  const predicates = signature(domain.predicates);
  if (outer === "not") return predicates;
  return [...predicates, ...(Object.keys(domain.functions || {}).length ? WORDS : WORDS.slice(0, 2))];
}

function find(domain, name) {
  return of(domain.predicates, name) || of(domain.functions, name);
}

function arity(domain, word) {
  const signature = find(domain, word);
  return !signature || signature.length > 0;
}

export function isA(type, wanted, types) {
  let current = type;
  for (let steps = 0; current && steps < 50; steps += 1) {
    if (current === wanted) return true;
    current = of(types, current);
  }
  return wanted === "object" || !wanted;
}
