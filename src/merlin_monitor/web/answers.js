// SPDX-License-Identifier: Apache-2.0
// Why an answer is none: in the monitor's own words, or by the number that something between has answered.
import { t } from "./texts.js";

export function reasonOf(answer, text) {
  const own = (answer.headers.get("Content-Type") || "").startsWith("text/plain") && text.trim();
  return own || t("{address} answers {status}", { address: location.host, status: `${answer.status} ${answer.statusText}` });
}

export const PATIENCE = 15000; // ms for an answer

export async function askFor(address) {
  try {
    const answer = await fetch(address, { signal: AbortSignal.timeout(PATIENCE) });
    if (!answer.ok) throw new Error(reasonOf(answer, await answer.text()));
    return await answer.json();
  } catch (error) {
    throw error.name === "TimeoutError" ? new Error(t("The monitor does not answer."), { cause: error }) : error;
  }
}

// Why there is no WebSocket, which browsers do not say: a POST names the page's site, too. Empty: no answer.
export async function whyNoSocket(patience) {
  try {
    const answer = await fetch("live", { method: "POST", signal: AbortSignal.timeout(patience) });
    return answer.ok ? t("WebSockets are not let through: a proxy has to pass on Upgrade") : reasonOf(answer, await answer.text());
  } catch {
    return "";
  }
}
