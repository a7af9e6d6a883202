# SPDX-License-Identifier: Apache-2.0
"""Node: ROSPlan's simulated action, which waits and succeeds with a given probability."""

import math
import random
import threading

import rospy

from merlin_actions.action_interface import ActionInterface
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_planning.knowledge_client import (
    DEFAULT_KNOWLEDGE_BASE,
    KnowledgeBaseMissing,
    KnowledgeError,
    wait_for_knowledge_base,
)
from merlin_ros.node import run_node
from merlin_ros.parameters import ParameterError, graph_name, number, whole
from merlin_ros.ros_alarm import RosAlarm

KNOWLEDGE_BASE_WAIT = 20.0  # s, as ROSPlan's action interface


class SimulatedAction(ActionInterface):
    """Serves the operator ``~pddl_action_name``.

    Parameters of the node: ``~action_duration`` (s of ROS time; negative: the plan's), its
    ``~action_duration_stddev``, ``~action_probability`` of success, ``~seed`` (none: different each time).

    :raises ParameterError: when one cannot be used.
    """

    concurrent = True

    def __init__(self, knowledge_base: str) -> None:
        operator = str(rospy.get_param("~pddl_action_name", ""))
        if not operator:
            raise ParameterError(
                "the parameter ~pddl_action_name is not set; it names an operator of the domain"
            )
        self._duration = number("~action_duration", -1.0, -math.inf)
        self._deviation = number("~action_duration_stddev", 0.0, 0.0)
        self._probability = number("~action_probability", 1.0, 0.0)
        self._random = random.Random(whole("~seed", 0) if rospy.has_param("~seed") else None)
        wait_for_knowledge_base(knowledge_base, KNOWLEDGE_BASE_WAIT)
        super().__init__(
            operator,
            knowledge_base,
            _topic("action_dispatch_topic", "default_dispatch_topic"),
            _topic("action_feedback_topic", "default_feedback_topic"),
        )

    def run(self, execution: Execution) -> Ending:
        """Waits in ROS time; a cancel ends it at once."""
        duration = self._duration if self._duration >= 0 else execution.dispatch.duration
        if self._deviation > 0:
            duration = max(0.0, self._random.gauss(duration, self._deviation))
        over = threading.Event()
        alarm = RosAlarm(over.set, f"simulated {execution.text}")
        execution.interruptible(over.set)
        if duration > 0:
            alarm.set_after(duration)
            over.wait()
        alarm.shutdown()
        if execution.cancelled.is_set():
            return Ending(False, "cancelled")
        if self._random.random() >= self._probability:
            return Ending(False, f"simulated failure (it succeeds with probability {self._probability:g})")
        return Ending(True)


def _topic(parameter: str, default: str) -> str:
    """As in ROSPlan: a relative name is one of the node's own."""
    name = str(rospy.get_param(f"~{parameter}", default))
    return rospy.resolve_name(name if name.startswith("/") else f"~{name.lstrip('~')}")


def main() -> int:
    """Runs the node; returns the exit code."""
    missing = (KnowledgeBaseMissing, rospy.ServiceException)
    return run_node("simulated_action", _start, KnowledgeError, ValueError, missing=missing)


def _start() -> None:
    # Without its leading slash, as in ROSPlan; without the parameter that of the own namespace.
    name = graph_name("~knowledge_base")
    action = SimulatedAction(f"/{name.lstrip('/')}" if name else DEFAULT_KNOWLEDGE_BASE)
    action.start()
    rospy.on_shutdown(action.shutdown)
