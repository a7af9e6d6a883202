# SPDX-License-Identifier: Apache-2.0
"""A state that waits for what is known."""

import threading
from typing import Any, Callable, Optional

import rospy
from merlin_msgs.msg import KnowledgeChanges

from merlin_planning.knowledge_client import KnowledgeError
from merlin_ros.deadline import Deadline
from merlin_ros.service_proxy import ServiceError
from merlin_sm.states.merlin_state import PREEMPTED, SUCCEEDED, MerlinState


class UntilKnown(MerlinState):
    """Waits until a condition holds: looks when it begins, at each change of the knowledge, and when woken.

    A knowledge base that does not answer is asked again with its next change.

    :param condition: over what is known.
    :param timeout: s of running time after which it aborts; None: as long as it takes.
    """

    def __init__(self, condition: Callable[[], bool], timeout: Optional[float] = None) -> None:
        super().__init__()
        self._condition = condition
        self._timeout = timeout
        self._woken = threading.Event()
        rospy.Subscriber(
            "rosplan_knowledge_base/changes", KnowledgeChanges, lambda _: self.wake(), tcp_nodelay=True
        )

    def wake(self) -> None:
        """Requests another look; from any thread, never blocks."""
        self._woken.set()

    def run(self, userdata: Any) -> str:
        """Waits until the condition holds, or the time is over."""
        deadline = Deadline(self._timeout)
        self.interruptible(self.wake)
        while True:
            self._woken.clear()
            if self.preempt_requested():
                return PREEMPTED
            if self._holds():
                return SUCCEEDED
            if not deadline.wait_event(self._woken):
                return self.fail("what it waits for is not known")

    def _holds(self) -> bool:
        try:
            return self._condition()
        except (KnowledgeError, ServiceError) as error:
            rospy.logwarn(str(error))
            return False
