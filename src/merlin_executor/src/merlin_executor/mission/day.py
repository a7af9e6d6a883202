# SPDX-License-Identifier: Apache-2.0
"""A day of requests in a file of YAML (docs/schedule.md, "A day")."""

import math
import queue
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple, Union

import rospy
import yaml

from merlin_executor.core.base_hold import CALENDAR
from merlin_executor.core.request_limits import MAX_OF_CLIENT, check_priority, check_value
from merlin_executor.executor_client import DROP, NEVER, RESUME
from merlin_executor.executor_request import ExecutorRequest
from merlin_executor.goal_check import GoalError, check_goals
from merlin_executor.mission.goal_dispatcher import GoalDispatcher, MissionFailed
from merlin_executor.mission.goal_state import ACHIEVED, outcome_text
from merlin_executor.mission.readiness import NotReady
from merlin_executor.request_times import Written, read_time
from merlin_planning.knowledge_text import parse_goal


class DayError(ValueError):
    """A file that is no day; the text has a line for each fault, with its place."""


def _duration(text: str) -> float:
    read = read_time(text)
    if not isinstance(read, float) or not read:
        raise ValueError("it has to be a duration: 90s, 10min or 2h")
    return read


def _goals(given: Union[str, List[str]]) -> List[str]:
    goals = [given] if isinstance(given, str) else list(given)
    if not goals or not all(isinstance(goal, str) and parse_goal(goal) for goal in goals):
        raise ValueError("it has to be PDDL, one text or a list of texts")
    return goals


def _one_of(**words: Any) -> Callable[[str], Any]:
    def read(text: str) -> Any:
        if text not in words:
            raise ValueError(f"it has to be one of {', '.join(words)}")
        return words[text]

    return read


#: What an entry may have, and how that is read.
_READERS: Dict[str, Callable[[Any], Any]] = {
    "at": read_time,
    "every": _duration,
    "goals": _goals,
    "deadline": _duration,
    "priority": lambda text: check_priority(int(text)),
    "value": lambda text: check_value(float(text)),
    "on_interrupt": _one_of(resume=RESUME, drop=DROP, never=NEVER),
    "alone": _one_of(true=True, false=False),
    "survives": _one_of(true=True, false=False),
    "by": str,
}


class Errand(NamedTuple):
    """An entry of the file."""

    where: str
    """File and line."""
    goals: List[str]
    at: Optional[Written] = None
    every: float = 0.0
    """s; zero: once."""
    deadline: float = math.inf
    """s after it is due."""
    options: Dict[str, Any] = {}
    """For :meth:`.GoalDispatcher.send`."""

    def due(self, begun: float, after: float) -> Optional[float]:
        """When it is due next, s of ROS time; None: never again. Without `at` it is counted from midnight.

        :param begun: when the mission began.
        :param after: the time after which that is.
        """
        if isinstance(self.at, float):
            first = begun + self.at
        else:
            day, clock = time.localtime(begun)[:3], self.at or (0, 0, 0)
            first = time.mktime((*day, *clock, 0, 0, -1)) if begun >= CALENDAR else 0.0
        if first <= after and self.every:
            first += (math.floor((after - first) / self.every) + 1) * self.every
        return first if first > after else None


def read_day(path: Path) -> List[Errand]:
    """Reads the file of a day.

    :raises DayError: when it cannot be read, or has a fault.
    """
    try:
        loader = yaml.BaseLoader(path.read_text(encoding="utf-8"))  # for others 10:30 is a number
        root = loader.get_single_node()
        entries = loader.construct_document(root) if root is not None else None
    except (OSError, UnicodeDecodeError) as error:
        raise DayError(f"{path} cannot be read: {error}") from error
    except (yaml.YAMLError, RecursionError) as error:
        raise DayError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(entries, list) or not 0 < len(entries) <= MAX_OF_CLIENT:
        raise DayError(f"{path} has to be a list of 1 to {MAX_OF_CLIENT} entries")
    errands, faults = [], []
    for node, entry in zip(root.value, entries):
        where = f"{path}:{node.start_mark.line + 1}"
        try:
            errands.append(_errand(where, entry, len(node.value)))
        except ValueError as error:
            faults.append(f"{where}: {error}")
    if faults:
        raise DayError("\n".join(faults))
    return errands


