// The last things that were said, heard and seen, with the picture of the last look.
import { clockText, el, keyed, of, part, setHidden, setText } from "../dom.js";
import { say, t } from "../texts.js";

const GLYPHS = { said: "❝", heard: "◗", seen: "◉" };
const WORDS = { said: t("said"), heard: t("heard"), seen: t("seen") };

export function show(section, { store }) {
  const list = el("ul", { id: "said-list", class: "log", tabindex: 0, "aria-label": t("Said, heard, seen") });
  const picture = el("img", { id: "said-picture", alt: "", hidden: true });
  const empty = el("p", { class: "empty" }, t("Nothing yet."));
  section.append(el("div", { class: "said" }, el("div", {}, list, empty), picture));
  store.view("said", ({ entries = [], picture: version }) => {
    setHidden(empty, entries.length > 0);
    keyed(list, entries, (entry) => entry.number,
      (entry) => el("li", {}, el("span", { class: "at" }, clockText(entry.at)), el("span", { class: "glyph", role: "img", "aria-label": of(WORDS, entry.kind) }, of(GLYPHS, entry.kind)), el("span", { class: "said" })),
      (row, entry) => setText(part(row, "said"), say(entry.words)));
    const looked = entries.find((entry) => entry.kind === "seen");
    setHidden(picture, !version);
    const source = `pictures/seen.png?version=${version}`;
    if (version && picture.getAttribute("src") !== source) picture.setAttribute("src", source);
    picture.alt = looked ? t("Picture of the last look: {what}", { what: say(looked.words) }) : t("Picture of the last look");
  });
}
