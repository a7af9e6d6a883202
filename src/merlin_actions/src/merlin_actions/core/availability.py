# SPDX-License-Identifier: Apache-2.0
"""Which facts about available robots have to be written. Without ROS. Not thread-safe."""

from typing import Dict, Iterable, Optional, Set


class Availability:
    """Compares what is known of robots with what the knowledge base holds."""

    def __init__(self) -> None:
        self._wanted: Dict[str, bool] = {}
        self._written: Dict[str, bool] = {}
        self._settles = False
        self.unsettled = False
        """Whether the robots that the knowledge base lists have to be compared."""

    def put(self, robot: str, available: bool) -> None:
        """Notes whether a robot is available."""
        self._wanted[robot] = available

    def settle(self) -> None:
        """Robots without a message so far are not available, whatever the problem says."""
        self._settles = self.unsettled = True

    def forget(self, robots: Optional[Iterable[str]] = None) -> None:
        """What the knowledge base holds of some robots is not known any more; None: of any robot."""
        if robots is None:
            self.unsettled = self._settles
        for robot in list(self._written) if robots is None else robots:
            self._written.pop(robot, None)

    @property
    def robots(self) -> Set[str]:
        """The robots that are remembered: available ones, and those of which something has to be written."""
        return {*self._wanted, *self._written}

    @property
    def pending(self) -> bool:
        """Whether something has to be written."""
        return self.unsettled or self._written != self._wanted

    def is_written(self, robot: str) -> bool:
        """Whether the knowledge base holds what is known of a robot."""
        return self._written.get(robot) == self._wanted.get(robot)

    def changes(self) -> Dict[str, bool]:
        """Robot → what has to be written of it."""
        return {robot: there for robot, there in self._wanted.items() if self._written.get(robot) != there}

    def compare(self, listed: Iterable[str]) -> None:
        """Settles the robots that the knowledge base lists as available: without a message they are not."""
        self.unsettled = False
        for robot in listed:
            self._wanted.setdefault(robot, False)

    def wrote(self, robot: str, available: bool) -> None:
        """The knowledge base has accepted this. A robot that is not available is not remembered further."""
        self._written[robot] = available
        if not available and not self._wanted.get(robot):
            self._written.pop(robot)
            self._wanted.pop(robot, None)
