// SPDX-License-Identifier: Apache-2.0
// What was shown at a moment, as the history has it: segments that begin with a whole state.
import { askFor } from "./answers.js";
import { applyChange } from "./store.js";

const KEPT = 4; // segments
const FRESH = 1000; // ms for which the end of a run that goes on is not asked for again
const SMOOTH = 5; // s forward that are shown as changes

// The address of a moment: what is shown as soon as that time has been taken in.
export const momentLink = ({ run, wall }) => `#moment=${run}@${wall}`;

export function momentOf(hash) {
  const match = /^#moment=(\d{1,9})@(\d{1,12}(?:\.\d{1,6})?)$/.exec(hash);
  return match && { run: Number(match[1]), wall: Number(match[2]) };
}

export function ask(what, fields = {}) {
  const query = new URLSearchParams(Object.entries(fields).filter(([, value]) => value !== undefined));
  return askFor(`past/${what}?${query}`);
}

export class Past {
  constructor(store) {
    this.store = store;
    this.segments = []; // the one used last is the last one
    this.segment = null;
    this.index = 0; // of the frame that is shown
    this.asked = new Map(); // segment's place → promise
  }

  // The time of the frame that is shown, s since 1970, and ROS time.
  get wall() {
    return this.segment.frames[this.index][0];
  }

  get at() {
    return this.segment.frames[this.index][1];
  }

  get run() {
    return this.segment.run;
  }

  // Whether this frame is the last one before some that cannot be read.
  get broken() {
    return Boolean(this.segment.damaged) && this.index === this.segment.frames.length - 1;
  }

  forget() {
    this.segment = null;
  }

  // A segment that is here already.
  known(run, wall) {
    return this.segments.find((segment) => {
      const { frames, began, next } = segment;
      if (segment.run !== run || wall < began || (next !== null && wall >= next)) return false;
      const last = frames[frames.length - 1][0];
      return next !== null || wall <= last || performance.now() - segment.fetched < FRESH;
    });
  }

  async fetch(run, wall) {
    const key = `${run}@${wall}`;
    if (!this.asked.has(key)) {
      this.asked.set(key, ask("segment", { run, wall }).finally(() => this.asked.delete(key)));
    }
    const segment = await this.asked.get(key);
    segment.fetched = performance.now();
    if (this.segment && this.segment.run === segment.run && this.segment.number === segment.number) this.segment = segment;
    this.segments = this.segments.filter((other) => other.run !== segment.run || other.number !== segment.number);
    this.segments = [...this.segments, segment].slice(-KEPT);
    return segment;
  }

  // Shows what was shown at a time; with `after`, as soon as that time has been taken in. What comes when it is not
  // wanted any more is not shown; returns whether it is.
  async show(run, wall, after, wanted) {
    let segment = this.known(run, wall) || await this.fetch(run, wall);
    let index = place(segment.frames, wall);
    if (after && segment.frames[index][0] < wall) {
      if (index + 1 < segment.frames.length) index += 1;
      else if (segment.next !== null) [segment, index] = [this.known(run, segment.next) || await this.fetch(run, segment.next), 0];
    }
    if (!wanted()) return false;
    this.put(segment, index);
    return true;
  }

  // The same at once, if it is here.
  showKnown(run, wall) {
    const segment = this.known(run, wall);
    if (segment) this.put(segment, place(segment.frames, wall));
    return Boolean(segment);
  }

  put(segment, index) {
    const { frames } = segment;
    const ahead = this.segment === segment && index >= this.index && frames[index][0] - frames[this.index][0] < SMOOTH;
    const from = ahead && this.store.past ? this.index : 0;
    if (from) {
      for (const [, , changes] of frames.slice(from + 1, index + 1)) this.store.changePast(structuredClone(changes));
    } else {
      const state = structuredClone(frames[0][2]);
      for (const [, , changes] of frames.slice(1, index + 1)) {
        for (const change of structuredClone(changes)) applyChange(state, change);
      }
      this.store.showPast(state);
    }
    this.segment = segment;
    this.index = index;
  }
}

// The last frame that is not later.
function place(frames, wall) {
  let low = 0;
  let high = frames.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (frames[middle][0] <= wall) low = middle;
    else high = middle - 1;
  }
  return low;
}
