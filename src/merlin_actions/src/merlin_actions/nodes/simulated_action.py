"""ROSPlan's simulated action: an action interface that waits and succeeds with a given probability."""

import random
import threading
from typing import Optional

import rospy

from merlin_actions.action_interface import ActionInterface
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_ros.ros_alarm import RosAlarm
from merlin_ros.service_proxy import ServiceError
from merlin_rosplan.transport.component import Component, ComponentError, run_component
from merlin_sm.knowledge_client import KnowledgeError, knowledge_client

SCOPE = "simulated_action"
KNOWLEDGE_BASE_WAIT = 20.0  # s, as ROSPlan's action interface


class _SimulatedExecution(ActionInterface):
    """Runs dispatched actions as waiting; see :class:`SimulatedAction` for its parameters."""

    concurrent = True

    def behave(self, duration: float, deviation: float, probability: float, seed: Optional[int]) -> None:
        """Sets what :meth:`run` does."""
        self._duration, self._deviation, self._probability = duration, deviation, probability
        self._random = random.Random(seed)

    def run(self, execution: Execution) -> Ending:
        """Waits in ROS time; a cancel ends it at once."""
        duration = self._duration if self._duration >= 0 else execution.dispatch.duration
        duration = (
            max(0.0, self._random.gauss(duration, self._deviation)) if self._deviation > 0 else duration
        )
        over = threading.Event()
        alarm = RosAlarm(over.set, f"simulated {execution.text}")
        execution.interruptible(over.set)
        if duration > 0:
            alarm.set(rospy.get_time() + duration)
            over.wait()
        alarm.shutdown()
        if execution.cancelled.is_set():
            return Ending(False, "cancelled")
        if self._random.random() >= self._probability:
            return Ending(False, f"simulated failure (it succeeds with probability {self._probability:g})")
        return Ending(True)


class SimulatedAction(Component):
    """Serves the operator ``~pddl_action_name``.

    Parameters on the server: ``~action_duration`` (s of ROS time; negative: the plan's), its
    ``~action_duration_stddev``, ``~action_probability`` of success, ``~seed`` (none: different each time).
    """

    def __init__(self, scope: str = SCOPE) -> None:
        super().__init__(scope)
        self._interface: Optional[_SimulatedExecution] = None
        operator = str(self.param("pddl_action_name"))
        duration = self.number("action_duration", -1.0)
        deviation = self.number("action_duration_stddev", 0.0, 0.0)
        probability = self.number("action_probability", 1.0, 0.0)
        if not knowledge_client(self.knowledge_base).wait(KNOWLEDGE_BASE_WAIT):
            raise ComponentError(f"no knowledge base {self.knowledge_base} after {KNOWLEDGE_BASE_WAIT:g} s")
        try:
            self._interface = _SimulatedExecution(
                operator,
                self.knowledge_base,
                self.resolve(str(self.param("action_dispatch_topic", "default_dispatch_topic"))),
                self.resolve(str(self.param("action_feedback_topic", "default_feedback_topic"))),
            )
        except (KnowledgeError, ServiceError, ValueError) as error:
            raise ComponentError(str(error)) from error
        self._interface.behave(duration, deviation, probability, self.param("seed", None))
        self._interface.start()

    def on_shutdown(self) -> None:
        """Cancels what runs."""
        if self._interface is not None:
            self._interface.shutdown()


def main() -> None:
    """Entry point of ``rosrun merlin_rosplan simulated_action``."""
    run_component(SimulatedAction, SCOPE)
