# SPDX-License-Identifier: Apache-2.0
"""The events of a trial, looked up by kind, and what can be measured in them."""

from typing import Dict, List, Optional, Sequence, Set, Tuple

from chaos.judging import events
from chaos.judging.events import Event
from chaos.judging.scene import commands_motion, scene_at, stands
from chaos.trials import Trial

#: s that the base has to stand to count as standing.
STANDING_FOR = 0.2
#: Share of a sample from when the machine counts as starving the system.
STARVED = 0.5
#: How many times a limit a starved machine may make of it: what never ends is seen on any machine.
PATIENCE = 2.0
#: Labels of the request that the fault strikes, and of the one after it.
REQUEST, NEXT = "request", "next"
#: Labels of those that join the first one, in a trial with several.
JOINED = ("second", "third")


class Evidence:
    """The events of a trial, looked up by kind.

    :param trial: what was done.
    :param log: its events in the order of time.
    :param points: x, y of the points of interest.
    :param notes: facts that the knowledge base has acknowledged.
    :param patience: how many times a limit a starved machine may make of it.
    """

    def __init__(
        self,
        trial: Trial,
        log: Sequence[Event],
        points: Dict[str, Tuple[float, float]],
        notes: Sequence[str],
        patience: float = PATIENCE,
    ) -> None:
        self._patience = patience
        self.trial = trial
        self.log = list(log)
        self.points = points
        self.notes = list(notes)
        fault = self.first(events.FAULT)
        self.zero = fault.at if fault is not None else (self.log[0].at if self.log else 0.0)

    def first(self, kind: str, label: str = "", after: float = float("-inf")) -> Optional[Event]:
        """The first event of a kind, of a request when a label is given."""
        for event in self.log:
            if event.kind == kind and event.at >= after and (not label or event.get("label") == label):
                return event
        return None

    def all(self, kind: str, begin: float, end: float) -> List[Event]:
        """The events of a kind within a time."""
        return [event for event in self.log if event.kind == kind and begin <= event.at <= end]

    def deadline(self, begin: float, limit: float) -> float:
        """When a limit ends that begins at a time; seconds without a processor do not count.

        :param limit: s.
        """
        end = begin + limit
        for event in self.log:
            if event.kind != events.WAITED or event.at <= begin:
                continue
            since, share = event.at - event["span"], event["waited"] / event["span"]
            if since >= end:
                break
            if share >= STARVED:
                end += share * (min(event.at, end) - max(since, begin))
        return min(end, begin + self._patience * limit)

    def of_robot(self, robot: str) -> "Evidence":
        """The same, as it is for a robot of several: what is seen of the first one has no name in front."""
        if robot in ("", *self.trial.variant.robots[:1]):
            return self
        mine = {event.kind for event in self.log if event.kind.startswith(f"{robot}/")}
        theirs = {kind.partition("/")[2] for kind in mine}
        log = [
            Event(event.at, event.kind.partition("/")[2], event.data) if event.kind in mine else event
            for event in self.log
            if event.kind not in theirs
        ]
        return Evidence(self.trial, log, self.points, self.notes, self._patience)

    def looks_before_next(self) -> List[Event]:
        """The looks at the knowledge between the trial's end and the next goal; the last of them counts."""
        ready, sent = self.first(events.NEXT), self.first(events.SENT, NEXT)
        if ready is None:
            return []
        return self.all(events.FACTS, ready.at, sent.at if sent is not None else self.end)

    def when(self, at: float) -> str:
        """A time as text."""
        return f"{at - self.zero:.2f} s"

    @property
    def end(self) -> float:
        """When the judged time ends."""
        closed = self.first(events.CLOSED)
        return closed.at if closed is not None else (self.log[-1].at if self.log else self.zero)


def settled(facts: Event, robots: Sequence[str] = ()) -> bool:
    """Whether a look found the knowledge as it is between two requests: one place of each robot, no goal."""
    if "error" in facts.data or facts["goals"]:
        return False
    return all(len(places_of(facts, robot)) == 1 for robot in robots or ("",))


def used_by_others(evidence: Evidence, ended: Event) -> Set[str]:
    """The servers of requests that go on when one has ended: the first one drives, what joins it speaks."""
    found: Set[str] = set()
    for label in (REQUEST, *JOINED):
        sent, end = evidence.first(events.SENT, label), evidence.first(events.ENDED, label)
        if label != ended["label"] and sent is not None and sent.at < ended.at:
            goes_on = evidence.trial.joined and (end is None or end.at > ended.at)
            found |= {"move_base" if label == REQUEST else "sound_play"} if goes_on else set()
    return found


def places_of(facts: Event, robot: str = "") -> List[str]:
    """Where a look says that a robot is; the place is the last word of a fact.

    :param robot: its name; empty: the only one, which has none.
    """
    words = [fact.strip("()").split() for fact in facts["robot_at"]]
    return [each[-1] for each in words if not robot or robot in each[1:-1]]


def action_began(evidence: Evidence) -> Optional[Event]:
    """When an action of the next request began: a server has a goal that it did not have before."""
    sent = evidence.first(events.SENT, NEXT)
    if sent is None:
        return None
    known = {goal for goals in scene_at(evidence.log, sent.at).active.values() for goal in goals}
    for event in evidence.log:
        if event.at >= sent.at and event.kind == events.GOALS:
            fresh = {*event["active"], *event.get("ended", {})} - known
            before = _ended_before(evidence, event["server"], sent.at)
            if fresh - before:
                return event
    return None


def _ended_before(evidence: Evidence, server: str, at: float) -> Set[str]:
    known: Set[str] = set()
    for event in evidence.log:
        if event.at < at and event.kind == events.GOALS and event["server"] == server:
            known |= {*event["active"], *event.get("ended", {})}
    return known


def stood_at(evidence: Evidence, begin: float) -> Optional[float]:
    """Begin of the first time of standing that lasts, or that a new drive ends; None when there is none.

    A base that a wall has stopped does not stand: its last command has to be zero, unless it stops by itself
    without commands.
    """
    since: Optional[float] = None
    obeys = evidence.trial.variant.base_timeout is None
    command = scene_at(evidence.log, begin).command
    driven = obeys and command is not None and commands_motion(command)
    known = scene_at(evidence.log, begin).active.get("move_base", frozenset())
    for event in evidence.log:
        if not begin <= event.at <= evidence.end:
            continue
        new = event.kind == events.GOALS and event["server"] == "move_base" and set(event["active"]) - known
        if new and since is not None:
            return since
        if event.kind == events.COMMAND:
            driven = obeys and commands_motion(event)
        if event.kind not in (events.TRUTH, events.COMMAND):
            continue
        if driven or (event.kind == events.TRUTH and not stands(event)):
            since = None
        elif event.kind == events.COMMAND:
            continue
        elif since is None:
            since = event.at
        elif event.at - since >= STANDING_FOR:
            return since
    return None


def world_time(evidence: Evidence, at: float) -> float:
    """Simulated time at a time: on a busy machine the simulated world, its brakes included, is slow."""
    truth = scene_at(evidence.log, at).truth
    return at if truth is None else float(truth.get("ros", truth.at))


def way(evidence: Evidence, begin: float, end: float) -> float:
    """m driven within a time."""
    places = [(event["x"], event["y"]) for event in evidence.all(events.TRUTH, begin, end)]
    return sum(
        ((after[0] - before[0]) ** 2 + (after[1] - before[1]) ** 2) ** 0.5
        for before, after in zip(places, places[1:])
    )
