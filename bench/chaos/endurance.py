# SPDX-License-Identifier: Apache-2.0
"""Many goals on one system, with what its processes hold sampled: does anything grow?"""

import csv
import time
from pathlib import Path
from typing import Dict, List, TextIO, Tuple

from measuring.tables import markdown

from chaos.judging import events
from chaos.judging.scene import scene_at
from chaos.trials import Variant
from chaos.under_test.processes import Usage
from chaos.under_test.system import System

#: How often it looks.
SAMPLES = 20
#: Share of the goals after which every connection has been made.
WARM_UP = 0.1
#: s for a goal to begin, and to end after its cancel.
GOAL_LIMIT = 30.0
#: What a process may grow by between the warm-up and the end.
ALLOWED = Usage(memory_mb=40.0, threads=3, descriptors=8, sockets=6)


def leaks(samples: List[Tuple[int, Dict[str, Usage]]]) -> List[str]:
    """What has grown beyond the allowance, a sentence each.

    :param samples: goals done and what each node held; the first one after the warm-up.
    """
    if len(samples) < 2:
        return []
    (_, before), (goals, after) = samples[0], samples[-1]
    found = []
    for node in sorted(before):
        if node not in after:
            found.append(f"{node} does not run any more after {goals} goals")
            continue
        for name, allowed in ALLOWED._asdict().items():
            grown = getattr(after[node], name) - getattr(before[node], name)
            if grown > allowed:
                found.append(f"{node}: {name} grew by {grown:.0f} in {goals} goals (allowed {allowed:g})")
    return found


def report(samples: List[Tuple[int, Dict[str, Usage]]]) -> str:
    """What each process held after the warm-up and at the end, for the screen and for a page."""
    (first, before), (last, after) = samples[0], samples[-1]
    heads = ("process", "memory, MB", "threads", "descriptors", "sockets")
    rows = [
        [
            node,
            *(
                f"{value:.0f} → {getattr(after[node], name):.0f}" if node in after else f"{value:.0f} → ended"
                for name, value in before[node]._asdict().items()
            ),
        ]
        for node in sorted(before)
    ]
    return f"After {first} and after {last} goals:\n\n{markdown(heads, rows)}"


def run(goals: int, points: Dict[str, Tuple[float, float]], folder: Path, out: TextIO) -> List[str]:
    """Sends goals, cancels each when it has begun, and returns what went wrong.

    :raises StartError: the system does not come up.
    """
    system = System(Variant())
    samples: List[Tuple[int, Dict[str, Usage]]] = []
    warm, step = max(1, round(goals * WARM_UP)), max(1, goals // SAMPLES)
    try:
        system.start()
        for number in range(1, goals + 1):
            wrong = _one(system, number, points)
            if wrong:
                return [f"goal {number}: {wrong}; logs: {system.logs}"]
            if number in (warm, goals) or (number > warm and number % step == 0):
                samples.append((number, system.usage()))
                out.write(f"{number}/{goals} goals\n")
                out.flush()
    finally:
        system.stop()
    _write(folder / "usage.csv", samples)
    out.write(report(samples) + "\n")
    return leaks(samples)


def _one(system: System, number: int, points: Dict[str, Tuple[float, float]]) -> str:
    """One goal; what went wrong, or nothing."""
    log, label = system.log, f"goal {number}"
    truth = scene_at(log.since(max(0, log.position() - 200)), time.monotonic()).truth
    far = max(points, key=lambda name: _distance(truth, points[name]) if truth else 0.0)
    position = log.position()
    system.tell_client(do="send", label=label, goals=[f"(robot_at {far})"])

    def began(event: events.Event) -> object:
        if event.kind == events.ENDED and event["label"] == label:
            return f"ended before its action: {event['outcome']}: {event['reason']}"
        return "" if event.kind == events.GOALS and event["active"] else None

    found = log.wait_for(position, began, time.monotonic() + GOAL_LIMIT, time.monotonic)
    if found is None:
        return f"has not begun after {GOAL_LIMIT:.0f} s"
    if found:
        return str(found)
    system.tell_client(do="cancel", label=label)
    outcome = log.wait_for(
        position,
        lambda event: event["outcome"] if event.kind == events.ENDED and event["label"] == label else None,
        time.monotonic() + GOAL_LIMIT,
        time.monotonic,
    )
    if outcome is None:
        return f"has not ended {GOAL_LIMIT:.0f} s after its cancel"
    return "" if outcome == "CANCELLED" else f"ended {outcome} after its cancel"


def _distance(truth: events.Event, point: Tuple[float, float]) -> float:
    return float(((truth["x"] - point[0]) ** 2 + (truth["y"] - point[1]) ** 2) ** 0.5)


def _write(path: Path, samples: List[Tuple[int, Dict[str, Usage]]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["goals", "node", *Usage._fields])
        for goals, nodes in samples:
            for node, held in sorted(nodes.items()):
                writer.writerow([goals, node, f"{held.memory_mb:.1f}", *held[1:]])
