# SPDX-License-Identifier: Apache-2.0
"""Conditions that do not hold yet, and may come true by themselves: the action that needs them waits."""

from typing import Any, Collection, Dict, Iterator, List, Set

from merlin_rosplan.dispatch.dispatch_environment import DispatchEnvironment
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
from merlin_rosplan.dispatch.dispatch_running import Running
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction
from merlin_rosplan.dispatch.operator_model import Conditions


class ComingConditions:
    """The actions of one dispatch whose conditions a timed change or start effects may make true.

    :param settle: s within which start effects and timed changes are applied.
    """

    def __init__(self, environment: DispatchEnvironment, schedule: GraphSchedule, settle: float) -> None:
        self._environment = environment
        self._schedule = schedule
        self._settle = settle
        self._actions: Set[int] = set()  # that wait for effects, or for a timed change whose time has come
        self._timed: Dict[int, Any] = {}  # deadlines of the timed changes whose time has come
        self._due: Dict[int, float] = {}  # ROS time, s, at which a timed change comes

    @property
    def expected(self) -> bool:
        """Whether an action waits for effects, or for a timed change whose time has come."""
        return bool(self._actions)

    def may_come(
        self, action: PlannedAction, unmet: Conditions, began: float, running: Collection[Running]
    ) -> bool:
        """Whether the conditions that an action lacks may still come true.

        :param began: ROS time, s, of the begin of the dispatch.
        :param running: the actions whose effects may make them true.
        """
        due = self._environment.next_change(unmet.names, began + action.time + self._settle)
        if due is not None:
            self._due[action.id] = due
            return True
        timed = self._due.pop(action.id, None) is not None or self._schedule.waits_for_time(action.id)
        if timed and action.id not in self._timed:
            self._timed[action.id] = self._environment.deadline(self._settle)
        # ROSPlan's graph has a plain action's effects at its start; an interface may apply them at its end.
        if self._deadlines(action.id, running) or any(record.brings(unmet) for record in running):
            self._actions.add(action.id)
            return True
        self._actions.discard(action.id)
        return False

    def came(self, action_id: int) -> None:
        """The conditions of an action hold; it starts."""
        self._actions.discard(action_id)
        self._due.pop(action_id, None)

    def changes_after(self, now: float) -> List[float]:
        """ROS times, s, of the timed changes that come after `now`."""
        return [time for time in self._due.values() if time > now]

    def time_left(self, running: Collection[Running]) -> Iterator[float]:
        """Seconds until what an action waits for should have come."""
        for action_id in self._actions:
            yield from self._deadlines(action_id, running)

    def _deadlines(self, action_id: int, running: Collection[Running]) -> List[float]:
        deadlines = [record.settle for record in running]
        if action_id in self._timed:
            deadlines.append(self._timed[action_id])
        return [left for left in (deadline.remaining() for deadline in deadlines) if left > 0]
