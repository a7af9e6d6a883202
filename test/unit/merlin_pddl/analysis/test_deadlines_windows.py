# SPDX-License-Identifier: Apache-2.0
"""Deadlines beside time windows, in tasks like those with time windows of the competition of 2004.

The domains are our own. For small tasks all orders are tried: what is possible is found, what is proven to be
late is late, and each plan holds in the task as it was.
"""

import itertools
import sys
from pathlib import Path

from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from merlin_pddl.analysis.deadlines import Due

sys.path.insert(0, str(Path(__file__).parent))

from deadline_world import AIRPORT, LIMIT, SATELLITE, solved

#: Without a search for the smallest example: each one without a plan takes LIMIT.
EXAMPLES = settings(max_examples=6, deadline=None, derandomize=True, database=None, phases=[Phase.generate])
HALF = 0.5  # s by which times of the world lie beside the whole ones of actions, as separations add up
SEARCH = 0.2  # s for what is not there: no time finds it
HORIZON = 400  # s: at which the last window ends

# Batches of oil in a pipe, which always holds one: what goes in at one end pushes out what was in it.
PIPE = """(define (domain pipe)
  (:requirements :typing :durative-actions :timed-initial-literals)
  (:types batch)
  (:predicates (stored ?b - batch) (inside ?b - batch) (delivered ?b - batch) (pumping))
  (:durative-action push :parameters (?in ?out - batch) :duration (= ?duration 6)
    :condition (and (at start (stored ?in)) (at start (inside ?out)) (over all (pumping)))
    :effect (and (at start (not (stored ?in))) (at start (not (inside ?out)))
      (at end (inside ?in)) (at end (delivered ?out)))))"""

# Calls that are set up in two steps, each of which needs a share of a line that is there at times.
CALLS = """(define (domain calls)
  (:requirements :typing :durative-actions :numeric-fluents :timed-initial-literals)
  (:types call)
  (:predicates (new ?c - call) (known ?c - call) (set_up ?c - call) (line))
  (:functions (free) (need ?c - call) (time ?c - call))
  (:durative-action register :parameters (?c - call) :duration (= ?duration 3)
    :condition (and (at start (new ?c)) (at start (>= (free) 1)))
    :effect (and (at start (not (new ?c))) (at start (decrease (free) 1)) (at end (increase (free) 1))
      (at end (known ?c))))
  (:durative-action connect :parameters (?c - call) :duration (= ?duration (time ?c))
    :condition (and (at start (known ?c)) (at start (>= (free) (need ?c))) (over all (line)))
    :effect (and (at start (not (known ?c))) (at start (decrease (free) (need ?c)))
      (at end (increase (free) (need ?c))) (at end (set_up ?c)))))"""


def windows_of(gaps):
    """Windows (begin, end) from the length of each, and how long it is closed afterwards."""
    begin, found = 0.0, []
    for length, closed in gaps:
        found.append((begin, begin + length + HALF))
        begin += length + closed
    return [*found, (begin, HORIZON + HALF)]


def literals(fact, windows):
    """The windows as timed initial literals, open at first."""
    rows = [fact]
    for begin, end in windows:
        rows += [f"(at {begin:g} {fact})"] if begin else []
        rows.append(f"(at {end:g} (not {fact}))")
    return " ".join(rows)


def fits(windows, begin, duration):
    """The earliest time from `begin` on at which something of this duration can begin within a window."""
    return next(max(begin, first) for first, end in windows if max(begin, first) + duration <= end)


def problem(domain, objects, init, goal="(and)"):
    return f"(define (problem p) (:domain {domain}) (:objects {objects}) (:init {init}) (:goal {goal}))"


def flights(windows, planes):
    """Per order: when each plane is airborne. One taxis when the one before is airborne."""
    for order in itertools.permutations(planes):
        now, ends = 0.0, {}
        for plane in order:
            now = ends[plane] = fits(windows, now + 10, 5) + 5
        yield ends


def deliveries(windows, batches):
    """Per order of the pushes: when each batch is delivered. The last one stays in the pipe."""
    for order in itertools.permutations(batches):
        now, ends = 0.0, {}
        for out in ("b0", *order)[: len(order)]:
            now = ends[out] = fits(windows, now, 6) + 6
        yield ends


def images(windows, targets):
    """Per order of taking and of sending: when each image is sent. At first it points at the first target."""
    for order in itertools.permutations(targets):
        now, at, taken = 0.0, targets[0], {}
        for target in order:
            now += 7 + 5 * (target != at)
            at, taken[target] = target, now
        for sending in itertools.permutations(targets):
            now, ends = 0.0, {}
            for target in sending:
                now = ends[target] = fits(windows, max(now, taken[target]), 4) + 4
            yield ends


