# SPDX-License-Identifier: Apache-2.0
"""Which robots of ``<kb>/robots`` count: any node can publish there, and name robots without end.

A node that names too many robots costs itself robots, and no other node. Without ROS.
"""

import re
import threading
from typing import NamedTuple, Set

from merlin_ros.work.liveness import Limits, Liveness, Word

#: Robots that one node may name.
OF_ONE = 50
#: Robots that all nodes may name together.
OF_ALL = 500
#: s of silence after which a robot may be forgotten for another one.
KEEP = 10.0
_NODE = re.compile(r"(/\w+)+")


class Admission(NamedTuple):
    """What is done with a message of a robot."""

    counts: bool
    """Whether the message counts."""
    forgotten: str = ""
    """A robot that has been silent for long, and had to be forgotten for this one; empty: none."""
    refusal: str = ""
    """Why the message does not count, a sentence; said once for each node that publishes."""


class RobotRoster:
    """Remembers which robots were heard, and which node publishes their messages. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the fields below
        self._now = 0.0
        self._robots: Liveness[str] = Liveness(Limits(gone=KEEP, keep=KEEP), OF_ALL, OF_ONE, self._forget)
        self._forgotten = ""
        self._reported: Set[str] = set()

    def __contains__(self, robot: str) -> bool:
        with self._lock:
            return robot in self._robots

    def admit(self, robot: str, sender: str, now: float) -> Admission:
        """Takes a message.

        :param robot: its name; any key that there is one of for each robot.
        :param sender: the node that publishes it.
        :param now: s of a clock that never goes back.
        """
        with self._lock:
            self._robots.pass_time(now - self._now)
            self._now, self._forgotten = now, ""
            if self._robots.heard(robot, source=sender) is Word.IGNORED:
                return Admission(False, refusal=self._refusal(sender))
            return Admission(True, self._forgotten)

    def _forget(self, robot: str) -> None:
        self._forgotten = robot

    def _refusal(self, sender: str) -> str:
        if sender in self._reported or len(self._reported) >= OF_ALL:
            return ""
        self._reported.add(sender)
        if self._robots.crowded(sender):
            return f"{sender or 'a node'} names more than {OF_ONE} robots; further ones of it do not count"
        return f"{OF_ALL} robots are there; those that {sender} names do not count"


def is_node(name: str) -> bool:
    """Whether a node can have this name, with its namespace."""
    return _NODE.fullmatch(name) is not None