def _errand(where: str, entry: Any, keys: int) -> Errand:
    if not isinstance(entry, dict) or "goals" not in entry or not {"at", "every"} & set(entry):
        raise ValueError("an entry needs goals, and at or every")
    if len(entry) < keys:
        raise ValueError("a key stands there twice")
    given: Dict[str, Any] = {}
    for key, text in entry.items():
        if key not in _READERS:
            raise ValueError(f"{key!r} is none of {', '.join(_READERS)}")
        try:
            given[key] = _READERS[key](text)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{key} cannot be {text!r}: {error}") from error
    own = {key: given.pop(key) for key in Errand._fields if key in given}
    return Errand(where, **own, options=given)


class Day(GoalDispatcher):
    """Sends the goals of a file, each before it is due; ends when all have ended, repeated ones never do.

    :param file: of YAML.
    :raises DayError: for one that has a fault.
    """

    def __init__(self, file: Path) -> None:
        self._errands = read_day(file)
        super().__init__()
        self._ended: queue.Queue[Tuple[Errand, float, ExecutorRequest]] = queue.Queue()
        self._begun = 0.0

    @classmethod
    def faults(cls, value_of: Callable[[str], Any], fault: Callable[[str], str]) -> List[str]:
        """What is wrong with the file, and with its goals."""
        file = value_of("file")
        if not file:
            return [f"{cls.__name__}: the parameter ~file is missing, which names the file of the day"]
        try:
            errands = read_day(Path(str(file)))
        except DayError as error:
            return str(error).split("\n")
        said = [(each.where, goal, fault(goal)) for each in errands for goal in each.goals]
        return [f"{where}: {goal}: {why}" for where, goal, why in said if why]

    def wait_for_robot(self, timeout: float) -> None:
        """Waits for the robot, and checks times and goals."""
        super().wait_for_robot(timeout)
        for errand in self._errands:
            if isinstance(errand.at, tuple) and rospy.get_time() < CALENDAR:
                raise NotReady(f"{errand.where}: the robot's clock is a simulator's; write a time from now")
            try:
                check_goals([item for goal in errand.goals for item in parse_goal(goal)], self.knowledge)
            except GoalError as error:
                raise NotReady(f"{errand.where}: {error}") from error

    def run(self) -> None:
        """Sends what is due next of each errand, and the next one when that has ended."""
        self._begun = rospy.get_time()
        waiting = sum(self._send(errand, self._begun) for errand in self._errands)
        failed: List[str] = []
        while waiting:
            errand, due, request = self._ended.get()
            result = request.result
            if result is not None and result.outcome not in ACHIEVED:
                failed.append(f"{errand.where}: {outcome_text(result)}: {result.reason}")
                rospy.logwarn(failed[-1])
            waiting += self._send(errand, max(due, rospy.get_time())) - 1
        if failed:
            raise MissionFailed(f"{len(failed)} not done, the first: {failed[0]}")

    def _send(self, errand: Errand, after: float) -> bool:
        """Whether there is a next time."""
        due = errand.due(self._begun, after)
        if due is None:
            if after == self._begun:
                rospy.logwarn(f"{errand.where}: its time has passed today; it is left out")
            return False
        times = {"not_before": rospy.Time.from_sec(due)}
        if errand.deadline < math.inf:
            times["deadline"] = rospy.Time.from_sec(due + errand.deadline)
        name = f"{self.name}:{errand.where.rpartition(':')[2]}@{due:.0f}"
        self.send(
            errand.goals,
            on_done=lambda request: self._ended.put((errand, due, request)),
            name=name,
            **times,
            **errand.options,
        )
        return True
