# SPDX-License-Identifier: Apache-2.0
"""The state that waits until a condition holds."""

from typing import Any, Callable, Iterable, Optional

import rospy

import smach
from smach.state import names
from smach_ros.user_callback import UserCallback
from smach_ros.waiting import Duration, RosDeadline, wait
from smach_ros.waiting_state import WaitingState

POLL_RATE = rospy.Duration(0.05)


class ConditionState(WaitingState):
    """Asks a condition again and again until it is true.

    Outcomes: ``true``, ``false``, ``preempted``.

    :param cond_cb: ``cond_cb(ud)``.
    :param input_keys: userdata keys that it reads.
    :param poll_rate: ROS time between two questions.
    :param timeout: ROS time after which it ends with ``false``; None: no limit.
    :param max_checks: number of questions after which it ends with ``false``; -1: no limit.
    """

    def __init__(
        self,
        cond_cb: Callable[..., Any],
        input_keys: Iterable[str] = (),
        poll_rate: Duration = POLL_RATE,
        timeout: Optional[Duration] = None,
        max_checks: int = 1,
    ) -> None:
        input_keys = names(input_keys, "input_keys")
        super().__init__(["true", "false", "preempted"], input_keys)
        if not callable(cond_cb):
            raise smach.InvalidStateError(f"ConditionState: cond_cb must be callable, not {cond_cb!r}")
        self._cond_cb = UserCallback(cond_cb, (), {}, self, input_keys, [], "cond_cb")
        self._poll_rate = poll_rate
        self._timeout = timeout
        self._max_checks = max_checks

    def _execute(self, ud: Any) -> str:
        deadline = RosDeadline(self._timeout)
        checks = 0
        while True:
            if self.preempt_requested() or rospy.is_shutdown():
                self.service_preempt()
                return "preempted"
            if self._cond_cb(ud):
                return "true"
            checks += 1
            if checks == self._max_checks or deadline.remaining() <= 0.0:
                return "false"
            with self._changed:
                wait(self._changed, self.preempt_requested, RosDeadline(self._poll_rate))
