// SPDX-License-Identifier: Apache-2.0
// The page's texts in the reader's language: ?lang=de, else what the browser asks for. English is the key of each.
import { has } from "./names.js";

const TABLES = ["de"]; // languages with a table, texts.<language>.json
const wanted = [new URLSearchParams(location.search).get("lang"), ...(navigator.languages || [])];
const known = wanted.map((name) => (name || "").slice(0, 2).toLowerCase()).find((name) => name === "en" || TABLES.includes(name));

export const language = known || "en";
const table = await load();
document.documentElement.lang = language;

async function load() {
  if (language === "en") return {};
  try {
    const answer = await fetch(`texts.${language}.json`);
    return answer.ok ? await answer.json() : {};
  } catch {
    return {}; // English is better than no page
  }
}

const own = (name) => (has(table, name) ? table[name] : name);

// A text with its blanks filled in: t("step {number} of {count}", {number: 2, count: 5}).
export function t(text, blanks = {}) {
  return own(text).replace(/\{(\w+)\}/g, (whole, name) => (has(blanks, name) ? String(blanks[name]) : whole));
}

const filled = (text, blanks) => text.replace(/\{(\w+)\}/g, (whole, name) => (has(blanks, name) ? say(blanks[name]) : whole));

// A phrase of the monitor (text/phrase.py): a text, a list, a sentence with blanks, or a text in several languages.
export function say(phrase) {
  if (phrase === null || phrase === undefined) return "";
  if (typeof phrase !== "object") return String(phrase);
  if (Array.isArray(phrase)) return listed(phrase.map(say));
  if (phrase.english !== undefined) {
    if (has(phrase, language)) return phrase[language];
    return language === "en" || !phrase.action ? phrase.english : t("doing {what}", { what: phrase.action });
  }
  return filled(own(String(phrase.say)), phrase);
}

// An event of the history: as a phrase where the monitor has sent one.
export const told = (event) => (event.detail && event.detail.said !== undefined ? say(event.detail.said) : event.text);

function listed(texts, most = 3) {
  if (texts.length > most) return t("{first} and {count} more", { first: texts.slice(0, most).join(", "), count: texts.length - most });
  if (texts.length > 1) return t("{first} and {last}", { first: texts.slice(0, -1).join(", "), last: texts[texts.length - 1] });
  return texts.join("");
}
