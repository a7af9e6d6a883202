#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Kills one of several robots of an application that runs: its host, or all of its processes for good.

Usage: bench/robots/lose_robot.py ROBOT [--how host|all] [--moment now|talk|set_off|order] [--wait SECONDS]

Moments: ``talk``, in a conversation; ``set_off``, with an order as it leaves the bar, where it then stands;
``order``, 1.5 m further. The host is started again by its launch. With ``all`` everything below the robot's
namespace is killed with SIGKILL, scripts that would start it again included, as when its computer dies; what
is not the robot (the voices of simulated persons) continues. It finds the run of ``rosrun merlin run``, or
the master of ROS_MASTER_URI where there is none.
"""

import argparse
import contextlib
import math
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Optional, Tuple
from urllib.parse import urlparse
from xmlrpc.client import ServerProxy

import rosgraph
import rospy
from merlin_msgs.msg import KnowledgeChanges, RobotWay

from merlin.running import living
from merlin_planning.knowledge_text import to_pddl

HOST = "merlin_fsm_host"
NOT_OF_THE_ROBOT = ("person_voice",)  # nodes in its namespace that belong to the simulated world
STARTERS = ("respawn", "setpriv")

AWAY = 1.5  # m that a robot has driven

#: What happens to a robot, in this order, until it is killed: facts that come (+) and go (-), and a way.
MOMENTS: Dict[str, Tuple[str, ...]] = {
    "now": (),
    "talk": ("-quiet",),
    "set_off": ("+carrying", "-robot_at"),
    "order": ("+carrying", "-robot_at", "away"),
}


class Moment:
    """Follows the knowledge until a robot has come to a moment.

    :param robot: name.
    :param steps: as in ``MOMENTS``.
    """

    def __init__(self, robot: str, steps: Tuple[str, ...]) -> None:
        self._robot = robot
        self._left = list(steps)
        self._began: Optional[Tuple[float, float]] = None
        self.come = threading.Event()
        if not steps:
            self.come.set()

    def drive(self, robot: str, x: float, y: float) -> None:
        """Takes where a robot is on its way, m."""
        if robot != self._robot or self._left[:1] != ["away"]:
            return
        self._began = self._began or (x, y)
        if math.dist(self._began, (x, y)) > AWAY:
            self._left.clear()
            self.come.set()

    def see(self, added: List[str], removed: List[str]) -> None:
        """Takes changes of the knowledge, as PDDL text."""
        for sign, facts in (("+", added), ("-", removed)):
            for fact in facts:
                predicate, *arguments = fact.strip("()").split()
                if self._left and self._left[0] == sign + predicate and self._robot in arguments[:1]:
                    del self._left[0]
        if not self._left:
            self.come.set()


def processes_of(robot: str, uri: str, folder: Path = Path("/proc")) -> List[Tuple[int, str]]:
    """Processes below a robot's namespace on a master: number and node; the scripts that start them first.

    :param uri: of the master, which is on this machine.
    """
    found = []
    for process in folder.iterdir():
        try:
            words = (process / "environ").read_bytes().split(b"\0")
            command = (process / "cmdline").read_bytes().decode(errors="replace").split("\0")
        except OSError:
            continue  # not a process, gone, or another user's
        values = dict(word.decode(errors="replace").partition("=")[::2] for word in words)
        node = next((word[len("__name:=") :] for word in command if word.startswith("__name:=")), "")
        if (
            node
            and urlparse(values.get("ROS_MASTER_URI", "")).port == urlparse(uri).port
            and values.get("ROS_NAMESPACE", "").strip("/") == robot
            and node not in NOT_OF_THE_ROBOT
        ):
            starter = any(Path(word).name in STARTERS for word in command[:2])
            found.append((not starter, int(process.name), node))
    return [(number, node) for _, number, node in sorted(found)]


def _host(robot: str) -> Iterator[Tuple[int, str]]:
    master: Any = rosgraph.Master(rospy.get_name())
    proxy: Any = ServerProxy(master.lookupNode(f"/{robot}/{HOST}"))
    yield int(proxy.getPid(rospy.get_name())[2]), HOST


def lose(robot: str, how: str, uri: str, tell: Callable[[str], None] = print) -> int:
    """Kills a robot; returns how many processes that were."""
    victims = list(_host(robot)) if how == "host" else processes_of(robot, uri)
    for number, _ in victims:
        with contextlib.suppress(ProcessLookupError):  # the kernel has killed it with its starter
            os.kill(number, signal.SIGKILL)
    tell(f"killed of {robot}: {', '.join(sorted({node for _, node in victims})) or 'nothing'}")
    return len(victims)


def main(words: Optional[List[str]] = None) -> int:
    """The command; returns its exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("robot")
    parser.add_argument("--how", choices=("host", "all"), default="host")
    parser.add_argument("--moment", choices=tuple(MOMENTS), default="now")
    parser.add_argument("--wait", type=float, default=900.0, help="s of wall time for the moment to come")
    given = parser.parse_args(words)
    runs = living()
    if runs:
        os.environ["ROS_MASTER_URI"] = runs[-1].uri
    rospy.init_node("lose_robot", anonymous=True, disable_signals=True)
    moment = Moment(given.robot, MOMENTS[given.moment])

    def follow(changes: KnowledgeChanges) -> None:
        moment.see([to_pddl(item) for item in changes.added], [to_pddl(item) for item in changes.removed])

    def drive(way: RobotWay) -> None:
        moment.drive(way.robot, way.pose.position.x, way.pose.position.y)

    rospy.Subscriber("/rosplan_knowledge_base/changes", KnowledgeChanges, follow, tcp_nodelay=True)
    rospy.Subscriber("/robot_ways", RobotWay, drive, tcp_nodelay=True)
    if not moment.come.wait(given.wait):
        print(f"{given.robot} did not come to the moment '{given.moment}'", file=sys.stderr)
        return 1
    return 0 if lose(given.robot, given.how, os.environ["ROS_MASTER_URI"]) else 1


if __name__ == "__main__":
    sys.exit(main())
