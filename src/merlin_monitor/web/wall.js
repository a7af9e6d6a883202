// SPDX-License-Identifier: Apache-2.0
// The wall display: large, without what is operated or read at length. ?wall in the address keeps it.
import { byId, setText } from "./dom.js";
import { t } from "./texts.js";

export function wall() {
  const address = new URL(location.href);
  const show = (on) => {
    document.body.toggleAttribute("data-wall", on);
    setText(byId("wall"), on ? t("Whole page") : t("Wall display"));
  };
  byId("wall").addEventListener("click", () => {
    const on = !document.body.hasAttribute("data-wall");
    if (on) address.searchParams.set("wall", "");
    else address.searchParams.delete("wall");
    history.replaceState(null, "", address);
    show(on);
  });
  show(address.searchParams.has("wall"));
}
