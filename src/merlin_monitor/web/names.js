// SPDX-License-Identifier: Apache-2.0
// Names of robots may be constructor or __proto__: only what a table has of its own is looked up.
export const has = (table, name) => Boolean(table) && Object.hasOwn(table, name);
export const of = (table, name) => (has(table, name) ? table[name] : undefined);
