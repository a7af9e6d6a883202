// Asks the robot to do something, for operators: each request carries the token.
import { byId, setHidden, setText } from "./dom.js";

const TOKEN = "merlin-token";

export class Control {
  constructor(store) {
    this.store = store;
    byId("stop").addEventListener("click", async () => {
      if (!(await this.ask("stop", {}))) byId("control").scrollIntoView({ block: "center" });
    });
    store.view("meta", () => setHidden(byId("stop"), !this.possible()));
  }

  possible() {
    return Boolean((this.store.state.meta || {}).control);
  }

  get token() {
    return sessionStorage.getItem(TOKEN) || "";
  }

  set token(token) {
    sessionStorage.setItem(TOKEN, token);
  }

  // Whether it was done; what was said about it stands in the panel.
  async ask(what, fields) {
    const said = byId("control-said");
    try {
      const answer = await fetch(`/control/${what}`, {
        method: "POST",
        headers: { "Content-Type": "application/json", "X-Merlin-Token": encodeToken(this.token) },
        body: JSON.stringify(fields),
      });
      const text = await answer.text();
      let words = text;
      try {
        const object = JSON.parse(text);
        words = object.done || object.error || text;
      } catch {
        // a refusal is plain text
      }
      said.toggleAttribute("data-bad", !answer.ok);
      setText(said, words.trim());
      return answer.ok;
    } catch {
      said.toggleAttribute("data-bad", true);
      setText(said, "The monitor does not answer.");
      return false;
    }
  }
}

// A header takes no characters beyond Latin-1.
function encodeToken(token) {
  return unescape(encodeURIComponent(token));
}
