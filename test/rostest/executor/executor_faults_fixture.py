# SPDX-License-Identifier: Apache-2.0
"""What the tests of faults around the Executor look through, and the processes that they start and kill."""

import ctypes
import os
import signal
import subprocess
import threading
from contextlib import contextmanager

import rospy
from merlin_msgs.msg import DispatchStatus, ExecutorStatus, GuardStatus, KnowledgeChanges
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

from merlin_planning.knowledge_text import to_pddl
from merlin_test import LONG
from merlin_test.node_path import node_path
from merlin_test.topic_links import wait_for_publishers

ALWAYS = rospy.Time()
LIBC = ctypes.CDLL(None)
PR_SET_PDEATHSIG = 1


class Watch:
    """Keeps the last message of a topic and waits for one that fits."""

    def __init__(self, topic, message_class):
        self.last = None
        self._changed = threading.Condition()
        self._subscriber = rospy.Subscriber(topic, message_class, self._receive, tcp_nodelay=True)

    def _receive(self, message):
        with self._changed:
            self.last = message
            self._changed.notify_all()

    def wait(self, fits, since=ALWAYS):
        """Waits until the last message fits, and was published since then."""

        def seen():
            return self.last is not None and self.last.header.stamp >= since and fits(self.last)

        with self._changed:
            if not self._changed.wait_for(seen, LONG):
                raise AssertionError(f"the last message does not fit: {self.last}")
            return self.last

    def wait_idle(self, since):
        """Waits until the dispatcher or the Executor is idle, as it has said since then."""
        return self.wait(lambda status: status.state == ExecutorStatus.IDLE == DispatchStatus.IDLE, since)


class Changes:
    """Waits for the removal of a goal from the knowledge base."""

    def __init__(self, goal):
        self._removed = threading.Event()
        self._goal = goal
        self._subscriber = rospy.Subscriber(
            "rosplan_knowledge_base/changes", KnowledgeChanges, self._receive, tcp_nodelay=True
        )
        wait_for_publishers(self._subscriber)

    def _receive(self, message):
        if self._goal in map(to_pddl, message.goals_removed):
            self._removed.set()

    def wait_removed(self):
        if not self._removed.wait(LONG):
            raise AssertionError(f"the goal {self._goal} stays")


class Guard:
    """A guard of the test's: it says what the test wants, and notes what it is asked."""

    def __init__(self):
        self.braked = threading.Event()
        self.halted = threading.Event()
        self._brakes = rospy.Subscriber("merlin/brake", String, self._brake, tcp_nodelay=True)
        self._publisher = rospy.Publisher("merlin/guard", GuardStatus, latch=True, queue_size=10)
        self._service = rospy.Service("merlin/halt", Trigger, self._halt)
        self.says(moving=False)

    def wait_heard(self):
        """Waits until the Executor hears what it says, and it hears the Executor."""
        while not self._publisher.impl.has_connection("/merlin_executor"):
            rospy.rostime.wallsleep(0.01)
        wait_for_publishers(self._brakes)

    def says(self, moving):
        self._publisher.publish(GuardStatus(moving=moving))

    def _brake(self, reason):
        self.braked.set()

    def _halt(self, request):
        self.halted.set()
        return TriggerResponse(True, "halted")


def start(package, kind, *arguments, output=None):
    """Starts a node in a session of its own; it dies with the test."""
    return subprocess.Popen(
        [node_path(package, kind), *arguments],
        start_new_session=True,
        stdout=output,
        stderr=subprocess.STDOUT if output else None,
        text=True,
        preexec_fn=lambda: LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL),
    )


def kill(process, number=signal.SIGKILL):
    """Ends a process and all that it started."""
    if process.poll() is None:
        os.killpg(process.pid, number)
    process.wait(LONG)


@contextmanager
def client_process(*arguments):
    """A client of its own that wants the kitchen checked."""
    client = start("merlin_test", "executor_victim.py", *arguments)
    try:
        yield client
    finally:
        kill(client)
