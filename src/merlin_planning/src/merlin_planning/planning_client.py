# SPDX-License-Identifier: Apache-2.0
"""Drives the stages of a planning system with ROSPlan's interfaces: problem, plan, parse.

Every stage hands its product to the next one by a latched topic. A stage counts as done when its product was
seen on that topic; services that answer earlier do not mislead (design rules for the original ROSPlan).
"""

import contextlib
import threading
import time
from enum import Enum
from typing import Any, Callable, List, NamedTuple, Optional, Sequence, Tuple

import rospy
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import GoalDeadline, PlannerStatus, PlanWithoutAction, PlanWithoutGoal
from merlin_msgs.srv import PreviewPlan, PreviewPlanResponse
from roslib.message import get_message_class
from rosplan_dispatch_msgs.msg import ActionDispatch, EsterelPlanNode, PlanAction, PlanGoal
from std_msgs.msg import String
from std_srvs.srv import Empty

from merlin_ros.actions.action_client import ActionClient
from merlin_ros.deadline import Deadline
from merlin_ros.late_topics import subscribe
from merlin_ros.master.master_link import (
    ERRORS,
    MasterSilent,
    bounded_master,
    get_param,
    lost,
    master_answers,
    silent,
)
from merlin_ros.service_proxy import ServiceError, ServiceProxy, ServiceUnavailable
from merlin_ros.work.threads import start_thread

MASTER = "the ROS master"
PROBLEM = "the planning system's problem interface"
PLANNER = "the planning system's planner interface"
PARSER = "the planning system's parsing interface"
CALL_LIMIT = 20.0  # s of wall time for a service; writing and parsing a large problem takes seconds
LOOK = 0.1  # s between two looks for a restarted part; the master gives no event for a new service
READ_AHEAD = 1.0  # s of wall time for which parameters that were read count as the present ones
PREVIEW_ANSWERS = 13.0  # s of wall time; the planner stops after 10 s
HAND_OVER = 2.0  # s of running time within which a product has to appear on its topic
Interruptible = Callable[[Optional[Callable[[], None]]], None]


class Planned(Enum):
    """What a planner said."""

    SOLVED = "solved"
    UNSOLVABLE = "unsolvable"
    NO_PLAN = "no_plan"
    TIMEOUT = "timeout"
    ERROR = "error"
    CANCELLED = "cancelled"
    LATE = "late"


class PlanningResult(NamedTuple):
    """The planner's verdict and its reason."""

    verdict: Planned
    reason: str = ""
    gone: bool = False
    """The planner interface is not there, or does not answer."""
    reached: Tuple[float, ...] = ()
    """s from the begin of the plan until each of the goals with deadlines holds."""


class StageError(RuntimeError):
    """A stage failed; the text is a sentence that says why.

    :param gone: whether a part of the planning system is not there or does not answer.
    """

    def __init__(self, text: str, gone: bool = False) -> None:
        super().__init__(text)
        self.gone = gone


class TopicWatch:
    """Remembers the last message of a topic and waits for a newer one.

    :raises MasterSilent: when the master does not answer.
    """

    def __init__(self, topic: str, message_class: type) -> None:
        self.topic = rospy.resolve_name(topic)
        self._changed = threading.Condition()  # guards count and message
        self.count = 0
        self.message: Any = None
        self._subscriber = subscribe(self.topic, message_class, self._receive)

    def wait_newer(self, count: int, timeout: float) -> Any:
        """The last message, once more than `count` have come; None when none comes in time (running time)."""
        with self._changed:
            newer = Deadline(timeout).wait(self._changed, lambda: self.count > count)
            return self.message if newer else None

    def _receive(self, message: Any) -> None:
        with self._changed:
            self.count += 1
            self.message = message
            self._changed.notify_all()


