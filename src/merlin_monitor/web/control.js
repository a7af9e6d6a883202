// SPDX-License-Identifier: Apache-2.0
// Asks the robot to do something, for operators: each request carries the token of one.
import { PATIENCE, reasonOf } from "./answers.js";
import { byId, secondsText, setHidden, setText } from "./dom.js";
import { t } from "./texts.js";

const LOOK = `merlin-look-${location.port}`; // cookie of the right to look, and no other
const TOKEN = `merlin-token ${new URL(".", document.baseURI).pathname}`; // one address may have several robots below it
const STOP_PATIENCE = 3000; // ms; then the press is sent again
const STOP_AGAIN = 500; // ms
const READ = 12000; // ms that what was done stays in sight; what was not done stays

export class Control {
  constructor(store) {
    this.store = store;
    this.token = sessionStorage.getItem(TOKEN) || "";
    this.waiting = null; // what is asked as soon as the token is known
    this.forget = 0;
    this.pressed = ""; // the press of Stop that is not confirmed yet
    byId("stop").addEventListener("click", () => this.stop());
    byId("confirm-not").addEventListener("click", () => byId("confirm-ask").close());
    byId("operator").addEventListener("click", () => (this.token ? this.signOut() : this.signIn()));
    byId("sign-in-not").addEventListener("click", () => this.close());
    byId("sign-in").addEventListener("cancel", () => { this.waiting = null; });
    byId("sign-in").querySelector("form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.enter(byId("token").value);
    });
    byId("control-said").addEventListener("click", () => setHidden(byId("control-said"), true));
    store.viewLive(() => this.draw());
    this.name = "";
  }

  // Whether what is shown can be acted on; nothing of the past can.
  possible() {
    return !this.store.past && this.allowed();
  }

  allowed() {
    return Boolean((this.store.live.meta || {}).control);
  }

  // Stop and hold is there whatever is shown.
  draw() {
    const { stops, open_stop } = this.store.live.meta || {};
    setHidden(byId("stop"), !(this.allowed() || open_stop) || stops === false); // a fleet's page has no base to hold
    setHidden(byId("operator"), !this.allowed());
    if (this.allowed() && this.token && !this.name) this.learnName();
    setText(byId("operator"), this.token ? t("{name} – sign out", { name: this.name || t("operator") }) : t("Sign in"));
  }

  async learnName() {
    this.name = "operator";
    const told = await this.send("who", {}, this.token);
    if (told.status === 200) {
      this.name = told.words;
      this.look(told.object.look);
    }
    if (told.status === 403) {
      this.signOut();
      this.say(told);
    }
    this.draw();
  }

  // Where only operators may look.
  look(key) {
    if (!key || document.cookie.includes(key)) return;
    document.cookie = `${LOOK}=${key}; SameSite=Strict${location.protocol === "https:" ? "; Secure" : ""}`;
    if (document.cookie.includes(key)) location.reload(); // else the browser keeps no cookies
  }

  signIn(words = "") {
    setText(byId("sign-in-said"), words);
    if (!byId("sign-in").open) byId("sign-in").showModal();
    byId("token").focus();
  }

  signOut() {
    this.token = this.name = "";
    sessionStorage.removeItem(TOKEN);
    this.store.refresh("meta");
    this.draw();
    if (!document.cookie.includes(LOOK)) return;
    document.cookie = `${LOOK}=; Max-Age=0`;
    location.reload();
  }

  close() {
    this.waiting = null;
    byId("token").value = "";
    byId("sign-in").close();
  }

  async enter(token) {
    // A stop does not wait until the name is known.
    const [what, fields, answer] = this.waiting || ["who", {}, () => {}];
    const told = await this.send(what, fields, token);
    if (![200, 400, 409].includes(told.status)) { // what is between may answer, too
      setText(byId("sign-in-said"), told.words);
      return;
    }
    this.token = token;
    sessionStorage.setItem(TOKEN, token);
    this.name = "";
    this.close();
    this.store.refresh("meta");
    this.draw();
    if (what !== "who") this.say(told);
    this.confirm(told, what, fields);
    answer(told.status === 200 ? told.object : null);
  }

  // Sends one press of Stop until it is confirmed: the link may stall, a guard may hang. A release ends it.
  async stop() {
    if (this.pressed) return;
    const began = Date.now();
    const press = `${began}-${Math.random()}`;
    if (!this.token && !this.store.live.meta.open_stop) {
      await this.ask("stop", { press });
      return;
    }
    this.pressed = press;
    let told = { words: "" };
    const show = () => this.say({ status: 0, words: `${t("Sending the stop, for {time} now …", { time: secondsText(Math.round((Date.now() - began) / 1000)) })} ${told.words}` });
    show();
    const clock = setInterval(show, 1000);
    while (this.pressed === press) {
      told = await this.send("stop", { press }, this.token);
      if (told.status === 200 || told.status === 403) break;
      await new Promise((go) => { setTimeout(go, STOP_AGAIN); });
    }
    clearInterval(clock);
    if (this.pressed !== press) return;
    this.pressed = "";
    if (told.wrong) this.signOut();
    this.say(told);
  }

  // What contradicts another operator, or what runs, is asked about.
  confirm(told, what, fields) {
    if (!(told.object || {}).confirm) return;
    setHidden(byId("control-said"), true);
    setText(byId("confirm-said"), told.words);
    byId("confirm-yes").onclick = () => {
      byId("confirm-ask").close();
      this.ask(what, { ...fields, seen: told.object.confirm });
    };
    byId("confirm-ask").showModal();
  }

  // The answer, null when it was not done. Without a token, the operator is asked for it first.
  async ask(what, fields = {}) {
    if (what === "release") this.pressed = "";
    if (!this.token && !(what === "stop" && (this.store.live.meta || {}).open_stop)) {
      this.signIn(what === "stop" ? t("The robot is NOT stopped yet: a token is needed.") : "");
      return new Promise((answer) => { this.waiting = [what, fields, answer]; });
    }
    const told = await this.send(what, fields, this.token);
    if (told.status === 403 && told.wrong) this.signOut();
    this.say(told);
    this.confirm(told, what, fields);
    return told.status === 200 ? told.object : null;
  }

  async send(what, fields, token) {
    try {
      const answer = await fetch(`control/${what}`, {
        method: "POST",
        headers: { "Content-Type": "application/json", "X-Merlin-Token": encodeToken(token) },
        body: JSON.stringify(fields),
        signal: AbortSignal.timeout(what === "stop" ? STOP_PATIENCE : PATIENCE),
      });
      const text = await answer.text();
      let words;
      let object = {};
      try {
        object = JSON.parse(text);
        words = object.done || object.error || text;
      } catch {
        words = reasonOf(answer, text);
      }
      return { status: answer.status, object, words: words.trim(), wrong: words.includes("not the right one") };
    } catch {
      const stop = what === "stop" ? ` ${t("The stop is NOT confirmed: use the button on the robot.")}` : "";
      return { status: 0, words: t("The monitor does not answer.") + stop };
    }
  }

  say({ status, words }) {
    const said = byId("control-said");
    said.toggleAttribute("data-bad", status !== 200);
    setText(said, words);
    setHidden(said, false);
    clearTimeout(this.forget);
    if (status === 200) this.forget = setTimeout(() => setHidden(said, true), READ);
  }
}

// A header takes no characters beyond Latin-1.
function encodeToken(token) {
  return unescape(encodeURIComponent(token));
}
