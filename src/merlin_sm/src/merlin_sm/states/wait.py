"""A state that waits."""

import threading
from typing import Any

import rospy

from merlin_ros.deadline import Deadline
from merlin_sm.states.merlin_state import PREEMPTED, SUCCEEDED, MerlinState


class WaitState(MerlinState):
    """Waits, and is preempted at once.

    :param seconds: s of ROS time.
    :raises ValueError: for a negative time.
    """

    def __init__(self, seconds: float) -> None:
        super().__init__()
        if not seconds >= 0.0:
            raise ValueError(f"a wait takes 0 s or more, not {seconds}")
        self._seconds = seconds

    def run(self, userdata: Any) -> str:
        """Waits."""
        over = threading.Event()
        timer = rospy.Timer(rospy.Duration(max(self._seconds, 1e-4)), lambda _: over.set(), oneshot=True)
        self.interruptible(over.set)
        Deadline(None).wait_event(over)
        self.interruptible(None)
        timer.shutdown()
        return PREEMPTED if self.preempt_requested() else SUCCEEDED
