# SPDX-License-Identifier: Apache-2.0
"""When a request may run, and when its plan is expected to end. Pure; times are s of ROS time."""

import math
from typing import Dict, Iterable, NamedTuple, Optional, Tuple

from merlin_ros.work.passed_time import clock_text

SHORTEST = 0.01  # s; a plan whose actions all take less has no durations


class TimeWindow(NamedTuple):
    """From when to when a request may run."""

    not_before: float = 0.0
    """It does not begin earlier; zero: at once."""
    deadline: float = math.inf
    """Its goals have to hold by then."""

    def is_open(self, now: float) -> bool:
        """Whether it may run now."""
        return self.not_before <= now < self.deadline

    def why_refused(self, now: float) -> str:
        """Why no request can have this window, as a sentence; empty: one can."""
        by = clock_text(self.deadline) if self.is_limited else ""
        if self.deadline <= now:
            return f"its deadline {by} passed {now - self.deadline:.0f} s ago"
        if self.deadline <= self.not_before:
            return f"its deadline {by} is not after {clock_text(self.not_before)}, when it may begin"
        return ""

    @property
    def is_limited(self) -> bool:
        """Whether it has a deadline."""
        return self.deadline < math.inf

    @property
    def missed(self) -> str:
        """What is said when the deadline has passed."""
        return f"late: its goals do not hold by its deadline {clock_text(self.deadline)}"


ALWAYS = TimeWindow()


class Outlook(NamedTuple):
    """What can be expected of a request."""

    begin: Optional[float] = None
    """When it begins; None: not known, or it runs."""
    end: Optional[float] = None
    """When it ends; None: not known."""
    late: str = ""
    """Why it can no longer be on time, as a sentence; empty: it may be."""
    waits: str = ""
    """Why it neither interrupts nor joins what runs, or is not checked yet, as a sentence; empty: it may."""


def outlook_running(window: TimeWindow, end: Optional[float]) -> Outlook:
    """The outlook of a request that runs.

    :param end: when its plan is expected to end; None: not known.
    """
    if end is None or end <= window.deadline:
        return Outlook(end=end)
    by = clock_text(window.deadline)
    return Outlook(end=end, late=f"its plan is expected to end at {clock_text(end)}, after its deadline {by}")


def outlook_waiting(window: TimeWindow, is_next: bool, before: str, end: Optional[float]) -> Outlook:
    """The outlook of a request that waits.

    :param is_next: whether it is the first of those that wait.
    :param before: the goals of the request that runs and that it has to wait for; empty: there is none.
    :param end: when that one is expected to end; None: not known.
    """
    if not before:
        return Outlook(window.not_before if is_next and window.not_before else None)
    if end is None:
        return Outlook()
    begin = max(end, window.not_before)
    late = ""
    if end >= window.deadline:
        by = clock_text(window.deadline)
        late = f"{before} is expected to run until {clock_text(end)}, and the deadline of this one is {by}"
    return Outlook(begin if is_next else None, late=late)


class Forecast(NamedTuple):
    """How long a request that waits will take, as the planner has said before it begins."""

    ahead: Tuple[int, ...]
    """The requests that run or wait before it, and whose ends its plan begins from."""
    seconds: float
    """From its begin until its goals hold."""
    late: str = ""
    """Why no plan is in time, as a sentence: it is proven that there is none."""
    steps: Tuple[str, ...] = ()
    """Its plan, as PDDL text."""
    alone: bool = True
    """Whether it begins before all others of its priority that wait."""
    ended: int = 0
    """How many actions of the plan that ran had ended."""

    def fits(self, ahead: Tuple[int, ...]) -> bool:
        """Whether it holds for a request that waits behind others; those that were first may have ended."""
        return self.ahead[len(self.ahead) - len(ahead) :] == ahead


def outlook_foreseen(
    window: TimeWindow, outlook: Outlook, forecast: Forecast, free: Optional[float]
) -> Outlook:
    """The outlook of a request that waits and was planned ahead.

    :param outlook: as it is without that.
    :param free: when those before it are expected to have ended; None: not known.
    """
    begin = max(free, window.not_before) if free is not None else outlook.begin
    end = begin + forecast.seconds if begin is not None and forecast.seconds >= 0.0 else None
    late = outlook.late or forecast.late
    if not late and begin is not None and end is not None and end > window.deadline:
        by = clock_text(window.deadline)
        late = (
            f"it is expected to begin at {clock_text(begin)} and takes {forecast.seconds:.0f} s, "
            f"and its deadline is {by}"
        )
    return outlook._replace(begin=begin, end=end, late=late)


class _Timed(NamedTuple):
    steps: Dict[int, Tuple[float, float]]  # start and end of each action, s since the begin of the plan
    length: float  # s; zero: not known
    origin: float
    running: Tuple[int, ...] = ()


class PlanTimes:
    """When the plan of a request is expected to end: as planned, later by what its actions are late."""

    def __init__(self) -> None:
        self._plan = _Timed({}, 0.0, 0.0)  # replaced as a whole: other threads read it

    def begin(
        self, steps: Iterable[Tuple[int, float, float]], now: float, reached: Optional[float] = None
    ) -> None:
        """A plan is carried out from now on; one without actions: there is none.

        :param steps: of each action its id, its start, s since the begin of the plan, and its duration, s.
        :param reached: s since the begin of the plan at which the goals hold; None: at its end.
        """
        listed = list(steps)
        timed = any(duration > SHORTEST for _, _, duration in listed)
        end = max((start + duration for _, start, duration in listed), default=0.0)
        length = (end if reached is None else max(reached, SHORTEST)) if timed else 0.0
        spans = {number: (start, start + duration) for number, start, duration in listed}
        self._plan = _Timed(spans, length, now)

    def dispatched(self, actions: Iterable[Tuple[int, float]]) -> None:
        """Takes the actions under way: of each its id, and when it was dispatched."""
        plan = self._plan
        origins = {number: at - plan.steps[number][0] for number, at in actions if number in plan.steps}
        origin = max(origins.values(), default=plan.origin)
        self._plan = plan._replace(origin=origin, running=tuple(origins))

    def end(self, now: float) -> Optional[float]:
        """When it is expected to end; None: there is no plan, or its actions have no durations.

        :param now: s of ROS time; what still runs ends then at the earliest, and what follows it later.
        """
        plan = self._plan
        late = max((now - plan.origin - plan.steps[number][1] for number in plan.running), default=0.0)
        return max(now, plan.origin + plan.length + max(0.0, late)) if plan.length else None
