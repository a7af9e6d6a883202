# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a robot, the worst first, and which of it an operator knows about."""

from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple

from merlin_monitor.text.phrase import Phrase, say
from merlin_monitor.truth.worst_truth import lost_words

BASE, GONE, WARNING = 0, 1, 2
PLANNER = ("unsolvable", "no plan", "timeout", "crashed", "invalid")
#: Section → its fields that are phrases about what is wrong.
_PHRASES = {"map": ("stands", "trouble"), "history": ("unwritten", "damaged")}
#: s of wall time for which a problem has to be gone before it counts as a new one when it is back.
OVER = 60.0


class Problem(NamedTuple):
    """A problem.

    :ivar key: the same as long as it is the same problem, although its words change.
    :ivar rank: `BASE`, `GONE` for what is gone or failed, `WARNING`.
    """

    key: str
    rank: int
    said: Phrase


def problems_of(
    sections: Mapping[str, Mapping[str, Any]],
    panels: Iterable[Mapping[str, Any]],
    clock: Callable[[float], str],
) -> List[Problem]:
    """The problems, the worst first.

    :param sections: ``guard``, ``now``, ``health``, ``plan``, ``map`` and ``history``, each with its
        ``silent``, too.
    :param panels: name and title of those that may be silent.
    :param clock: how a moment, s of ROS time, is shown.
    """
    plan = sections.get("plan", {})
    found = [*_of_the_base(sections.get("guard", {})), *_of_nodes(sections.get("now", {}))]
    for panel in panels:
        silent = sections.get(panel["name"], {}).get("silent")
        if silent:
            title = say(panel["title"] or "Now")
            said = say("{what}: no news since {time}", what=title, time=clock(silent["since"]))
            found.append(Problem(f"silent {panel['name']}", GONE, said))
    for name, part in sections.get("health", {}).get("parts", {}).items():
        level = "silent" if part.get("silent") else part.get("level", "ok")
        if level == "silent":
            found.append(Problem(f"part {name} silent", GONE, say("{what} is silent", what=name)))
        elif level != "ok":
            rank = WARNING if level == "warning" else GONE
            said = say("{what}: {why}", what=name, why=part.get("message", ""))
            found.append(Problem(f"part {name} {level}", rank, said))
    if plan.get("planner", {}).get("state") in PLANNER:
        found.append(Problem("planner", GONE, say("No plan was found")))
    for name, fields in _PHRASES.items():
        shown = sections.get(name, {})
        found += [Problem(f"{name} {field}", WARNING, shown[field]) for field in fields if shown.get(field)]
    return sorted(found, key=lambda problem: problem.rank)


def _of_nodes(now: Mapping[str, Any]) -> Iterable[Problem]:
    mission = now.get("mission", {}).get("name", "")
    for owner, lost in now.get("lost", {}).items():
        yield Problem(f"owner {owner}", GONE, lost_words(owner, mission, lost))
    for node in now.get("silent_nodes", []):
        yield Problem(f"node {node}", GONE, say("{node} does not answer", node=node))


def _of_the_base(guard: Mapping[str, Any]) -> Iterable[Problem]:
    state, why = guard.get("state"), guard.get("reason", "")
    said: Dict[Any, Phrase] = {
        "stopped": say("Nothing moves the base until it is released."),
        "partly": say("Not all robots are held."),
        "silent": say("The base is not watched"),
        "holding": say("{what}: {why}", what=say("The base is held"), why=why),
    }
    if state in said:
        yield Problem(f"guard {state}", BASE, said[state])
    if guard.get("warning"):
        yield Problem("guard warning", BASE, guard["warning"])


class Acknowledged:
    """Which problems an operator knows about; one that was gone for `OVER` is a new one."""

    def __init__(self) -> None:
        self._by: Dict[str, str] = {}
        self._seen: Dict[str, float] = {}

    def acknowledge(self, key: str, by: str) -> None:
        """An operator knows about a problem."""
        self._by[key] = by
        self._seen.pop(key, None)  # one that is not there next time has ended then

    def of(self, problems: Iterable[Problem], wall: float) -> List[Dict[str, Any]]:
        """The problems as the state has them, with ``by`` who knows about it; those come last.

        :param wall: s of any clock that never goes back, always the same one.
        """
        shown = []
        for problem in problems:
            by = self._by.get(problem.key, "")
            if by:
                self._seen[problem.key] = wall
            shown.append({"key": problem.key, "rank": problem.rank, "said": problem.said, "by": by})
        for key in self._by:
            self._seen.setdefault(key, wall)
        for key in [key for key, seen in self._seen.items() if wall - seen > OVER]:
            del self._by[key], self._seen[key]
        return sorted(shown, key=lambda each: bool(each["by"]))
