# SPDX-License-Identifier: Apache-2.0
"""What the tests of the guard look through: what the base gets, what the guard says, a client that leases."""

import subprocess
import threading
from pathlib import Path

import rospy
from actionlib_msgs.msg import GoalStatusArray
from geometry_msgs.msg import Twist
from merlin_msgs.msg import GuardStatus
from rosgraph_msgs.msg import Log

from merlin_test import LONG
from merlin_test.node_path import lean_script, node_path


class Witness:
    """What the base gets, what the guard says and what the motion server does."""

    def __init__(self, velocity_topic="cmd_vel"):
        self.changed = threading.Condition()
        self.velocities = []  # whether each was a motion
        self.fastest = 0.0  # m/s or rad/s of all that came
        self.status = None
        self.said = []  # all statuses since `forget`, because some last for moments only
        self.goals = {}
        self.log = []
        self.topics = [
            rospy.Subscriber(velocity_topic, Twist, self.receive_velocity, tcp_nodelay=True),
            rospy.Subscriber("merlin/guard", GuardStatus, self.receive_status, tcp_nodelay=True),
            rospy.Subscriber("move_base/status", GoalStatusArray, self.receive_goals, tcp_nodelay=True),
            rospy.Subscriber("/rosout", Log, self.receive_log),
        ]

    def close(self):
        for topic in self.topics:
            topic.unregister()

    def receive_velocity(self, velocity):
        with self.changed:
            self.velocities.append(velocity != Twist())
            self.fastest = max(self.fastest, abs(velocity.linear.x), abs(velocity.angular.z))
            self.changed.notify_all()

    def receive_status(self, status):
        with self.changed:
            self.status = status
            self.said.append((status.state, status.reason))
            self.changed.notify_all()

    def statuses(self, count):
        """Waits for so many messages of the guard."""
        for _ in range(count):
            with self.changed:
                heard = len(self.said)
            self.wait(lambda: len(self.said) > heard)  # noqa: B023

    def receive_goals(self, message):
        with self.changed:
            self.goals = {entry.goal_id.id: entry.status for entry in message.status_list}
            self.changed.notify_all()

    def receive_log(self, message):
        with self.changed:
            self.log.append(message.msg)
            self.changed.notify_all()

    def wait(self, holds):
        with self.changed:
            if not self.changed.wait_for(holds, LONG):
                raise AssertionError(f"did not happen; goals {self.goals}, guard:\n{self.status}")

    def state(self, state, reason=""):
        self.wait(lambda: self.status and self.status.state == state and reason in self.status.reason)

    def has_said(self, state, reason=""):
        self.wait(lambda: any(state == was and reason in why for was, why in self.said))

    def still(self):
        """Waits until so many zero velocities have come that no late one of before is on its way."""
        self.wait(lambda: len(self.velocities) > 5 and not any(self.velocities[-6:]))

    def forget(self):
        with self.changed:
            self.velocities.clear()
            self.said.clear()


class Client:
    """The process of a client that leases its goal.

    :param name: of its node; another one of that name ends.
    """

    def __init__(self, name):
        self.process = subprocess.Popen(
            lean_script(Path(__file__).with_name("motion_client.py"), f"__name:={name}"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, command):
        self.process.stdin.write(command + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().strip()
        assert answer, f"{self.process.args} has ended"
        return answer

    def end(self):
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()


def refused_guard(*arguments):
    """What a guard says that does not begin, and is not to be started again."""
    command = [node_path("merlin_guard", "guard"), *arguments]
    process = subprocess.run(command, capture_output=True, text=True, timeout=LONG)
    assert process.returncode == 2, process
    return process.stdout + process.stderr
