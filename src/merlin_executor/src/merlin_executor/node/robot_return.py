# SPDX-License-Identifier: Apache-2.0
"""A request that cannot be planned waits for robots whose hosts are gone: with these it may be planned."""

from typing import List, Sequence, Set

import rospy

from merlin_executor.announced import knows_available, missing_robots
from merlin_planning.knowledge_client import KnowledgeClient, KnowledgeError
from merlin_planning.planning_client import Interruptible
from merlin_ros.robot_values import AVAILABLE
from merlin_ros.service_proxy import ServiceError


class RobotReturn:
    """Waits for robots that take no actions. One that its operator has taken out is not waited for.

    A robot that did not come is waited for again only when it has been back. Used by one thread.

    :param knowledge: with the facts ``(available ?robot)``; without these no robot is waited for.
    :param robots: their names; none for one robot without a name.
    :param limit: s of running time.
    """

    def __init__(self, knowledge: KnowledgeClient, robots: Sequence[str], limit: float) -> None:
        self._knowledge, self._robots, self._limit = knowledge, robots, limit
        self._in_vain: Set[str] = set()

    def wait(self, interruptible: Interruptible, waited_for: Set[str]) -> bool:
        """Whether a robot has come back.

        :param interruptible: is given what ends the wait.
        :param waited_for: the robots for which the run has waited; these are added.
        """
        try:
            away = self._away()
            self._in_vain &= set(away)
            awaited = [robot for robot in away if robot not in self._in_vain | waited_for]
            if not awaited:
                return False
            waited_for.update(awaited)
            rospy.logwarn(f"no plan without {', '.join(awaited)}; waits {self._limit:g} s at most")
            waiting = "the request waits for one of the robots"
            missing = missing_robots(self._knowledge, awaited, self._limit, waiting, interruptible, one=True)
            self._in_vain.update(missing)
            return not set(awaited) <= set(self._away())
        except (KnowledgeError, ServiceError) as error:
            rospy.logwarn(f"no robot is waited for: {error}")
            return False

    def _away(self) -> List[str]:
        if not self._robots or not knows_available(self._knowledge):
            return []
        there = {item.values[0].value for item in self._knowledge.propositions(AVAILABLE)}
        return [robot for robot in self._robots if robot not in there]
