# SPDX-License-Identifier: Apache-2.0
"""A state that waits."""

import threading
from typing import Any

from merlin_ros.deadline import Deadline
from merlin_ros.ros_alarm import call_after
from merlin_sm.states.merlin_state import PREEMPTED, SUCCEEDED, MerlinState
from merlin_sm.states.ros_calls import check_times


class WaitState(MerlinState):
    """Waits, and is preempted at once.

    :param seconds: s of ROS time.
    :raises ValueError: for a time that is not a number, 0 or more.
    """

    def __init__(self, seconds: float) -> None:
        super().__init__()
        check_times(seconds=seconds)
        self._seconds = seconds

    def run(self, userdata: Any) -> str:
        """Waits the given ROS time, unless it is preempted."""
        over = threading.Event()
        alarm = call_after(self._seconds, over.set, f"wait of {self._seconds:g} s")
        self.interruptible(over.set)
        Deadline(None).wait_event(over)
        self.interruptible(None)
        alarm.shutdown()
        if self.preempt_requested():
            return PREEMPTED
        return SUCCEEDED if over.is_set() else self.fail("the node ended before its wait")
