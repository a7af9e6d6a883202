# SPDX-License-Identifier: Apache-2.0
"""The state as lines of a terminal. Names from ROS cannot move the cursor: only printable signs are shown."""

import unicodedata
from bisect import bisect_right
from collections import Counter
from itertools import accumulate
from typing import Any, Dict, List, NamedTuple

from merlin_monitor.text.phrase import in_english
from merlin_monitor.truth.problems import PLANNER, WARNING
from merlin_ros.work.passed_time import clock_text

GLYPHS = dict(zip(("waiting", "dispatched", "running", "succeeded", "failed", "cancelled"), "o~>+x-"))
STYLES = {"title": "\x1b[1m", "soft": "\x1b[2m", "good": "\x1b[32m", "bad": "\x1b[31m", "": ""}
RESET = "\x1b[0m"
STALLED = 2.0  # s of wall time, as on the page
MOST_STEPS, MOST_FACTS, MOST_EVENTS = 12, 12, 12
#: Times of a request, s of ROS time, and how each is called, as on the page.
TIMES = {
    "not_before": "not before",
    "deadline": "done by",
    "expected_begin": "expected to begin at",
    "expected_end": "expected to end at",
}
BAD = ("failed", "error", "unsolvable", "no plan", "crashed", "silent", "refused")


class Line(NamedTuple):
    """A line and how it is shown: title, soft, good, bad or plain."""

    text: str
    style: str = ""


def printable(text: Any) -> str:
    """A text without what would move the cursor or turn the direction of writing."""
    return "".join(
        letter if unicodedata.category(letter)[0] not in "CZ" or letter == " " else "?"
        for letter in str(text)
    )


def lines(state: Dict[str, Any], changed: Any = (), silence: float = 0.0) -> List[Line]:
    """The state as lines.

    :param changed: events to be shown, newest last.
    :param silence: s of wall time for which nothing was taken in: beyond `STALLED` nothing counts as true.
    """
    now = state.get("now", {})
    meta = state.get("meta", {})
    doing, because, step = (str(now.get(name, "")) for name in ("doing", "because", "step"))
    if silence > STALLED:
        doing, because, step = f"not known: no news for {silence:.0f} s", f"before: {doing}", ""
    shown = [Line(_headline(meta), "soft"), Line(doing[:1].upper() + doing[1:], "title")]
    why = " · ".join(part for part in (because, step) if part)
    if why:
        shown.append(Line(why))
    shown += _problem(now.get("problems", []))
    chain = " > ".join(in_english(link[1]) for link in now.get("chain", []))
    if chain:
        shown.append(Line(chain, "soft"))
    shown += _times(now.get("executor", {}), meta)
    shown += _robots(state.get("robots", {}))
    shown += _plan(state.get("plan", {}))
    shown += _queue(state.get("queue", {}), meta)
    shown += _machines(state.get("machines", {}))
    shown += _knowledge(state.get("knowledge", {}))
    shown += _health(state.get("health", {}))
    events = list(changed)[-MOST_EVENTS:]
    if events:
        shown += _section("Latest")
        shown += [
            Line(f"  {event.at:9.1f}  {event.text}", "bad" if any(word in event.text for word in BAD) else "")
            for event in reversed(events)
        ]
    return shown


def paint(shown: List[Line], width: int, height: int, colour: bool) -> List[str]:
    """Lines cut to a screen, with their styles.

    :param colour: whether the terminal knows styles.
    """
    painted: List[str] = []
    for line in shown[:height]:
        text = printable(line.text)
        ends = list(accumulate(map(_columns, text)))
        if ends and ends[-1] > width:
            text = text[: bisect_right(ends, width - 1)] + ">"
        style = STYLES[line.style] if colour else ""
        painted.append(f"{style}{text}{RESET}" if style else text)
    return painted


def _columns(letter: str) -> int:
    """How many columns a letter takes: Chinese ones take two, accents none."""
    if unicodedata.category(letter) in ("Mn", "Me"):
        return 0
    return 2 if unicodedata.east_asian_width(letter) in "WF" else 1


def _headline(meta: Dict[str, Any]) -> str:
    robot = f" {meta['robot']}" if meta.get("robot") else ""
    simulator = meta.get("simulator")
    speed = ""
    if simulator:
        speed = ", simulation paused" if simulator["paused"] else f", simulated x{simulator['factor']}"
    return f"MERLIN{robot}  {meta.get('time', 0.0):.1f} s{speed}"


def _problem(problems: List[Dict[str, Any]]) -> List[Line]:
    """The worst problem that no operator knows about."""
    fresh = [problem for problem in problems if not problem["by"]]
    if not fresh:
        return []
    more = f" (and {len(fresh) - 1} more)" if len(fresh) > 1 else ""
    return [Line(f"! {in_english(fresh[0]['said'])}{more}", "bad" if fresh[0]["rank"] < WARNING else "")]


