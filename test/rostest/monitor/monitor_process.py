# SPDX-License-Identifier: Apache-2.0
"""The monitor as a process that can be stopped and started again, and topics to compare it with."""

import contextlib
import os
import signal
import subprocess
import threading
import time
from pathlib import Path

import rospkg
import rospy

from merlin_monitor.access.operators import write_operators
from merlin_test import LONG
from merlin_test.node_path import node_path
from merlin_test.ports import free_ports

GOALS = Path(rospkg.RosPack().get_path("merlin"), "pddl", "home", "goals.yaml")


def parent_of(pid):
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


class Latest:
    """The last message of a topic."""

    def __init__(self, topic, kind):
        self.changed = threading.Condition()
        self.message = None
        self.subscriber = rospy.Subscriber(topic, kind, self.receive)

    def receive(self, message):
        with self.changed:
            self.message = message
            self.changed.notify_all()

    def wait(self, holds):
        with self.changed:
            return self.changed.wait_for(lambda: self.message is not None and holds(self.message), LONG)


class Monitor:
    """The node under test, which can be stopped and started again on its port.

    :param panels: beyond its own.
    :param environment: what is different for it.
    """

    def __init__(self, panels, environment):
        self.panels = panels
        self.environment = {**os.environ, **environment}
        (self.port,) = free_ports(1)  # nobody gets it while the monitor is stopped
        self.process = None
        self.history = Path(os.environ.get("ROS_LOG_DIR", "/tmp")) / f"monitor-{os.getpid()}.sqlite"
        self.operators = self.history.with_name(f"operators-{os.getpid()}.yaml")

    def start(self, operators=None):
        with contextlib.suppress(KeyError):
            rospy.delete_param("/merlin_monitor/address")
        rospy.set_param("/merlin_monitor/port", self.port)
        if operators is not None:
            write_operators(self.operators, operators)
        rospy.set_param("/merlin_monitor/operators", str(self.operators) if operators else "none")
        rospy.set_param("/merlin_monitor/goals", str(GOALS))
        rospy.set_param("/merlin_monitor/history", str(self.history))
        rospy.set_param("/merlin_monitor/panels", self.panels)
        self.process = subprocess.Popen(
            [node_path("merlin_monitor", "monitor"), "__name:=merlin_monitor"],
            env=self.environment,
        )
        end = time.monotonic() + 2 * LONG  # a new process, on a machine that starts many
        while not rospy.has_param("/merlin_monitor/address"):
            assert self.process.poll() is None, "the monitor has ended"
            assert time.monotonic() < end, "the monitor does not start"
            time.sleep(0.02)
        self.address = rospy.get_param("/merlin_monitor/address")

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        self.process.wait(LONG)