def connections(windows, calls, line):
    """Per order of the steps, each as early as it fits: when each call is set up. One of these is the best.

    :param calls: share of the line, and s to connect.
    :param line: all of it.
    """
    steps = [(call, step) for call in calls for step in ("register", "connect")]
    for order in itertools.permutations(steps):
        if any(order.index((call, "register")) > order.index((call, "connect")) for call in calls):
            continue
        used, ends = [], {}  # (begin, end, share)
        for call, step in order:
            share, duration = (1, 3) if step == "register" else calls[call]
            earliest = 0.0 if step == "register" else ends[call]
            for begin in sorted({earliest, *(end for _, end, _ in used if end > earliest)}):
                if step == "connect":
                    begin = fits(windows, begin, duration)
                times = [begin, *(b for b, _, _ in used if begin < b < begin + duration)]
                if all(share + sum(s for b, e, s in used if b <= t < e) <= line for t in times):
                    break
            used.append((begin, begin + duration, share))
            ends[call] = begin + duration
        yield ends


def judge(domain, text, goal, possible, wanted):
    """What kairos finds is what the orders say; its plans are validated on the way.

    :param possible: per order, when each object has its goal.
    :param wanted: until when, s.
    """
    dues = [Due((f"({goal} {name})",), within) for name, within in wanted.items()]
    if any(all(ends.get(name, HORIZON) <= within for name, within in wanted.items()) for ends in possible):
        assert solved(domain, text, dues, limit=LIMIT)[0] == "SOLVED"
    else:
        assert solved(domain, text, dues, limit=SEARCH)[1] is None


GAPS = st.lists(st.tuples(st.integers(0, 24), st.integers(1, 20)), min_size=1, max_size=2)
THREE = st.lists(st.integers(-4, 8), min_size=3, max_size=3)


def about(possible, chosen, shifts):
    """Deadlines about those times that an order gives: some sets of them can be kept, and some not."""
    ends = possible[chosen % len(possible)]
    return {name: max(1.0, end + shift) + HALF for (name, end), shift in zip(ends.items(), shifts)}


CHOSEN = st.integers(0, 719)


@given(gaps=GAPS, chosen=CHOSEN, shifts=THREE)
@EXAMPLES
def test_planes_between_closed_times_of_a_runway(gaps, chosen, shifts):
    windows, planes = windows_of(gaps), ["p1", "p2", "p3"]
    possible = list(flights(windows, planes))
    init = f"{' '.join(f'(parked {plane})' for plane in planes)} (vacant) {literals('(open)', windows)}"
    text = problem("airport", f"{' '.join(planes)} - plane", init)
    judge(AIRPORT, text, "airborne", possible, about(possible, chosen, shifts))


@given(gaps=GAPS, chosen=CHOSEN, shifts=THREE)
@EXAMPLES
def test_batches_in_a_pipe_whose_pump_rests(gaps, chosen, shifts):
    windows, batches = windows_of(gaps), ["b1", "b2", "b3"]
    possible = list(deliveries(windows, batches))
    stored = " ".join(f"(stored {batch})" for batch in batches)
    init = f"(inside b0) {stored} {literals('(pumping)', windows)}"
    text = problem("pipe", f"b0 {' '.join(batches)} - batch", init)
    judge(PIPE, text, "delivered", possible, about(possible, chosen, shifts))


@given(gaps=GAPS, chosen=CHOSEN, shifts=THREE)
@EXAMPLES
def test_images_that_are_sent_while_an_antenna_is_seen(gaps, chosen, shifts):
    windows, targets = windows_of(gaps), ["d1", "d2", "d3"]
    possible = list(images(windows, targets))
    seen = literals("(visible dish)", windows)
    text = problem(
        "satellite",
        f"sat - satellite {' '.join(targets)} - direction dish - antenna",
        f"(pointing sat d1) (ready sat) (free dish) {seen}",
    )
    judge(SATELLITE, text, "sent", possible, about(possible, chosen, shifts))


@given(
    gaps=GAPS,
    chosen=CHOSEN,
    shifts=THREE,
    calls=st.lists(st.tuples(st.integers(1, 2), st.integers(2, 9)), min_size=3, max_size=3),
)
@EXAMPLES
def test_calls_that_share_a_line(gaps, chosen, shifts, calls):
    windows, named = windows_of(gaps), {f"c{number}": call for number, call in enumerate(calls)}
    possible = list(connections(windows, named, line=2))
    values = " ".join(
        f"(new {name}) (= (need {name}) {share}) (= (time {name}) {time})"
        for name, (share, time) in named.items()
    )
    init = f"(= (free) 2) {values} {literals('(line)', windows)}"
    text = problem("calls", f"{' '.join(named)} - call", init)
    judge(CALLS, text, "set_up", possible, about(possible, chosen, shifts))
