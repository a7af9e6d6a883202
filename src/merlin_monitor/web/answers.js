// Answers that are none: the monitor says why in plain text, what stands between it and the page says it by a number.
import { t } from "./texts.js";

export function reasonOf(answer, text) {
  const own = (answer.headers.get("Content-Type") || "").startsWith("text/plain") && text.trim();
  return own || t("The monitor is not reached: {address} answers {status}.", { address: location.host, status: `${answer.status} ${answer.statusText}`.trim() });
}

export async function askFor(address) {
  const answer = await fetch(address);
  if (!answer.ok) throw new Error(reasonOf(answer, await answer.text()));
  return answer.json();
}

// Why no WebSocket comes about, which the browser does not say; empty: nobody answers. A POST names the page's site as a WebSocket does.
export async function whyNoSocket(patience) {
  try {
    const answer = await fetch("live", { method: "POST", signal: AbortSignal.timeout(patience) });
    return answer.ok ? t("The monitor is reached, but WebSockets are not let through: a proxy has to pass on Upgrade and Connection.") : reasonOf(answer, await answer.text());
  } catch {
    return "";
  }
}
