// SPDX-License-Identifier: Apache-2.0
// What operators hold: before actions, goals and states, and behind states.
const machinesOf = (state) => Object.values((state.machines || {}).holds || {});

export const breakpointsOf = (state) => [...new Set([...(((state.now || {}).executor || {}).breakpoints || []), ...machinesOf(state).flatMap((node) => node.breakpoints)])];

// Of one node, or of all.
export const heldStates = (state, node) => Object.entries((state.machines || {}).holds || {}).filter(([name]) => !node || name === node).flatMap(([, { held }]) => held);

// [state, outcome, namespace] of those that have ended and wait for an operator.
export const unconfirmed = (state) => Object.entries((state.machines || {}).holds || {}).flatMap(([node, { confirm }]) => (confirm || []).map((each) => [...each, namespaceOf(node)]));

export const namespaceOf = (name) => name.slice(0, name.lastIndexOf("/") + 1);

export const isHeld = (state) => Boolean(((state.now || {}).executor || {}).held) || heldStates(state).length > 0;

export const LEVELS = ["off", "low", "high", "full"];

// The lowest level of all nodes whose machines use levels; empty: none does.
export const autonomyOf = (state) => LEVELS.find((level) => machinesOf(state).some((node) => node.autonomy === level)) || "";

// A state as its node calls it, NAVIGATE/DRIVE: the path that viewers show begins with the robot's namespace, /r1_NAVIGATE/DRIVE.
export function stateName(server, id) {
  const [root, ...inner] = id.split("/").slice(1);
  const machine = server.split("/").pop().toUpperCase();
  return [root.toUpperCase().endsWith(`_${machine}`) ? machine : root, ...inner].join("/");
}
