# SPDX-License-Identifier: Apache-2.0
"""The preempt handler: a shutdown of ROS preempts a container before it ends the process."""

import time
from typing import Any

import rospy

AGAIN = 1.0  # s until a container that still runs is asked again


def set_preempt_handler(sc: Any, timeout: float = 10.0) -> None:
    """Has a container preempted when ROS shuts down.

    Publishers and services still work while the container ends. If the thread that receives the signal is the
    one that executes the container, the request is made and the container ends afterwards.

    :param sc: any container.
    :param timeout: s of wall time after which the shutdown continues although the container still runs.
    """

    def preempt() -> None:
        end = time.monotonic() + timeout
        while sc.is_running():
            sc.request_preempt()
            left = end - time.monotonic()
            if left <= 0.0:
                rospy.logerr(
                    f"Container '{sc._path()}' still runs {timeout} s after it was preempted for "
                    f"the shutdown; active: {sc.get_active_states()}"
                )
                return
            if sc.runs_in_this_thread():
                return
            sc.wait_until_idle(min(AGAIN, left))

    rospy.on_shutdown(preempt)
