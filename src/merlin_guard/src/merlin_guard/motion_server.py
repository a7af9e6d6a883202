# SPDX-License-Identifier: Apache-2.0
"""What the guard knows about one motion server: its goals, their cancels and leases, its silence."""

import math
from collections import OrderedDict
from typing import Dict, Iterable, List, NamedTuple, Optional

from merlin_guard.attention_clock import AttentionClock
from merlin_guard.lease_book import BaseOwnership, GuardLeases, LeaseClaim
from merlin_guard.settings import GuardSettings

# Values of actionlib_msgs/GoalStatus; the core needs no ROS.
PENDING, ACTIVE, PREEMPTING, RECALLING = 0, 1, 6, 7
LIVE = frozenset((PENDING, ACTIVE, PREEMPTING, RECALLING))
MOVING = frozenset((ACTIVE, PREEMPTING))  # states in which a server commands the base
CANCELLED = frozenset((PREEMPTING, RECALLING))
KEEP_UNSEEN = 5.0  # s for which a goal may be missing from the status list after it was sent
KEEP_CANCEL = 60.0  # s for which a cancel waits for the goal that it overtook
UNSEEN = 1000  # goals that no status list has named; then the oldest is forgotten until one does
EARLY_CANCELS = 1000  # that wait at most; then the oldest is forgotten
LEFT = 1000  # goals that have left the status list and are remembered, at most; then the oldest is forgotten


class GoalReport(NamedTuple):
    """One entry of a status list."""

    id: str
    status: int
    stamp: int = 0
    """When the goal was sent, ns of ROS time; 0: not known."""
    earlier: bool = False
    """Whether it was sent before the guard began."""


class MotionGoal:
    """A goal of a motion server that has not ended.

    :ivar sent: when, in the order of the guard's clock; infinite: not known.
    :ivar status: of the last status list; None before the first one that names it.
    :ivar cancelled_at: wall clock of the first sign of a cancel, s.
    :ivar refused: why its motion is refused for good; empty while it is not.
    :ivar asked_at: wall clock of the guard's last cancel, s.
    :ivar earlier: whether it ran before the guard began.
    :ivar owned: whether a lease ever named it.
    """

    def __init__(self, goal_id: str, sent: float, now: float, earlier: bool = False) -> None:
        self.id = goal_id
        self.sent = sent
        self.seen_at = now
        self.earlier = earlier
        self.owned = False
        self.status: Optional[int] = None
        self.cancelled_at: Optional[float] = None
        self.refused = ""
        self.asked_at: Optional[float] = None
        self._brake = ""
        self._braked_at = 0.0

    @property
    def active(self) -> bool:
        """Whether the server works on it."""
        return self.status in MOVING

    def mark_cancelled(self, now: float) -> None:
        """Notes that it was cancelled; the first time counts."""
        if self.cancelled_at is None:
            self.cancelled_at = now

    def brake(self, reason: str, now: float) -> None:
        """Holds the base: for the time of a brake, and when it is cancelled by then, until it ends."""
        self._brake, self._braked_at = reason, now

    def why_braked(self, now: float, limit: float) -> str:
        """Why a brake holds the base; empty when none does.

        :param limit: s for which a brake holds a goal that is not cancelled.
        """
        return self._brake if self.cancelled_at is not None or now - self._braked_at <= limit else ""

    def refuse(self, reason: str) -> None:
        """Refuses its motion for good; the first reason counts."""
        self.refused = self.refused or reason


