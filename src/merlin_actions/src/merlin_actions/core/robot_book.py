# SPDX-License-Identifier: Apache-2.0
"""Which robots take actions: words of their hosts and passing time in, changes out.

A host says every 0.25 s that it lives. One robot has one host: where two say that they are the same robot,
nothing is sent to either. A robot is known as soon as its host was heard once.
"""

import math
from typing import Any, Dict, List, NamedTuple

from merlin_ros.work.liveness import Limits, Liveness, Presence, Word

#: s between two words of a host.
WORD_PERIOD = 0.25
#: s of silence after which a robot takes no actions. With what follows, its actions have failed within 3 s.
GONE_AFTER = 2.0
#: Hosts that are remembered while they say that they are one robot.
HOSTS = 8
#: Operators of a message that count.
OPERATORS = 1000


class RobotChange(NamedTuple):
    """A robot takes actions, or takes none any more."""

    robot: str
    available: bool
    reason: str = ""
    """Why it takes none, as a sentence without a full stop."""
    answers: bool = False
    """Whether a host lives that answers a cancel."""
    forgotten: bool = False
    """Whether it is forgotten for another one: it has been silent for long."""
    at: float = math.inf
    """When, s of the monotonic clock: an action that comes later is not meant."""


class _Robot:
    def __init__(self, gone_after: float) -> None:
        self.hosts: Liveness[str] = Liveness(Limits(gone=gone_after, keep=gone_after), HOSTS)  # nodes
        self.words: Dict[str, Any] = {}  # last ones of the nodes that are there
        self.suspected: Dict[str, str] = {}  # node -> why actions cannot reach it, until its next word
        self.namespace = ""  # of the host that was heard last
        self.parameters: Dict[str, str] = {}  # operator -> the variable that names the robot
        self.reported = RobotChange("", False)
        self.gone = ""


class RobotBook:
    """The robots of one planning system. Not thread-safe.

    :param gone_after: s of silence after which a robot takes no actions.
    """

    def __init__(self, gone_after: float = GONE_AFTER) -> None:
        self._gone_after = gone_after
        self._robots: Dict[str, _Robot] = {}  # the one that was heard last comes last

    @property
    def robots(self) -> List[str]:
        """The robots that have sent a message."""
        return sorted(self._robots)

    def available(self, robot: str) -> bool:
        """Whether actions can be sent to it."""
        return robot in self._robots and self._robots[robot].reported.available

    def why_not(self, robot: str) -> str:
        """Why a robot takes no actions; empty when it does, or has sent no message."""
        return self._robots[robot].reported.reason if robot in self._robots else ""

    def is_gone(self, robot: str) -> bool:
        """Whether it was heard and no host of it answers any more; one may come back."""
        return robot in self._robots and not (self.available(robot) or self._robots[robot].reported.answers)

    def namespace(self, robot: str) -> str:
        """Where its actions are, with a slash at the end; empty: it has sent no message."""
        return self._robots[robot].namespace if robot in self._robots else ""

    def parameter(self, operator: str) -> str:
        """The variable of an operator that names the robot, as hosts declare it; empty: none has said."""
        name = operator.lower()
        said = (
            robot.parameters[name] for robot in reversed(self._robots.values()) if name in robot.parameters
        )
        return next(said, "")

    def hear(self, word: Any) -> List[RobotChange]:
        """A host says that it lives, or that it leaves.

        :param word: with the fields of merlin_msgs/RobotHost.
        """
        robot = self._robots.pop(word.robot, None) or _Robot(self._gone_after)
        self._robots[word.robot] = robot
        heard = robot.hosts.heard(word.node, word.life)
        if heard is Word.IGNORED:
            return []
        changes: List[RobotChange] = []
        if heard is Word.REBORN:
            changes += self._leave(word.robot, word.node, f"the host of robot {word.robot} was restarted")
        if word.leaving:
            robot.hosts.left(word.node)
            return changes + self._leave(word.robot, word.node, f"the host of robot {word.robot} has ended")
        robot.words[word.node] = word
        robot.suspected.pop(word.node, None)
        robot.namespace = word.node.rpartition("/")[0] + "/"
        operators = map(str.lower, word.operators[:OPERATORS])
        said = dict(zip(operators, word.robot_parameters))
        if not said.items() <= robot.parameters.items():
            robot.parameters = dict([*robot.parameters.items(), *said.items()][-OPERATORS:])
        return changes + self._report(word.robot)

    def forget(self, robot: str) -> RobotChange:
        """Forgets a robot that is gone."""
        self._robots.pop(robot, None)
        return RobotChange(robot, False, f"robot {robot} is forgotten", forgotten=True)

    def pass_time(self, seconds: float) -> List[RobotChange]:
        """Time passes, as the watcher counts it."""
        changes: List[RobotChange] = []
        for name, robot in self._robots.items():
            robot.hosts.pass_time(seconds)
            for node in list(robot.words):
                if robot.hosts.presence(node) is not Presence.ALIVE:
                    changes += self._leave(name, node, f"robot {name} is gone: its host {node} is silent")
        return changes

    def suspect(self, robot: str, reason: str) -> List[RobotChange]:
        """An action was lost with its host. The next word of that host proves that it lives."""
        if robot not in self._robots:
            return []
        self._robots[robot].suspected = dict.fromkeys(self._robots[robot].words, reason)
        return self._report(robot)

    def _leave(self, name: str, node: str, reason: str) -> List[RobotChange]:
        robot = self._robots[name]
        if robot.words.pop(node, None) is not None:
            robot.gone = reason
        return self._report(name)

    def _report(self, name: str) -> List[RobotChange]:
        """The change since the last one, if there is one."""
        robot = self._robots[name]
        now = self._now(name, robot)
        changed = (now.available, now.reason) != (robot.reported.available, robot.reported.reason)
        robot.reported = now
        return [now] if changed else []

    @staticmethod
    def _now(name: str, robot: _Robot) -> RobotChange:
        if not robot.words:
            return RobotChange(name, False, robot.gone)
        if len(robot.words) > 1:
            nodes = " and ".join(sorted(robot.words))
            return RobotChange(name, False, f"two hosts say that they are robot {name}: {nodes}", True)
        ((node, word),) = robot.words.items()
        if robot.suspected.get(node):
            return RobotChange(name, False, f"robot {name} is gone: {robot.suspected[node]}")
        if word.out:
            return RobotChange(name, False, f"robot {name} {word.out}", True)
        return RobotChange(name, True)
