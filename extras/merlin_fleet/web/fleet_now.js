// SPDX-License-Identifier: Apache-2.0
// The headline of the fleet's page: how it is, and first of all whether that is known.
import { byId, el, setText, tell } from "../dom.js";
import { language, t } from "../texts.js";

const clock = (at) => new Date(at * 1000).toLocaleTimeString(language);

export function show(section, { store }) {
  section.append(
    el("p", { id: "now-line", "aria-live": "polite" }),
    el("p", { id: "now-trouble", role: "alert", hidden: true }),
    el("p", { id: "now-why" }));
  store.view("fleet", ({ fleet, missing, missing_since: since, counts = {}, robots = {} }) => {
    const lost = Object.entries(robots).filter(([, robot]) => !robot.joined);
    const line = missing ? (since ? t("The hub is not reached since {time}", { time: clock(since) }) : t("The hub is not reached")) : t("{joined} of {robots} robots joined", counts);
    setText(byId("now-line"), line);
    const trouble = missing ? [missing] : lost.map(([name, { heard }]) => t("{what}: not seen since {time}", { what: name, time: clock(heard) }));
    tell(byId("now-trouble"), trouble.join(" · "));
    setText(byId("now-why"), missing ? t("Robots go on with what they own until their lease ends.") : t("Goals: {owned} owned, {open} open", counts));
    document.title = `${line} – ${fleet || "MERLIN"}`;
  });
}
