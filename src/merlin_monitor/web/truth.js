// SPDX-License-Identifier: Apache-2.0
// What may be said of what is shown: the monitor's rule decides (truth/worst_truth.py), unless it is not heard any more.
import { say, t } from "./texts.js";

// {doing, because, step, state, tone, known, expected, problems}; the feed lives, or what is shown may no longer be true.
export function truthOf({ now = {} }, alive, heardAt) {
  const said = now.said || now;
  const told = {
    doing: say(said.doing), because: say(said.because), step: say(said.step),
    state: say(now.state) || "–", tone: now.tone || "", known: Boolean(now.known), expected: Boolean(now.expected), problems: now.problems,
  };
  if (alive || !told.doing) return told;
  const silent = newsText(heardAt);
  return {
    doing: t("not known: {what}", { what: silent }), because: t("before: {what}", { what: told.doing }), step: "",
    state: t("Not known"), tone: "bad", known: false, expected: false, problems: [{ key: "", rank: 1, said: silent, by: "" }, ...(told.problems || [])],
  };
}

export const newsText = (heardAt) => (heardAt ? t("no news since {time}", { time: heardAt.toLocaleTimeString() }) : t("no connection"));
