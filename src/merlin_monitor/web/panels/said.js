// SPDX-License-Identifier: Apache-2.0
// The last things that were said, heard and seen, with the picture of the last look.
import { clockText, el, keyed, of, part, setHidden, setText } from "../dom.js";
import { say, t } from "../texts.js";

const GLYPHS = { said: "❝", heard: "◗", seen: "◉" };
const WORDS = { said: t("said"), heard: t("heard"), seen: t("seen") };

export function show(section, { store }) {
  const list = el("ul", { id: "said-list", class: "log", tabindex: 0, "aria-label": t("Said, heard, seen") });
  const picture = el("img", { id: "said-picture", alt: "", hidden: true });
  const empty = el("p", { class: "empty" }, t("Nothing yet."));
  const caption = el("p");
  section.append(el("div", { class: "said" }, el("div", {}, list, empty), el("div", {}, picture, caption)));
  store.view("said", ({ entries = [], picture: version, looked = "" }) => {
    setHidden(empty, entries.length > 0);
    keyed(list, entries, (entry) => entry.number,
      (entry) => el("li", {}, el("span", { class: "at" }, clockText(entry.at)), el("span", { class: "glyph", role: "img", "aria-label": of(WORDS, entry.kind) }, of(GLYPHS, entry.kind)), el("span", { class: "said" })),
      (row, entry) => setText(part(row, "said"), (entry.robot ? `${entry.robot}: ` : "") + say(entry.words)));
    const look = entries.find((entry) => entry.kind === "seen" && entry.robot === looked);
    setText(caption, looked);
    setHidden(picture, !version);
    const source = `pictures/seen.png?version=${version}`;
    if (version && picture.getAttribute("src") !== source) picture.setAttribute("src", source);
    picture.alt = look ? t("Picture of the last look: {what}", { what: say(look.words) }) : t("Picture of the last look");
  });
}
