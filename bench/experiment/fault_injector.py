# SPDX-License-Identifier: Apache-2.0
"""A node that kills a node of the robot in the middle of a mission, as a crash would.

Waits until a task of the mission runs, and a little longer; then sends SIGKILL to the process of a node. What
happens next is up to the robot: the launch file may start the node again.
"""

import os
import signal
import threading
import time
from typing import Any, List

import rospy
from merlin_msgs.msg import MissionStatus

from merlin.local_names import use_loopback
from merlin_ros.master.master_link import ERRORS, bounded_master, bounded_proxy
from merlin_ros.node import run_node


class FaultInjector:
    """Kills one node once."""

    def __init__(self, node: str, task: int, delay: float) -> None:
        """:param node: its name, relative names allowed.
        :param task: number of the mission's task in which it is killed.
        :param delay: s of ROS time after the beginning of that task.
        """
        self._node = rospy.resolve_name(node)
        self._task = task
        self._delay = delay
        self.killed = False
        self._once = threading.Lock()  # taken for good by the first status that names the task
        self._subscriber = rospy.Subscriber("merlin/mission", MissionStatus, self._receive)

    def _receive(self, status: MissionStatus) -> None:
        running = status.state == MissionStatus.RUNNING and status.task == self._task
        if running and self._once.acquire(blocking=False):
            rospy.Timer(rospy.Duration(self._delay), self._kill, oneshot=True)

    def _kill(self, _event: rospy.timer.TimerEvent) -> None:
        try:
            address = bounded_master().lookupNode(self._node)
            answer: Any = bounded_proxy(address, 1.0).getPid(rospy.get_name())
            process = int(answer[2])
        except ERRORS as error:
            rospy.logerr(f"cannot kill {self._node}: {error}")
            return
        rospy.loginfo(f"killing {self._node}, process {process}")
        os.kill(process, signal.SIGKILL)
        self.killed = True


def main(task: int, node: str = "navigation", delay: float = 5.0) -> int:
    """Runs the node until it is ended; returns 0 when it has killed the other one.

    The clock is the launch file's, so its parameters come first.
    """
    use_loopback()  # as the run has done for itself
    while not bounded_master().hasParam("/use_sim_time"):
        time.sleep(0.1)

    injectors: List[FaultInjector] = []

    def start() -> None:
        injectors.append(FaultInjector(node, task, delay))

    code = run_node("fault_injector", start)
    return 0 if injectors and injectors[0].killed else code or 1
