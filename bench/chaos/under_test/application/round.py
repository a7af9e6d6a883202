# SPDX-License-Identifier: Apache-2.0
"""A mission that never ends, so that a fault finds the robot driving."""

from typing import List

import rospy

from merlin_executor.mission import SKIP, GoalDispatcher, MissionFailed
from merlin_planning.knowledge_client import KnowledgeError

#: s between a goal that failed and the next one: what failed may be on its way back.
REST = 0.5


class Round(GoalDispatcher):
    """Drives from one leg to the next.

    :param legs: goals of each.
    """

    def __init__(self, legs: List[List[str]]) -> None:
        super().__init__("Round", on_cancel=SKIP)
        self._legs = legs

    def run(self) -> None:
        """Sends the goals of each leg in turn, whatever becomes of them."""
        number = 0
        while not self.cancelled:
            try:
                self.achieve(self._legs[number % len(self._legs)])
            except (MissionFailed, KnowledgeError, rospy.ServiceException):
                rospy.sleep(REST)
            number += 1
