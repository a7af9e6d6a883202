# SPDX-License-Identifier: Apache-2.0
"""What a robot does, says, hears and sees, one line each: what was received goes in, lines come out."""

import threading
from collections import deque
from typing import Any, Callable, Deque, Dict, List, NamedTuple, Optional, Sequence, Tuple

CANCELLED = "cancelled"

#: Requests, actions that run and actions that have ended, each, that are remembered.
REMEMBERED = 10000


class Deed(NamedTuple):
    """One action that the robot carried out, s of ROS time.

    :ivar text: as PDDL.
    :ivar reason: why it failed; empty: it succeeded.
    """

    text: str
    begun: float
    ended: float
    reason: str


class RobotLines:
    """Puts what happens into lines. Several threads may use it; :meth:`pursue` is for one.

    :param log: takes a line of what happens.
    :param on_failure: called with an action as PDDL and the reason.
    """

    def __init__(self, log: Callable[[str], None], on_failure: Callable[[str, str], None]) -> None:
        self._log = log
        self._on_failure = on_failure
        self._lock = threading.Lock()  # guards the three below
        self._running: Dict[Tuple[int, int], Tuple[str, float]] = {}  # the oldest first
        self._answers: Dict[Tuple[int, int], Tuple[Optional[str], ...]] = {}  # early ones; empty: it counted
        self._deeds: Deque[Deed] = deque(maxlen=REMEMBERED)
        self._request = ""
        self._goal = ""
        self._known_requests: Dict[str, None] = {}  # the oldest first

    @property
    def deeds(self) -> List[Deed]:
        """The actions that have ended, in their order; the last ones of a long mission."""
        with self._lock:
            return list(self._deeds)

    def pursue(self, request: str, goals: Sequence[str], priority: int, reason: str) -> None:
        """The Executor works on a request. Prints one line when the request differs from the last one.

        :param request: its id; empty: on none.
        :param reason: why the last one ended, ``goals: reason``.
        """
        if request == self._request:
            return
        if self._request:
            self._log(f"goal {self._goal}: {reason.partition(': ')[2] or 'left'}")
        self._request = request
        if request:
            self._goal = goal_text(goals, priority)
            again = "goes on with" if request in self._known_requests else "goal"
            self._known_requests[request] = None
            _forget_oldest(self._known_requests)
            self._log(f"{again} {self._goal}")

    def begin(self, key: Tuple[int, int], text: str, at: float) -> None:
        """An action is dispatched.

        :param key: plan id and action id.
        :param at: s of ROS time.
        """
        with self._lock:
            early = self._answers.pop(key, ())
            self._running[key] = (text, at)
            _forget_oldest(self._running)  # one that was never answered
        self._log(text)
        if early:
            self.end(key, at, *early)

    def end(self, key: Tuple[int, int], at: float, failure: Optional[str]) -> None:
        """An action has ended; one that has ended before is left out.

        Its dispatch may come later: messages of two topics are read in any order.

        :param failure: why it failed; None: it succeeded.
        """
        reason = "" if failure is None else failure or "failed"
        with self._lock:
            text, begun = self._running.pop(key, ("", 0.0))
            if text:
                self._deeds.append(Deed(text, begun, at, reason))
            self._answers.setdefault(key, () if text else (failure,))
            _forget_oldest(self._answers)
        if text and failure is not None:
            self._log(f"{text}: {reason}")
            if reason != CANCELLED:
                self._on_failure(text, reason)

    def speak(self, text: str, robot: str = "") -> None:
        """A robot says something.

        :param robot: its name; empty: the only robot. The two methods below have the same parameter.
        """
        self._log(_by(robot, f'says "{text}"'))

    def hear(self, text: str, heard: bool, robot: str = "") -> None:
        """A robot has listened.

        :param text: what it understood; empty: nothing.
        :param heard: whether there was anything to hear.
        """
        if text:
            self._log(_by(robot, f'understands "{text}"'))
        elif heard:
            self._log(_by(robot, "hears something it does not understand"))

    def see(self, seen: Sequence[Tuple[str, float, float]], robot: str = "") -> None:
        """A robot has looked.

        :param seen: name, x, y of what it recognised.
        """
        things = [f"{name} ({x:.1f}, {y:.1f})" for name, x, y in seen]
        self._log(_by(robot, f"sees {', '.join(things) or 'nothing'}"))


class Screen:
    """Prints lines with the time since the first one, one line at a time.

    :param clock: s.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()  # guards the begin, and keeps lines apart
        self._begin: Optional[float] = None

    def line(self, speaker: str, text: str) -> None:
        """Prints a line."""
        with self._lock:
            now = self._clock()
            self._begin = now if self._begin is None else self._begin
            print(f"{now - self._begin:7.1f} s  {speaker:<7} {text}", flush=True)


def _forget_oldest(remembered: Dict[Any, Any]) -> None:
    if len(remembered) > REMEMBERED:
        del remembered[next(iter(remembered))]


def _by(robot: str, text: str) -> str:
    return f"{robot} {text}" if robot else text


def goal_text(goals: Sequence[str], priority: int) -> str:
    """Goals in a few words."""
    more = f" and {len(goals) - 1} more" if len(goals) > 1 else ""
    return f"{goals[0] if goals else ''}{more}{', urgent' if priority else ''}"
