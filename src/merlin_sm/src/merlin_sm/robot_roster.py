"""Which robots of ``<kb>/robots`` count: any node can publish there, and name robots without end.

A node that names too many robots costs itself robots, and no other node. Without ROS.
"""

import re
import threading
from collections import OrderedDict
from typing import Any, Dict, NamedTuple, Optional, Set

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
        self._senders: Dict[str, str] = {}  # robot → the node that named it first
        # Node → its robots → when each was heard last, s; the one that is silent for longest first.
        self._heard: Dict[str, OrderedDict[str, float]] = {}
        self._told: Set[str] = set()

    def __contains__(self, robot: str) -> bool:
        with self._lock:
            return robot in self._senders

    def admit(self, robot: str, sender: str, now: float) -> Admission:
        """Takes a message.

        :param robot: its name; any key that there is one of for each robot.
        :param sender: the node that publishes it.
        :param now: s of a clock that never goes back.
        """
        with self._lock:
            forgotten = ""
            if robot not in self._senders:
                full = self._full(sender)
                if full is not None:
                    forgotten = next(iter(self._heard[full]))
                    if now - self._heard[full][forgotten] <= KEEP:
                        return Admission(False, refusal=self._refusal(sender, full))
                    self._forget(forgotten)
            robots = self._heard.setdefault(self._senders.setdefault(robot, sender), OrderedDict())
            robots[robot] = now
            robots.move_to_end(robot)
            return Admission(True, forgotten)

    def _full(self, sender: str) -> Optional[str]:
        """The node of which a robot has to be forgotten before `sender` names another; None: of none."""
        if len(self._heard.get(sender, ())) >= OF_ONE:
            return sender
        if len(self._senders) >= OF_ALL:
            return min(self._heard, key=lambda node: next(iter(self._heard[node].values())))
        return None

    def _forget(self, robot: str) -> None:
        sender = self._senders.pop(robot)
        del self._heard[sender][robot]
        if not self._heard[sender]:
            del self._heard[sender]

    def _refusal(self, sender: str, full: str) -> str:
        if sender in self._told or len(self._told) >= OF_ALL:
            return ""
        self._told.add(sender)
        if sender == full:
            return f"{sender or 'a node'} names more than {OF_ONE} robots; further ones of it do not count"
        return f"{OF_ALL} robots are there; those that {sender} names do not count"


def is_node(name: str) -> bool:
    """Whether a node can have this name, with its namespace."""
    return _NODE.fullmatch(name) is not None


def sender_of(message: Any) -> str:
    """The node that published a message; empty when that is not known."""
    return str((getattr(message, "_connection_header", None) or {}).get("callerid", ""))
