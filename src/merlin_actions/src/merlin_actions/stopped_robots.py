# SPDX-License-Identifier: Apache-2.0
"""Robots that were stopped on a drive: at which point of interest they stand, and keep others from standing.

A robot that was stopped is between two points, as its action declares with ``if_interrupted``, and may stand
so near to one that no other robot can come there. The planner has to know, to move it away.
"""

import threading
from typing import Callable, Dict, Sequence

import rospy

from merlin_actions.core.ending import Closing
from merlin_actions.effects import Effects, Opening
from merlin_planning.knowledge_client import ADD, REMOVE, KnowledgeClient, Update
from merlin_planning.knowledge_text import parse_literals


class StoppedRobots:
    """Keeps the knowledge of robots that were stopped at points of interest true. Thread-safe.

    A place may be held by another robot when one stops there, and be free later: then it counts from then on.

    :param knowledge: of the planning system.
    :param points_at: the points of interest at which a robot stands, the nearest first.
    """

    def __init__(self, knowledge: KnowledgeClient, points_at: Callable[[str], Sequence[str]]) -> None:
        self._knowledge = knowledge
        self._points_at = points_at
        self._lock = threading.Lock()  # guards the field below, and keeps a query and its update together
        self._between: Dict[str, Opening] = {}  # robot → the drive that was stopped

    def set_off(self, robot: str) -> None:
        """A robot begins a drive."""
        with self._lock:
            self._between.pop(robot, None)
            self._settle()

    def stopped(self, drive: Opening) -> None:
        """A drive of a robot was stopped."""
        with self._lock:
            self._between[drive.robot] = drive
            self._settle()

    def settle(self) -> None:
        """Places have become free."""
        with self._lock:
            self._settle()

    def _settle(self) -> None:
        for robot, drive in list(self._between.items()):
            try:
                if self._stands(robot, drive):
                    del self._between[robot]
            except Exception as error:  # points of interest and literals are the user's
                # It is between two points for the plan, as without this; the action has its end all the same.
                rospy.logwarn(f"where robot {robot} was stopped is not known: {error}")

    def _stands(self, robot: str, drive: Opening) -> bool:
        """Notes where a robot stands; False: at no point of the problem, or another robot holds it."""
        points = self._points_at(robot)
        known = {name.lower() for name in self._knowledge.instances()} if points else set()
        for point in points:
            if point.lower() not in known:
                continue
            literals = parse_literals(drive.if_stopped_at, {**drive.binding, "here": point})
            if any(self._knowledge.query(literals)):
                continue  # a literal that holds already: the place is not this robot's
            updates = [Update(REMOVE if item.is_negative else ADD, item) for item in literals]
            for update in updates:
                update.item.is_negative = False
            self._knowledge.update(updates)
            rospy.loginfo(f"robot {robot} was stopped, and stands at {point}")
            return True
        return False


class EffectsOfDrives(Effects):
    """Effects of an action that may move a robot.

    :param effects: what they are without that.
    """

    def __init__(self, effects: Effects, robots: StoppedRobots) -> None:
        self._effects = effects
        self._robots = robots

    def open(self, opening: Opening) -> None:
        """See :meth:`Effects.open`."""
        self._effects.open(opening)
        if opening.if_stopped_at:
            self._robots.set_off(opening.robot)

    def close(self, opening: Opening, closing: Closing, on_gone: Callable[[], None]) -> None:
        """See :meth:`Effects.close`."""
        self._effects.close(opening, closing, on_gone)
        if not opening.if_stopped_at:
            return
        if closing is Closing.INTERRUPT:
            self._robots.stopped(opening)
        else:
            self._robots.settle()