class _Params:
    """Parameters that are being read in a thread of their own."""

    def __init__(self, name: str) -> None:
        self._begun = time.monotonic()
        self._name = name
        self._values: Any = None
        self._error: Optional[MasterSilent] = None
        self._thread = start_thread(f"parameters {name}", self._read)

    @property
    def fresh(self) -> bool:
        """Whether they count as the present ones."""
        return time.monotonic() - self._begun <= READ_AHEAD

    def get(self) -> Any:
        """Waits for them.

        :raises MasterSilent: the master does not answer.
        """
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._values

    def _read(self) -> None:
        try:
            self._values = get_param(self._name, {})
        except MasterSilent as error:
            self._error = error


class PlanningClient:
    """The stages before dispatch. Names are those of the planning system's nodes (scopes).

    :param problem: the problem interface.
    :param planner: the planner interface.
    :param parser: the parsing interface.
    """

    def __init__(
        self,
        problem: str = "rosplan_problem_interface",
        planner: str = "rosplan_planner_interface",
        parser: str = "rosplan_parsing_interface",
    ) -> None:
        self._planner = rospy.resolve_name(planner)
        self._parser = rospy.resolve_name(parser)
        self._generate = ServiceProxy(f"{problem}/problem_generation_server", Empty, timeout=CALL_LIMIT)
        self._parse = ServiceProxy(f"{parser}/parse_plan", Empty, timeout=CALL_LIMIT)
        self._client = ActionClient(f"{planner}/start_planning", PlanAction)
        self._without: Optional[ActionClient] = None
        self._preview: Optional[ServiceProxy] = None
        self._problem = TopicWatch(f"{problem}/problem_instance", String)
        self._output = TopicWatch(f"{planner}/planner_output", String)
        self._plan: Optional[TopicWatch] = None
        self._params: Optional[_Params] = None  # of the planner, read while the problem is written
        self._changed = threading.Condition()  # guards the field below
        self._status: Optional[PlannerStatus] = None
        self._status_subscriber = rospy.Subscriber(
            f"{planner}/planner_status", PlannerStatus, self._receive_status, tcp_nodelay=True
        )

    def wait(self, timeout: float) -> None:
        """Waits until all stages are there, s of running time.

        :raises StageError: naming the first that is missing.
        """
        for part, proxy in ((PROBLEM, self._generate), (PARSER, self._parse)):
            if not proxy.wait(timeout):
                raise StageError(
                    f"{part} is not there: no service {proxy.name} after {timeout:g} s; is it launched?"
                )
        if not self._client.wait_for_server(timeout):
            raise StageError(
                f"{PLANNER} is not there: no action server {self._client.name} after {timeout:g} s"
            )
        # A plan that is latched from before arrives now, and is not taken for the first one that is parsed.
        with contextlib.suppress(StageError):
            self._plan_watch()

    def missing(self) -> str:
        """The first part that is not there, in words; empty when all are."""
        if lost.is_set() or silent.is_set():
            return MASTER  # the others cannot be asked
        for part, proxy in ((PROBLEM, self._generate), (PARSER, self._parse)):
            if not proxy.available():
                return part
        return "" if self._client.alive else PLANNER

    def wait_back(
        self, timeout: float, cancelled: threading.Event, missing: Callable[[], str] = lambda: ""
    ) -> str:
        """Waits for the return of a planning system that was ended.

        :param timeout: s of running time.
        :param cancelled: ends the wait.
        :param missing: names a further part that has to be there, empty when it is.
        :return: the part that is still missing, in words; empty when all are there.
        """
        deadline = Deadline(timeout)
        while True:
            part = self.missing() or missing()
            if not part or cancelled.is_set() or deadline.expired or rospy.is_shutdown():
                return part
            cancelled.wait(LOOK)

    def read_ahead(self) -> None:
        """Begins to read the planner's parameters for a planning that is about to be asked for."""
        self._params = _Params(self._planner)

    def generate_problem(self) -> None:
        """Calls the problem generation.

        :raises StageError: when that fails.
        """
        count = self._problem.count
        if self._params is None or not self._params.fresh:
            self.read_ahead()
        self._call(PROBLEM, self._generate)
        if self._problem.wait_newer(count, HAND_OVER) is None:
            raise StageError(f"{PROBLEM} answered, but no problem appeared on {self._problem.topic}")

    @property
    def plan_text(self) -> str:
        """The plan that the planner found last; empty: none is known."""
        message = self._output.message
        return "" if message is None else str(message.data)

    def plan(
        self,
        interruptible: Interruptible,
        without: Sequence[str] = (),
        after: Optional[Sequence[str]] = None,
        deadlines: Sequence[GoalDeadline] = (),
    ) -> PlanningResult:
        """Calls the planner. The interruption cancels the planner.

        ROSPlan's own planner interface knows none of these wishes: ERROR.

        :param without: actions that it has to do without, as PDDL text with ``*`` for any argument.
        :param after: actions that run, as PDDL text in the order of their ends: the plan begins where they
            have ended, and does not contain them. None: it is not one for
            :meth:`.dispatch_client.DispatchClient.exchange`; for that one an empty list may be right.
        :param deadlines: goals that have to be reached in time; LATE when it is proven that they cannot.
        """
        wishes = bool(without or deadlines) or after is not None
        client = self._client_for(wishes)
        if client is None:
            return PlanningResult(Planned.ERROR, f"{MASTER} does not answer", gone=True)
        if not client.alive and not client.wait_for_server(HAND_OVER):
            if wishes and self._client.alive:
                what = "plan with deadlines" if deadlines else "plan from where actions end"
                what = "leave actions out of a plan" if without else what
                return PlanningResult(Planned.ERROR, f"{PLANNER} cannot {what}")
            reason = f"{PLANNER} is not there: no action server {client.name}"
            return PlanningResult(Planned.ERROR, reason, gone=True)
        count = self._output.count
        with self._changed:
            self._status = None
        ended = threading.Event()
        goal: Any = self._goal()
        if wishes:
            goal = PlanWithoutGoal(goal, list(without), list(after or ()), after is not None, list(deadlines))
        sent = client.send(goal, on_done=lambda _: ended.set())
        cancelled = threading.Event()

        def cancel() -> None:
            cancelled.set()
            sent.cancel()
            ended.set()

        interruptible(cancel)
        is_over = Deadline(None).wait_event(ended)
        interruptible(None)
        if not is_over:
            return PlanningResult(Planned.CANCELLED, "this node ends before the planner has")
        if cancelled.is_set():
            # The original planner interface plans on; its late answer is overtaken by the next problem.
            sent.wait(HAND_OVER)
            return PlanningResult(Planned.CANCELLED, "cancelled while planning")
        if sent.status == GoalStatus.SUCCEEDED and self._output.wait_newer(count, HAND_OVER) is not None:
            return PlanningResult(Planned.SOLVED, reached=tuple(sent.result.reached) if deadlines else ())
        failure = self._failure(sent.text, sent.status)
        if deadlines and failure.verdict is Planned.UNSOLVABLE and sent.result.reached:
            return failure._replace(verdict=Planned.LATE)
        return failure

    def preview(self, **fields: Any) -> PreviewPlanResponse:
        """Plans only to look at the plan.

        :param fields: of merlin_msgs/PreviewPlan.
        :raises ServiceError: the planner interface does not answer, or knows no such service.
        """
        if self._preview is None:  # seldom wanted
            self._preview = ServiceProxy(
                f"{self._planner}/preview_plan", PreviewPlan, timeout=PREVIEW_ANSWERS
            )
        return self._preview(**fields)

    def _client_for(self, wishes: bool) -> Optional[ActionClient]:
        """None: it would be made only now, and rospy waits without end for a master that is gone."""
        if not wishes:
            return self._client
        if self._without is None and master_answers():  # seldom wanted
            self._without = ActionClient(f"{self._planner}/plan_without", PlanWithoutAction)
        return self._without

    def parse_plan(self) -> List[ActionDispatch]:
        """Calls the parser and returns the plan's actions in order.

        :raises StageError: when no message came.
        """
        watch = self._plan_watch()
        count = watch.count
        for _ in range(2):  # the parser may get the planner's output a moment after its caller
            self._call(PARSER, self._parse)
            message = watch.wait_newer(count, HAND_OVER / 2)
            if message is not None:
                return plan_actions(message)
        raise StageError(f"{PARSER} answered, but no plan appeared on {watch.topic}")

    def _goal(self) -> PlanGoal:
        ahead, self._params = self._params, None
        if ahead is None or not ahead.fresh:
            ahead = _Params(self._planner)
        try:
            params = ahead.get()
        except MasterSilent as error:
            raise StageError(str(error), gone=True) from error
        return PlanGoal(
            domain_path=params.get("domain_path", ""),
            problem_path=params.get("problem_path", ""),
            data_path=params.get("data_path", ""),
            planner_command=params.get("planner_command", ""),
            use_problem_topic=bool(params.get("use_problem_topic", True)),
        )

    def _failure(self, text: str, status: int) -> PlanningResult:
        with self._changed:
            if status != GoalStatus.LOST and self._status_subscriber.get_num_connections():
                # It is published before the end of the goal, but on another connection.
                Deadline(HAND_OVER).wait(self._changed, self._is_reported)
            known = self._status if self._is_reported() else None
        if known is not None:
            return PlanningResult(_VERDICTS[known.state], known.reason or text)
        if status == GoalStatus.LOST:
            return PlanningResult(Planned.ERROR, f"{PLANNER} is gone: {text}", gone=True)
        # The original planner interface does not distinguish a failure from an unsolvable problem.
        return PlanningResult(Planned.ERROR, text or "the planner found no plan")

    def _is_reported(self) -> bool:
        return self._status is not None and self._status.state in _VERDICTS

    def _receive_status(self, status: PlannerStatus) -> None:
        with self._changed:
            self._status = status
            self._changed.notify_all()

    def _plan_watch(self) -> TopicWatch:
        if self._plan is None:
            topic = f"{self._parser}/complete_plan"
            try:
                types = dict(bounded_master().getTopicTypes())
            except ERRORS as error:
                raise StageError(f"{PARSER} cannot be looked up: {error}", gone=True) from error
            if topic not in types:
                raise StageError(f"{PARSER} is not there: no plans are published on {topic}", gone=True)
            try:
                self._plan = TopicWatch(topic, get_message_class(types[topic]))
            except MasterSilent as error:
                raise StageError(f"{PARSER}: {error}", gone=True) from error
        return self._plan

    @staticmethod
    def _call(part: str, proxy: ServiceProxy) -> None:
        try:
            proxy()
        except ServiceError as error:
            gone = isinstance(error, ServiceUnavailable)
            said = "does not answer" if gone else "failed"
            raise StageError(f"{part} {said}: {error}", gone=gone) from error


def plan_actions(plan: Any) -> List[ActionDispatch]:
    """The actions of a CompletePlan or an EsterelPlan, in order."""
    if hasattr(plan, "plan"):
        return list(plan.plan)
    return [node.action for node in plan.nodes if node.node_type == EsterelPlanNode.ACTION_START]


_VERDICTS = {
    PlannerStatus.UNSOLVABLE: Planned.UNSOLVABLE,
    PlannerStatus.NO_PLAN: Planned.NO_PLAN,
    PlannerStatus.TIMEOUT: Planned.TIMEOUT,
    PlannerStatus.CRASHED: Planned.ERROR,
    PlannerStatus.INVALID: Planned.ERROR,
    PlannerStatus.CANCELLED: Planned.CANCELLED,
}
