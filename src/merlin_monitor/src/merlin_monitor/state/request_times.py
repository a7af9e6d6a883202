# SPDX-License-Identifier: Apache-2.0
"""When requests were expected to run, and when they did: what the queue shows beside each other.

Times are ROS time, s.
"""

from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

#: Requests that have ended and are shown, and requests that are remembered at the most.
SHOWN, REMEMBERED = 12, 2000


class Begun(NamedTuple):
    """A request that runs, or has run and waits again.

    :ivar at: when it was first seen to run.
    :ivar goals: PDDL texts.
    """

    at: float
    goals: List[str]


class Shown(NamedTuple):
    """What is shown of a request, which ends when its status and the queue no longer name it.

    :ivar words: of its goals, phrases.
    :ivar goals: PDDL texts.
    :ivar deadline: 0 where it has none.
    """

    words: List[Any]
    goals: List[str]
    deadline: float


class RequestTimes:
    """Expectation and truth of requests, by their actionlib goal id. Not for several threads."""

    def __init__(self) -> None:
        self._begun: Dict[str, Begun] = {}
        self._shown: Dict[str, Shown] = {}
        self._expected: Dict[str, Tuple[float, float]] = {}
        self._ended: Dict[str, Dict[str, Any]] = {}

    def expect(self, request: str, begin: float, end: float, shown: Shown) -> List[float]:
        """Takes when a request is expected to run, and returns what was expected first.

        :param begin: of it; of one that runs, when it began.
        :param end: 0 where it is not known, which is then returned.
        """
        _bounded(self._shown)
        self._shown[request] = shown
        if end:
            _bounded(self._expected)
            self._expected.setdefault(request, (begin, end))
        return list(self._expected.get(request, (begin, end)))

    def begin(self, request: str, at: float, goals: List[str]) -> bool:
        """Takes a request that runs. Returns whether it is known to have run before."""
        before = request in self._begun
        _bounded(self._begun)
        self._begun.setdefault(request, Begun(at, goals))
        return before

    def remember(self, kept: Mapping[str, Any]) -> None:
        """Takes a request that ran in an earlier life of the monitor, as the state had it."""
        request, (begin, end) = kept["request"], kept.get("planned") or (0.0, 0.0)
        self.begin(request, kept["began"], list(kept["goals"]))
        self.expect(request, begin, end, Shown(kept.get("words", []), list(kept["goals"]), 0.0))

    def run(self, request: str, at: float, end: float, shown: Shown) -> Dict[str, Any]:
        """Takes what is expected of a request that runs, or of none (empty).

        :return: when it began, and what was expected first.
        """
        if not request:
            return {"began": 0.0, "planned": [0.0, 0.0]}
        began = self._begun.get(request, Begun(at, [])).at
        return {"began": began, "planned": self.expect(request, began, end, shown)}

    def began(self, request: str) -> Optional[Begun]:
        """What is known of a request that has begun and not ended."""
        return self._begun.get(request)

    def end(self, request: str, at: float, outcome: str) -> None:
        """Takes the end of a request."""
        begun = self._begun.pop(request, None)
        planned = self._expected.pop(request, None)
        shown = self._shown.pop(request, Shown([], [], 0.0))
        self._ended[request] = {
            "request": request,
            "words": shown.words,
            "goals": begun.goals if begun else shown.goals,
            "planned": list(planned) if planned else None,
            "real": [min(begun.at, at), at] if begun else None,
            "deadline": shown.deadline,
            "state": outcome,
        }
        if len(self._ended) > SHOWN:
            del self._ended[next(iter(self._ended))]

    def goals(self, request: str) -> List[str]:
        """The goals of a request that runs, waits or has ended lately; none: it has not been heard of."""
        known = self._begun.get(request) or self._shown.get(request)
        return known.goals if known else self._ended.get(request, {}).get("goals", [])

    def ended(self) -> List[Dict[str, Any]]:
        """The requests that have ended lately, the last one last."""
        return list(self._ended.values())


def _bounded(table: Dict[str, Any]) -> None:
    if len(table) >= REMEMBERED:  # their ends were not heard
        del table[next(iter(table))]
