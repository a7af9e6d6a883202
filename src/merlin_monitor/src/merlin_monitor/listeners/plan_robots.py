# SPDX-License-Identifier: Apache-2.0
"""The robots of one plan whose topics a panel follows, each below its name."""

import re
from typing import Any, Callable, Dict, List, Set

from merlin_monitor.listeners.panel import Panel
from merlin_ros.robot_values import ROBOTS

#: Robots of one plan that can have topics: any node can name others.
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


class PlanRobots:
    """Follows the robots of ``robots:=`` from the begin, and others once their hosts are heard.

    :param follow: makes the subscribers of a robot; called in the watch's thread.
    :param forget: called in the model's thread with a robot that is forgotten.
    """

    def __init__(
        self,
        panel: Panel,
        follow: Callable[[str], List[Any]],
        forget: Callable[[str], object] = lambda robot: None,
    ) -> None:
        self._panel, self._follow, self._forget = panel, follow, forget
        self._own = panel.ros.namespace.strip("/")
        self._named = list(panel.ros.parameter(ROBOTS, []) or [])
        self._followed: Dict[str, List[Any]] = {}  # robot → subscribers; of the watch's thread
        self.look()

    def names(self) -> Set[str]:
        """The robots that can have topics, without the one in the namespace of the monitor."""
        names = [*map(str, self._named), *self._panel.state.tree.keys("robots", "robots")]
        return {name for name in names if name != self._own and _NAME.fullmatch(name)}

    def subscribers(self, topic: str) -> List[Any]:
        """Those of a topic below each robot that is followed."""
        followed = list(self._followed.items())
        return [each for name, made in followed for each in made if each.resolved_name == f"/{name}/{topic}"]

    def look(self) -> None:
        """Begins and ends to follow; once per second, in the watch's thread."""
        names = self.names()
        for robot in names - self._followed.keys():
            self._followed[robot] = self._follow(robot)
        for robot in self._followed.keys() - names:
            for subscriber in self._followed.pop(robot):
                subscriber.unregister()
            self._panel.state.inbox.put(self._forget, robot)
