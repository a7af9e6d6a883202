# SPDX-License-Identifier: Apache-2.0
"""Records what the robots of one plan do, and finds contradictions in the knowledge. Without ROS.
Not thread-safe."""

from typing import Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Set

ANYWHERE = "anywhere"


class _Drive(NamedTuple):
    place: str
    begin: float


class _Seen:
    def __init__(self) -> None:
        self.drives: Dict[str, _Drive] = {}  # by goal of its base
        self.ends: Dict[str, bool] = {}  # goal -> whether it has succeeded; may come before the goal
        self.driving: List[str] = []
        self.moves = False
        self.known: Optional[Set[str]] = None  # goals at the rest, of one that was struck
        self.over: Set[str] = set()  # those of them that had ended: its base may not have another one yet
        self.killed = False  # its host will send no goal any more
        self.stirred = False  # it has moved since then

    @property
    def last(self) -> str:
        """The goal of its last drive; empty: there was none."""
        return max(self.drives, key=lambda goal: self.drives[goal].begin, default="")

    @property
    def place(self) -> Optional[str]:
        """Where its last drive has ended; None: on its way."""
        return self.drives[self.last].place if self.ends.get(self.last) else None


class RobotsRecord:
    """The robots, as their topics show them. Messages of two topics may arrive in any order.

    :param robots: their names.
    """

    def __init__(self, robots: Sequence[str]) -> None:
        self._robots = {robot: _Seen() for robot in robots}
        self._running: List[str] = []
        self._earlier: Dict[str, Set[str]] = {robot: set() for robot in robots}  # goals before begin()
        self._planned = False
        self._rested = 0.0  # s of ROS time
        self.wrong: List[str] = []
        """What must not have happened, one sentence each."""

    def begin(self) -> None:
        """A plan may be carried out from now on; no place counts as visited."""
        self._planned = True
        for robot, seen in self._robots.items():
            self._earlier[robot] = set(seen.drives)
            seen.known, seen.stirred = None, False

    def rest(self, at: float, struck: str = "", killed: bool = False) -> None:
        """No robot may move from now on.

        :param at: s of ROS time; messages about an earlier goal may still come.
        :param struck: a robot whose host hangs and will continue, or was killed. Its base may get a goal that
            this host was about to send, and no motion for it; it may move for one that was on its way, until
            that is cancelled.
        :param killed: that host was killed: its base gets no goal that is newer.
        """
        self._planned = False
        self._rested = at
        if struck:
            seen = self._robots[struck]
            seen.known, seen.over, seen.killed = set(seen.drives), set(seen.ends), killed

    def running(self, actions: Sequence[Sequence[str]]) -> None:
        """The ground actions that a dispatcher waits for; the first argument is the robot."""
        robots = [action[1] for action in actions]
        self._running = [f"({' '.join(action)})" for action in actions]
        for robot in sorted({robot for robot in robots if robots.count(robot) > 1}):
            self.wrong.append(f"two actions run on {robot}: {self._running}")

    def sent(self, robot: str, goal: str, place: str, begin: float) -> None:
        """The base of a robot gets a goal.

        :param begin: s of ROS time; orders the goals.
        """
        seen = self._robots[robot]
        seen.drives[goal] = _Drive(place, begin)
        if not self._planned and begin > self._rested and (seen.known is None or seen.killed):
            self.wrong.append(f"the base of {robot} gets a goal, and no plan is carried out")

    def carries_out(self, robot: str, goals: Sequence[str]) -> None:
        """The goals that the base of a robot carries out now."""
        self._robots[robot].driving = list(goals)
        if len(goals) > 1:
            self.wrong.append(f"{robot} carries out {len(goals)} drives at once")

    def ended(self, robot: str, goal: str, succeeded: bool) -> None:
        """A goal of a base has ended."""
        self._robots[robot].ends[goal] = succeeded

    def moved(self, robot: str, moves: bool) -> None:
        """The last velocity of a robot."""
        seen = self._robots[robot]
        if moves and not seen.moves and not self._planned:
            if seen.known is None:
                self.wrong.append(f"{robot} drives, and no plan is carried out")
            seen.stirred = True
        seen.moves = moves

    @property
    def restless(self) -> List[str]:
        """The actions that still run, in words."""
        found = [f"{action} runs" for action in self._running]
        for robot, seen in self._robots.items():
            found += [f"the base of {robot} has a goal"] if seen.driving else []
            found += [f"{robot} moves"] if seen.moves else []
        return found

    def contradictions(self, positions: Mapping[str, Sequence[str]], visited: Sequence[str]) -> Iterator[str]:
        """Statements of the knowledge that are false, while no action runs.

        :param positions: robot -> the places where the knowledge says that it is.
        :param visited: places that a robot is said to have been to since :meth:`begin`.
        """
        reached: Set[str] = set()
        for robot, seen in self._robots.items():
            yield from self._after_a_hang(robot, seen)
            said = list(positions.get(robot, []))
            if len(said) != 1:
                yield f"{robot} is at {said or 'no place'}"
            elif said[0] not in (ANYWHERE, seen.place):
                yield f"{robot} is said to be at {said[0]}, and its last drive ended at {seen.place}"
            new = set(seen.drives) - self._earlier[robot]
            reached |= {seen.drives[goal].place for goal in new if seen.ends.get(goal)}
        for place in sorted(set(visited) - reached):
            yield f"{place} is said to be visited, and no drive has ended there"

    def _after_a_hang(self, robot: str, seen: _Seen) -> Iterator[str]:
        """What a host that continues must not do."""
        if seen.known is None:
            return
        open_drives = [drive for goal, drive in seen.drives.items() if goal not in seen.over]
        if seen.stirred and all(drive.begin > self._rested for drive in open_drives):
            yield f"{robot} has moved, and no goal for that was on its way when its host hung"
        for goal in set(seen.drives) - seen.known:
            # A simulated base arrives when its time is over, also where its guard let nothing pass.
            if seen.stirred and seen.ends.get(goal):
                place = seen.drives[goal].place
                yield f"{robot} has reached {place} after its host hung, and no plan is carried out"