class MotionServer:
    """One motion server, as the guard sees it.

    :param name: resolved name of its action.
    :param settings: of the guard.
    :param clock: the guard's.
    """

    def __init__(self, name: str, settings: GuardSettings, clock: AttentionClock) -> None:
        self.name = name
        self.leases = GuardLeases(settings)
        self.goals: Dict[str, MotionGoal] = {}
        self._settings = settings
        self._clock = clock
        self._heard_wall: Optional[float] = None
        self._heard_world = 0.0
        self._early_cancels: OrderedDict[str, float] = OrderedDict()
        self._left: OrderedDict[str, MotionGoal] = OrderedDict()  # the list, and may be back
        self._cancelled_before = -math.inf  # goals sent until then were cancelled; in the order of the clock

    def report(self, reports: Iterable[GoalReport]) -> None:
        """Takes a status list: goals that it does not name, or names as ended, have ended."""
        now = self._clock.wall
        self._heard_wall, self._heard_world = now, self._clock.world
        listed = set()
        for report in reports:
            listed.add(report.id)
            if report.status not in LIVE:
                self._remove(report.id, ended=True)
                continue
            goal = self.goals.get(report.id) or self._add(report.id, report.stamp, report.earlier)
            goal.status = report.status
            if report.status in CANCELLED:
                goal.mark_cancelled(now)
        for goal in list(self.goals.values()):
            unseen = goal.status is None and now - goal.seen_at <= KEEP_UNSEEN
            if goal.id not in listed and not unseen:
                self._remove(goal.id)

    def goal_sent(self, goal_id: str, stamp: int) -> None:
        """A client has sent a goal, at `stamp` (ns of ROS time)."""
        if goal_id and goal_id not in self.goals:
            self._add(goal_id, stamp, earlier=False)
            _forget_unseen(self.goals)

    def cancel(self, goal_id: str, stamp: int) -> None:
        """A client has sent a cancel, with actionlib's rules.

        :param goal_id: of one goal; empty: see `stamp`.
        :param stamp: goals sent until then, ns of ROS time; 0 and no id: all goals.
        """
        now = self._clock.wall
        before = self._clock.order.sent(stamp) if stamp else -math.inf
        for goal in self.goals.values():
            if goal.id == goal_id or (not goal_id and not stamp) or goal.sent <= before:
                goal.mark_cancelled(now)
        if goal_id and goal_id not in self.goals:
            self._early_cancels[goal_id] = now
            self._early_cancels.move_to_end(goal_id)
            if len(self._early_cancels) > EARLY_CANCELS:
                self._early_cancels.popitem(last=False)
        self._cancelled_before = max(self._cancelled_before, before)

    def refuse_all(self, reason: str) -> None:
        """Refuses the motion of all goals there are, for good; also of those that may be back."""
        for goal in (*self.goals.values(), *self._left.values()):
            goal.refuse(reason)

    @property
    def gone(self) -> bool:
        """Whether it has been silent for so long that it counts as dead; it may come back with its goals."""
        return self._silence() > self._settings.forget_after

    def claim(self, goal: MotionGoal) -> LeaseClaim:
        """What the leases say about a goal; one that had an owner which is forgotten by now is lost."""
        claim = self.leases.claim(goal.id, self._clock.wall)
        if claim.ownership is not BaseOwnership.FOREIGN:
            goal.owned = True
        elif goal.owned:
            return LeaseClaim(BaseOwnership.LOST, "its owner is gone")
        return claim

    def why_not_heard(self) -> str:
        """Why what the server last said does not count now; empty when it does."""
        if self._silence() > self._settings.status_silence:
            return f"its status has been silent for {self._settings.status_silence:g} s"
        if self._heard_wall is None or self._heard_wall < self._clock.back_at:
            return "the guard was held up and has not heard its status since"
        return ""

    def active_goals(self) -> List[MotionGoal]:
        """The goals that it works on."""
        return [] if self.gone else [goal for goal in self.goals.values() if goal.active]

    def _silence(self) -> float:
        return self._clock.world - self._heard_world

    def _add(self, goal_id: str, stamp: int, earlier: bool) -> MotionGoal:
        order = self._clock.order
        sent = order.sent(stamp) if stamp else math.inf
        goal = self._left.pop(goal_id, None) or MotionGoal(goal_id, sent, self._clock.wall, earlier)
        self.goals[goal_id] = goal
        late = stamp and order.place(stamp) <= self._cancelled_before
        if late or self._clock.wall - self._early_cancels.pop(goal_id, -math.inf) <= KEEP_CANCEL:
            goal.mark_cancelled(self._clock.wall)
        return goal

    def _remove(self, goal_id: str, ended: bool = False) -> None:
        """Takes a goal out, but does not forget when it was cancelled, nor that its motion was refused.

        Where two servers share a name, the list of one does not have the goals of the other: a goal that
        has left the list may be back with the next one.
        """
        goal = self.goals.pop(goal_id, None)
        if goal is not None and (goal.refused or not ended):
            goal.status = None
            self._left[goal_id] = goal
            if len(self._left) > LEFT:
                self._left.popitem(last=False)


def _forget_unseen(goals: Dict[str, MotionGoal]) -> None:
    """Removes the oldest goals that no status list has named, where they are too many."""
    unseen = [goal_id for goal_id, goal in goals.items() if goal.status is None]
    for goal_id in unseen[:-UNSEEN]:
        del goals[goal_id]