def _section(name: str, note: str = "") -> List[Line]:
    return [Line(""), Line(f"{name}{f'  {note}' if note else ''}", "title")]


def _robots(robots: Dict[str, Any]) -> List[Line]:
    known = robots.get("robots", {})
    shown = _section("Robots") if known else []
    for name, robot in sorted(known.items()):
        does = robot.get("away") or ", ".join(map(in_english, robot.get("words", []))) or "waits"
        shown.append(Line(f"  {name}: {does}", "bad" if robot.get("away") else ""))
    return shown


def _plan(plan: Dict[str, Any]) -> List[Line]:
    steps = [plan.get("steps", {}).get(key) for key in plan.get("order", [])]
    planner = plan.get("planner", {})
    note = f"{planner.get('planner', '')} {planner.get('state', '')}".strip()
    shown = _section("Plan", note)
    if planner.get("state") in PLANNER:
        shown.append(Line(f"  {planner.get('reason', '')}", "bad"))
    for step in [step for step in steps if step][:MOST_STEPS]:
        style = {"running": "good", "failed": "bad"}.get(step["state"], "")
        reason = f": {in_english(step['reason'])}" if step.get("reason") else ""
        words = in_english(step["words"])
        shown.append(Line(f"  {GLYPHS.get(step['state'], '?')} {words}  {step['state']}{reason}", style))
    if len(steps) > MOST_STEPS:
        shown.append(Line(f"  … {len(steps) - MOST_STEPS} more", "soft"))
    return shown


def _queue(queue: Dict[str, Any], meta: Dict[str, Any]) -> List[Line]:
    waiting = queue.get("waiting", [])
    shown = _section("Queue", f"{len(waiting)} waiting") if waiting else []
    for request in waiting[:MOST_STEPS]:
        words, waits = in_english(request["words"]), in_english(request.get("waits", ""))
        by = f"priority {request['priority']}, from {request['by']}{waits and f', {waits}'}"
        shown += [Line(f"  {words}  {by}"), *_times(request, meta, "    ")]
    return shown


def _times(request: Dict[str, Any], meta: Dict[str, Any], indent: str = "") -> List[Line]:
    """The times of a request, and why it can no longer be on time; none where it has neither."""
    offset = meta.get("clock_set", 0.0)
    known = [(words, request.get(name)) for name, words in TIMES.items()]
    said = [f"{words} {clock_text(at + offset)}" for words, at in known if at]
    late = in_english(request.get("late", ""))
    text = ", ".join([late] * bool(late) + said)
    return [Line(f"{indent}{text}", "bad" if late else "")] if text else []


def _machines(machines: Dict[str, Any]) -> List[Line]:
    containers = machines.get("containers", {})
    shown = []
    paths = Counter(container["path"] for container in containers.values())
    for container in sorted(containers.values(), key=lambda item: item["path"]):
        name = container["path"]
        if paths[name] > 1:
            name += f" of {container.get('node', '')} {container.get('server', '')}"
        active = container.get("active", [])
        silent = ", silent" if container.get("silent") else ""
        if active:
            shown.append(Line(f"  > {name}: {', '.join(active)}{silent}", "good"))
        elif len(container["path"].strip("/").split("/")) == 1:
            ended = f"ended with {container['outcome']}" if container.get("outcome") else "idle"
            shown.append(Line(f"  o {name}: {ended}{silent}", "soft"))
    return _section("State machines") + shown if shown else []


def _knowledge(knowledge: Dict[str, Any]) -> List[Line]:
    facts = sorted(
        knowledge.get("facts", {}).items(), key=lambda item: item[1].get("at") or 0.0, reverse=True
    )
    counts = ", ".join(f"{len(knowledge.get(kind, {}))} {kind}" for kind in ("facts", "values", "objects"))
    shown = _section("Knowledge", counts)
    shown += [Line(f"  goal {goal}") for goal in list(knowledge.get("goals", {}))[:MOST_FACTS]]
    for text, entry in facts[:MOST_FACTS]:
        who = f"  {entry['by']} at {entry['at']:.1f}" if entry.get("by") else ""
        shown.append(Line(f"  {text}{who}"))
    return shown


def _health(health: Dict[str, Any]) -> List[Line]:
    parts = health.get("parts", {})
    ill = {name: part for name, part in parts.items() if part.get("silent") or part.get("level") != "ok"}
    if not parts:
        return []
    shown = _section("Health", f"{len(parts) - len(ill)} of {len(parts)} well")
    for name, part in sorted(ill.items()):
        word = "silent" if part.get("silent") else part.get("level", "?")
        shown.append(Line(f"  {name}: {word}: {part.get('message', '')}", "bad"))
    return shown
