# SPDX-License-Identifier: Apache-2.0
"""A day of requests in a file of YAML (docs/schedule.md, "A day")."""

import functools
import hashlib
import itertools
import math
import queue
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Union

import rospy
import yaml
from merlin_msgs.msg import ExecuteResult, GoalQueue

from merlin_executor.core.request_limits import MAX_OF_CLIENT, check_priority, check_value
from merlin_executor.executor_client import DROP, NEVER, RESUME, lasting_id
from merlin_executor.executor_request import ExecutorRequest
from merlin_executor.goal_check import GoalError, check_goals
from merlin_executor.mission.goal_dispatcher import GoalDispatcher, MissionFailed
from merlin_executor.mission.goal_state import ACHIEVED, outcome_text
from merlin_executor.mission.readiness import NotReady
from merlin_executor.request_times import Written, read_time
from merlin_planning.knowledge_text import parse_goal
from merlin_ros.deadline import LONGEST_SLEEP
from merlin_ros.ros_alarm import RosAlarm, call_after
from merlin_ros.service_proxy import ServiceError
from merlin_ros.work.passed_time import CALENDAR

PAUSE = 2.0  # s of ROS time before an errand that was not begun is sent again; doubles each time
LONGEST_PAUSE = 300.0
DAY = 24 * 3600.0  # s
LATEST = 3600.0  # s after it was due at which one without a deadline is sent for the last time


class DayError(ValueError):
    """A file that cannot be used as a day; the text has a line for each fault, with its place."""


def _duration(text: str) -> float:
    read = read_time(text)
    if not isinstance(read, float) or read < 1.0:
        raise ValueError("it has to be a duration of 1 s at least: 90s, 10min or 2h")
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

    @property
    def survives(self) -> bool:
        """Whether a request of it survives."""
        return bool(self.options.get("survives"))

    @property
    def name(self) -> str:
        """The same for all its times, wherever it stands; another one for an entry that says else."""
        said = self._replace(where="", options=dict(sorted(self.options.items())))
        return hashlib.sha256(repr(said).encode()).hexdigest()[:12]

    def due(self, begun: float, after: float) -> Optional[float]:
        """When it is due next, s of ROS time; None: never again. Without `at` it is counted from midnight.

        :param begun: when the mission began.
        :param after: the time after which that is.
        """
        by_clock = begun >= CALENDAR and not isinstance(self.at, float)
        year, month, day = time.localtime(begun)[:3]
        clock = self.at if isinstance(self.at, tuple) else (0, 0, 0)

        def on_day(number: int) -> float:
            return time.mktime((year, month, day + number, *clock, 0, 0, -1))

        first = begun + self.at if isinstance(self.at, float) else on_day(0) if by_clock else 0.0
        if first <= after and self.every:
            passed = math.floor((after - first) / self.every)
            if by_clock and self.every % DAY == 0.0:  # where the clock is changed, a day has 23 or 25 h
                days = int(self.every / DAY)
                return next(at for at in map(on_day, itertools.count(passed * days, days)) if at > after)
            first += (passed + 1) * self.every
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
    errands: List[Errand] = []
    faults: List[str] = []
    for node, entry in zip(root.value, entries):
        where = f"{path}:{node.start_mark.line + 1}"
        try:
            errand = _errand(where, entry, len(node.value))
            if errand.name in {each.name for each in errands}:
                raise ValueError("the same entry stands before")
            errands.append(errand)
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
    errand = Errand(where, **own, options=given)
    if errand.survives and isinstance(errand.at, float):  # a mission that begins again would send it twice
        raise ValueError("with survives, at has to be a time of the day")
    return errand


