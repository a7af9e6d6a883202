// SPDX-License-Identifier: Apache-2.0
// When the steps of a plan began and end, as planned and as it comes: s of ROS time.
import { of } from "./names.js";

const OPEN = ["waiting", "dispatched", "running"];

export const stepsOf = (plan) => (plan.order || []).map((key) => of(plan.steps, key)).filter(Boolean);

// {origin, delay, begin, end}: where the plan's time zero lies, how late it is, and its real ends; null before it began.
export function planTimes(plan, now) {
  const steps = stepsOf(plan);
  const begun = steps.filter((step) => step.began !== undefined);
  if (!begun.length || !now) return null;
  const origin = Math.min(...begun.map((step) => step.began - step.start));
  const due = (step) => origin + step.start + step.duration;
  const running = begun.filter((step) => OPEN.includes(step.state));
  const ended = begun.filter((step) => step.ended !== undefined).sort((a, b) => b.ended - a.ended);
  const late = running.length
    ? Math.max(...running.map((step) => Math.max(now, step.began + step.duration) - due(step)))
    : ended.length ? ended[0].ended - due(ended[0]) : 0;
  const open = steps.filter((step) => OPEN.includes(step.state));
  const known = steps.some((step) => step.duration > 0.01);
  const begin = Math.min(...begun.map((step) => step.began));
  const last = Math.max(...steps.map((step) => (step.ended !== undefined ? step.ended : OPEN.includes(step.state) ? due(step) + late : begin)));
  return { origin, delay: late, begin, end: Math.max(last, open.length ? now : begin), open: open.length > 0, known };
}

// From when to when a step is expected, or was.
export function stepSpan(step, times, now) {
  const planned = times ? [times.origin + step.start, times.origin + step.start + step.duration] : [step.start, step.start + step.duration];
  if (step.began === undefined) return { planned, real: null };
  return { planned, real: [step.began, step.ended !== undefined ? step.ended : now] };
}
