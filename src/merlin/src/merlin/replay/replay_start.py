# SPDX-License-Identifier: Apache-2.0
"""Node: lets ``rosbag play``, which waits, begin once the page and rviz are connected to it."""

import contextlib
import time
from typing import Any, Set

import rospy
from std_srvs.srv import SetBool

from merlin_ros.master.master_link import ERRORS, MASTER_TIMEOUT, bounded_master, bounded_proxy
from merlin_ros.node import run_node, spin
from merlin_ros.parameters import ParameterError
from merlin_ros.service_proxy import ServiceError, ServiceProxy

PERIOD = 0.1  # s of wall time between two looks; neither master nor player reports connections
LIMIT = 30.0  # s of wall time


def main() -> int:
    """Runs the node; returns the exit code."""
    return run_node("replay_start", _start, ServiceError)


def _start() -> Any:
    followed = _names(rospy.get_param("~followed"))
    player, monitor = (rospy.resolve_name(str(rospy.get_param(f"~{node}"))) for node in ("player", "monitor"))
    pause = ServiceProxy(f"{player}/pause_playback", SetBool, timeout=5.0, patience=LIMIT)

    def begin() -> None:
        missing = _wait(player, monitor, followed)
        if missing:
            rospy.logwarn(f"the page does not show {', '.join(sorted(missing))}")
        pause(False)
        spin()

    return begin


def _names(value: Any) -> Set[str]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise ParameterError(f"parameter ~followed is {value!r}; give [topic, …]")
    return {rospy.resolve_name(name) for name in value}


def _wait(player: str, monitor: str, followed: Set[str]) -> Set[str]:
    """Waits until the monitor is connected to the player; returns the topics for which it is not."""
    until = time.monotonic() + LIMIT
    missing = followed
    while missing and time.monotonic() < until and not rospy.is_shutdown():
        with contextlib.suppress(*ERRORS):
            node = bounded_proxy(bounded_master().lookupNode(player), MASTER_TIMEOUT)
            answer: Any = node.getBusInfo(rospy.get_name())
            missing = followed - {entry[4] for entry in answer[2] if entry[1] == monitor}
        if missing:
            time.sleep(PERIOD)
    return missing