class Day(GoalDispatcher):
    """Sends the goals of a file, each before it is due; ends when all have ended, repeated ones never do.

    :param file: of YAML.
    :raises DayError: for one that has a fault.
    """

    def __init__(self, file: Path) -> None:
        self._errands = read_day(file)
        super().__init__()
        self._events: queue.Queue[Callable[[], None]] = queue.Queue()
        self._alarms: Dict[int, RosAlarm] = {}
        #: Id of what survives → not before when, as `merlin/queue` said last; None: it was not in it.
        self._queued: Dict[str, Optional[rospy.Time]] = {
            lasting_id(self._name(errand)): None for errand in self._errands if errand.survives
        }
        self._begun = 0.0
        self._open = len(self._errands)
        self._failed = 0
        self._first = ""

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
        heard = rospy.Subscriber("merlin/queue", GoalQueue, self._hear_queue, tcp_nodelay=True)
        try:
            for errand in self._errands:
                self._begin(errand)
            while self._open:
                try:  # not one long wait: a signal that comes just before it would be handled behind it
                    event = self._events.get(timeout=LONGEST_SLEEP)
                except queue.Empty:
                    continue
                self._refuse_cancelled(["what is due next"])
                event()
        finally:
            heard.unregister()
            for alarm in self._alarms.values():
                alarm.shutdown()
        if self._failed:
            raise MissionFailed(f"{self._failed} not done, the first: {self._first}")

    def cancel(self) -> None:
        """As of :class:`.GoalDispatcher`."""
        super().cancel()
        self._events.put(lambda: None)  # nothing may have been sent that ends now

    def _hear_queue(self, queue: GoalQueue) -> None:
        self._queued.update(
            (each.request, each.not_before) for each in queue.requests if each.request in self._queued
        )

    def _begin(self, errand: Errand) -> None:
        if errand.due(self._begun, self._begun) is not None:
            self._next(errand, self._begun)
        elif errand.survives:
            self._follow(errand, self._begun)
        else:
            self._leave_out(errand)

    def _follow(self, errand: Errand, due: float, pause: float = PAUSE, lost: str = "") -> None:
        """Finds one that survives, and waits for its end; it is not sent.

        :param pause: s of ROS time before it is looked for once more when the Executor is lost.
        :param lost: how that was; empty: it is looked for the first time.
        """
        self.client.follow(
            lasting_id(self._name(errand)),
            on_done=lambda request: self._events.put(
                lambda: self._followed(errand, due, pause, lost, request)
            ),
        )

    def _followed(
        self, errand: Errand, due: float, pause: float, lost: str, request: ExecutorRequest
    ) -> None:
        result = request.result
        if result is None or result.outcome != ExecuteResult.REFUSED:
            self._found_ended(errand, due, pause, result)
        elif lost:  # how it has ended since then is not known
            self._close(errand, due, lost)
        else:
            self._leave_out(errand)

    def _found_ended(self, errand: Errand, due: float, pause: float, result: Optional[ExecuteResult]) -> None:
        """One that may go on without its client has ended, or is lost; it is never sent."""
        why = _why(errand, result)
        lost = result is not None and result.outcome == ExecuteResult.INTERNAL
        wait = _patience(errand, due, pause) if lost else 0.0
        if wait:
            self._later(errand, wait, lambda: self._follow(errand, due, _longer(pause), why), why)
        else:
            self._close(errand, due, why)

    def _leave_out(self, errand: Errand) -> None:
        rospy.logwarn(f"{errand.where}: its time has passed today; it is left out")
        self._open -= 1

    def _name(self, errand: Errand) -> str:
        """Of its requests: the next one of an errand is sent when none is left, so a name finds what is."""
        return f"{self.name}:{errand.name}"

    def _next(self, errand: Errand, after: float) -> None:
        due = errand.due(self._begun, after)
        if due is None:
            self._open -= 1
        else:
            self._send(errand, due)

    def _send(self, errand: Errand, due: float, pause: float = PAUSE) -> None:
        """Sends an errand, which may be the one that was sent before.

        :param pause: s of ROS time before it is sent once more when it ends before it is due.
        """

        def ended(
            result: Optional[ExecuteResult],
            taken_back: Callable[[], bool] = lambda: False,
            begun: bool = False,
        ) -> None:
            self._events.put(lambda: self._ended(errand, due, pause, result, taken_back, begun))

        def taken_back(request: ExecutorRequest) -> bool:
            # It may be that of an earlier time, which was found under the same name.
            return request.taken_back and self._queued.get(request.id, not_before) == not_before

        not_before = rospy.Time.from_sec(due)
        times = {"not_before": not_before}
        if errand.deadline < math.inf:
            times["deadline"] = rospy.Time.from_sec(due + errand.deadline)
        try:
            self.send(
                errand.goals,
                on_done=lambda request: ended(request.result, lambda: taken_back(request), request.begun),
                name=self._name(errand),
                **times,
                **errand.options,
            )
        except (ValueError, ServiceError) as error:
            ended(ExecuteResult(outcome=ExecuteResult.REFUSED, reason=str(error)))

    def _ended(
        self,
        errand: Errand,
        due: float,
        pause: float,
        result: Optional[ExecuteResult],
        taken_back: Callable[[], bool],
        begun: bool,
    ) -> None:
        def again() -> None:
            if taken_back():  # `merlin/queue` was heard later than the end
                self._close(errand, due, why)
            else:
                self._send(errand, due, _longer(pause))

        now, why = rospy.get_time(), _why(errand, result)
        outcome = None if result is None else result.outcome
        lost = outcome == ExecuteResult.INTERNAL
        if taken_back():
            wait = 0.0
        elif now < due:  # one that survives and was achieved was that of an earlier time
            wait = min(pause, due - now) if why or errand.survives else 0.0
        elif lost and begun and errand.survives:
            self._found_ended(errand, due, pause, result)
            return
        else:  # what was begun may have been done in part: it is not begun again
            missed = outcome == ExecuteResult.REFUSED or (lost and not begun)
            wait = _patience(errand, due, pause) if missed else 0.0
        if wait:
            self._later(errand, wait, again, why)
        else:
            self._close(errand, due, why)

    def _later(self, errand: Errand, wait: float, call: Callable[[], None], why: str) -> None:
        if why:
            rospy.logwarn(f"{why}; again in {wait:.0f} s")
        again = functools.partial(self._events.put, call)
        self._alarms[id(errand)] = call_after(wait, again, f"again {errand.where}")

    def _close(self, errand: Errand, due: float, why: str) -> None:
        """Goes on to its next time.

        :param why: it was not done; empty: it was.
        """
        if why:
            rospy.logwarn(why)
        self._failed += bool(why)
        self._first = self._first or why
        self._next(errand, max(due, rospy.get_time()))


def _why(errand: Errand, result: Optional[ExecuteResult]) -> str:
    """Why an errand was not achieved, as a sentence; empty: it was."""
    if result is None or result.outcome in ACHIEVED:
        return ""
    return f"{errand.where}: {outcome_text(result)}: {result.reason}"


def _longer(pause: float) -> float:
    return min(2.0 * pause, LONGEST_PAUSE)


def _patience(errand: Errand, due: float, pause: float) -> float:
    """After how many s something is tried again for an errand whose time has come; zero: never."""
    left = due + min(errand.deadline, errand.every or LATEST) - rospy.get_time()
    return min(pause, left / 2.0) if left > PAUSE else 0.0
