# SPDX-License-Identifier: Apache-2.0
"""A state that waits."""

import threading
from typing import Any

from merlin_ros.deadline import Deadline
from merlin_ros.ros_alarm import call_after
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
        """Waits the given ROS time, unless it is preempted."""
        over = threading.Event()
        alarm = call_after(self._seconds, over.set, f"wait of {self._seconds:g} s")
        self.interruptible(over.set)
        Deadline(None).wait_event(over)
        self.interruptible(None)
        alarm.shutdown()
        return PREEMPTED if self.preempt_requested() else SUCCEEDED
