# SPDX-License-Identifier: Apache-2.0
"""Process: watches what the robot really does, on connections of its own, and reports events.

Usage: witness.py [robot|mind|all]: the topics of one side of the link, or of both. Below a namespace
(ROS_NAMESPACE) it watches the robot of that name. Commands are those of :mod:`.asking`.
"""

import os
import sys
import threading
from pathlib import Path
from typing import Any, Dict, Tuple

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from geometry_msgs.msg import Twist
from merlin_msgs.msg import ExecutorStatus, GuardStatus
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback

from chaos.judging import events
from chaos.judging.scene import SERVERS
from chaos.under_test.asking import Asking
from chaos.under_test.child import Reporter, commands
from merlin_ros.master.publisher_updates import keep_all

LIVE = (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING)
ROBOT, MIND = "robot", "mind"
#: Characters of a node's message that are kept.
LONGEST = 500


class Witness:
    """Subscribes to the topics of one side."""

    def __init__(self, side: str, report: Reporter) -> None:
        self._report = report
        self._lock = threading.Lock()  # guards _goals; rospy has a thread per connection
        self._goals: Dict[str, Tuple[Any, Any]] = {}
        self._world = WorldTime()
        if side in (ROBOT, "all"):
            self._subscribe("ground_truth", Odometry, self._truth)
            self._subscribe("cmd_vel", Twist, self._command)
            self._subscribe("merlin/guard", GuardStatus, self._guard)
            for server in SERVERS:
                self._subscribe(f"{server}/status", GoalStatusArray, self._statuses, server)
        if side in (MIND, "all"):
            self._subscribe("/rosout", Log, self._said)
            self._subscribe("merlin/status", ExecutorStatus, self._status)
            self._subscribe("rosplan_plan_dispatcher/action_dispatch", ActionDispatch, self._dispatch)
            self._subscribe("rosplan_plan_dispatcher/action_feedback", ActionFeedback, self._feedback)

    def _subscribe(self, topic: str, message_class: type, callback: Any, *args: Any) -> None:
        rospy.Subscriber(topic, message_class, callback, *args, tcp_nodelay=True)

    def _truth(self, message: Odometry) -> None:
        twist, place = message.twist.twist, message.pose.pose.position
        self._report(
            events.TRUTH,
            speed=round(twist.linear.x, 4),
            turn=round(twist.angular.z, 4),
            x=round(place.x, 3),
            y=round(place.y, 3),
            ros=self._world.at(message.header.stamp.to_sec()),
        )

    def _command(self, message: Twist) -> None:
        self._report(events.COMMAND, speed=round(message.linear.x, 6), turn=round(message.angular.z, 6))

    def _guard(self, message: GuardStatus) -> None:
        self._report(events.GUARD, state=message.state, reason=message.reason, moving=message.moving)

    def _statuses(self, message: GoalStatusArray, server: str) -> None:
        active = sorted(entry.goal_id.id for entry in message.status_list if entry.status in LIVE)
        ended = {entry.goal_id.id: entry.status for entry in message.status_list if entry.status not in LIVE}
        with self._lock:
            if self._goals.get(server) == (active, ended):
                return
            self._goals[server] = (active, ended)
            self._report(events.GOALS, server=server, active=active, ended=ended)

    def _status(self, message: ExecutorStatus) -> None:
        running = [action.name for action in message.running]
        self._report(
            events.STATUS, state=message.state, stage=message.stage, request=message.request, running=running
        )

    def _said(self, message: Log) -> None:
        if message.level >= Log.WARN:
            self._report(events.SAID, node=message.name, level=message.level, text=message.msg[:LONGEST])

    def _dispatch(self, message: ActionDispatch) -> None:
        self._report(events.DISPATCH, name=message.name, action=message.action_id, plan=message.plan_id)

    def _feedback(self, message: ActionFeedback) -> None:
        said = "; ".join(f"{entry.key}: {entry.value}" for entry in message.information)
        self._report(
            events.FEEDBACK,
            action=message.action_id,
            plan=message.plan_id,
            status=message.status,
            information=said,
        )


class WorldTime:
    """Simulated time that continues where the clock is set back."""

    def __init__(self) -> None:
        self._last = 0.0
        self._back = 0.0

    def at(self, stamp: float) -> float:
        """s, never less than before.

        :param stamp: s on the clock.
        """
        if stamp < self._last:
            self._back += self._last - stamp
        self._last = stamp
        return stamp + self._back


def main() -> int:
    """Runs until the input is closed; returns the exit code."""
    side = sys.argv[1] if len(sys.argv) > 1 else "all"
    report = Reporter()
    keep_all()
    rospy.init_node(f"chaos_witness_{side}_{os.getpid()}", disable_signals=True)
    Witness(side, report)
    asking = Asking(report)
    for command in commands(sys.stdin):
        asking.obey(**command)
    os._exit(0)  # a shutdown would ask a master that may be dead


if __name__ == "__main__":
    main()
