# SPDX-License-Identifier: Apache-2.0
"""ROSPlan's planner interface: PDDL problem in, plan out."""

import contextlib
import dataclasses
import functools
import os
import threading
from typing import TYPE_CHECKING, Any, Callable, NamedTuple, Optional, Sequence, Set, Type

import rospy
from merlin_msgs.msg import PlannerStatus, PlanWithoutAction, PlanWithoutFeedback, PlanWithoutResult
from merlin_msgs.srv import PreviewPlan
from rosplan_dispatch_msgs.msg import PlanAction, PlanFeedback, PlanGoal, PlanResult
from rosplan_dispatch_msgs.srv import PlanningService, PlanningServiceRequest, PlanningServiceResponse
from std_msgs.msg import String
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse, Trigger

from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.actions.serial_action_server import NOT_BEGUN, SerialActionServer
from merlin_ros.health import OK, WARN, Health
from merlin_ros.master.master_link import get_param
from merlin_ros.publishing import publish
from merlin_rosplan.planning.planner_files import replace_file
from merlin_rosplan.planning.planner_settings import PlannerSettings, dues_of
from merlin_rosplan.planning.planning_outcome import PlannerState, PlanningOutcome
from merlin_rosplan.supervision.scratch_folder import ScratchFolder
from merlin_rosplan.transport.component import Component
from merlin_rosplan.transport.handover import Handover, digest_service

if TYPE_CHECKING:  # what plans is imported when the node serves
    from merlin_rosplan.nodes.preview_service import PreviewService
    from merlin_rosplan.supervision.supervised_planning import Planning


class _Wish(NamedTuple):
    """What is to be planned.

    :ivar goal: of an action, which is to be answered; None: a service was called.
    :ivar after: actions that run, as PDDL text: the plan begins where they have ended; None: it is not to
        follow what runs.
    :ivar on_begin: called when the planner works.
    """

    request: PlanningServiceRequest
    settings: PlannerSettings
    goal: Optional[ServerGoal] = None
    after: Optional[Sequence[str]] = None
    on_begin: Callable[[], None] = lambda: None

    @property
    def cancelled(self) -> bool:
        """Whether its client wants no plan any more."""
        return self.goal is not None and self.goal.cancel_requested


class PlannerInterface(Component):
    """Plans on request, one problem at a time.

    Services ``planning_server``, ``planning_server_params``, ``preview_plan``; action servers
    ``start_planning`` and ``plan_without``, whose cancel kills the planner; topics ``planner_output`` and
    ``planner_status``, both latched.
    """

    def __init__(self, scope: str) -> None:
        super().__init__(scope)
        self._state = threading.Condition()  # guards the fields below
        self._plans = False  # there is one planning at a time
        self._problem: Optional[str] = None
        self._current: Optional[Planning] = None
        self._current_goal: Optional[str] = None
        self._last: Optional[PlanningOutcome] = None
        self._warned: Set[str] = set()
        self._folder = ScratchFolder("planner_interface")
        self._settings = self._read_settings()
        self._strict = self.flag("strict", True)
        topic = self.resolve(str(self.param("planner_topic", "planner_output")))
        self._output = self.publisher(topic, String, queue_size=1, latch=True)
        self._hand_over = self.own(Handover.sender(topic))
        self.service(digest_service(topic), Trigger, self._hand_over.answer_digest)
        self._status = self.publisher("planner_status", PlannerStatus, queue_size=10, latch=True)
        self._report(PlannerStatus(state=PlannerStatus.IDLE, reason="nothing planned yet"))
        self._problem_topic = self.resolve(str(self.param("problem_topic", "problem_instance")))
        self._problems = self.own(Handover.receiver(self._problem_topic, self._receive_problem))
        self.subscriber(self._problem_topic, String, self._problems.from_topic, queue_size=1)
        self.service("planning_server", Empty, self._serve)
        self.service("planning_server_params", PlanningService, self._serve_params)
        for name, spec, execute in (
            ("start_planning", PlanAction, self._execute),
            ("plan_without", PlanWithoutAction, self._execute_without),
        ):
            self.own(SerialActionServer(self.resolve(name), spec, execute, self._cancel)).start()
        self.service("preview_plan", PreviewPlan, lambda request: self._preview.answer(request))

    def prepare(self) -> None:
        """Starts the process that plans, and imports what the first planning needs."""
        from merlin_rosplan.supervision.planner_host import HOSTS, HostError

        try:
            HOSTS.warm_up()
        except HostError as error:  # tried again at each planning, which then says why
            rospy.logerr("%s: %s", self.scope, error)
        from merlin_pddl.checks import kairos_check  # while that process starts

        if self._preview and not kairos_check.available():
            self._warn(
                "kairos is not installed: our reader checks PDDL, and plans are carried out on paper; "
                "trajectory constraints, preferences, processes and events are not looked at"
            )
            from merlin_rosplan.planning.planner_engines import PlannerCommandError, engines

            try:
                self._warn(
                    engines(self._request_of_params().planner_command, self._settings.fallback).warning
                )
            except PlannerCommandError as error:
                rospy.logerr("%s: %s", self.scope, error)

    def on_shutdown(self) -> None:
        """Kills the planner that runs."""
        with self._state:
            current = self._current
            self._state.notify_all()
        if current is not None:
            current.cancel()
        with contextlib.suppress(OSError):
            self._folder.cleanup()

    def health(self) -> Health:
        """What the planner does; a warning when planner or input made the last planning fail."""
        with self._state:
            busy, last = self._current is not None, self._last
        if last is None:
            return Health(OK, "planning" if busy else "nothing planned yet")
        fault = last.state in (PlannerState.CRASHED, PlannerState.INVALID, PlannerState.TIMEOUT)
        values = {"last": last.state.name, "planner": last.planner, "seconds": f"{last.seconds:.3f}"}
        return Health(WARN if fault else OK, last.reason if fault else "planning" if busy else "idle", values)

    # --- requests ---------------------------------------------------------------------------------

    @functools.cached_property
    def _preview(self) -> "PreviewService":
        from merlin_rosplan.nodes.preview_service import PreviewService

        return PreviewService(self, self._settings, self._request_of_params)

    def _read_settings(self) -> PlannerSettings:
        return PlannerSettings(
            fallback=self.flag("planner_fallback", True),
            time_limit=self.number("time_limit", 60.0, 0.0),
            anytime=self.number("anytime", 0.2, 0.0),
            check_input=self.flag("check_input", True),
            memory_limit=self.number("memory_limit", 4096.0, 0.0),
            output_limit=self.number("output_limit", 64.0, 0.0),
        )

    def _request_of_params(self) -> PlanningServiceRequest:
        # All in one look-up: each costs a call to the master.
        values = get_param(self.scope, {})
        return PlanningServiceRequest(
            use_problem_topic=bool(values.get("use_problem_topic", False)),
            domain_path=str(values.get("domain_path", "")) or self._domain_of_knowledge_base(),
            problem_path=str(values.get("problem_path", "")),
            data_path=str(values.get("data_path", "")),
            planner_command=str(values.get("planner_command", "")),
        )

    def _serve(self, _: EmptyRequest) -> EmptyResponse:
        outcome = self._plan(_Wish(self._request_of_params(), self._settings))
        self._log(outcome)
        if not outcome.solved:
            raise rospy.ServiceException(f"{outcome.state.name}: {outcome.reason}")
        return EmptyResponse()

    def _serve_params(self, request: PlanningServiceRequest) -> PlanningServiceResponse:
        outcome = self._plan(_Wish(request, self._settings))
        self._log(outcome)
        return PlanningServiceResponse(plan_found=outcome.solved)

    def _execute(self, goal: ServerGoal) -> None:
        feedback = PlanFeedback(current_phase="planning", current_status="RUNNING")
        self._end(goal, goal.goal, PlanResult, self._settings, feedback)

    def _execute_without(self, goal: ServerGoal) -> None:
        feedback = PlanWithoutFeedback(current_phase="planning", current_status="RUNNING")
        wanted = goal.goal
        after = tuple(wanted.after) if wanted.after or wanted.further else None
        settings = dataclasses.replace(
            self._settings, without=tuple(wanted.without), dues=dues_of(wanted.deadlines)
        )
        self._end(goal, wanted.plan, PlanWithoutResult, settings, feedback, after)

    def _end(
        self,
        goal: ServerGoal,
        wanted: PlanGoal,
        result_class: Type[Any],
        settings: PlannerSettings,
        feedback: Any,
        after: Optional[Sequence[str]] = None,
    ) -> None:
        """Plans for a goal and answers it.

        :param feedback: is published when the planner works.
        :param after: as of :class:`_Wish`.
        """
        request: Any = wanted  # has the same fields
        if not (wanted.domain_path or wanted.problem_path or wanted.use_problem_topic):
            request = self._request_of_params()
        outcome = self._plan(_Wish(request, settings, goal, after, lambda: goal.feedback(feedback)))
        result = result_class(result_status=outcome.state.name)
        if outcome.reached:
            result.reached = list(outcome.reached)
        text = outcome.reason
        if outcome.solved:
            goal.succeed(result, text)
        elif outcome.state == PlannerState.CANCELLED:
            goal.cancelled(result, text)
        else:
            goal.abort(result, f"{outcome.state.name}: {text}")
        self._log(outcome)  # behind the answer: a line of a log costs half a millisecond

    def _cancel(self, goal: ServerGoal) -> None:
        with self._state:
            # Only a planning that this action's goal started: the services' callers did not ask for a cancel.
            current = self._current if self._current_goal == goal.id else None
            self._state.notify_all()  # it may wait for its turn
        if current is not None:
            current.cancel()

    # --- planning ---------------------------------------------------------------------------------

    def _receive_problem(self, message: String) -> None:
        with self._state:
            self._problem = message.data
            self._state.notify_all()

    def _plan(self, wish: _Wish) -> PlanningOutcome:
        with self._state:
            self._state.wait_for(lambda: not self._plans or wish.cancelled)
            if self._plans:
                return PlanningOutcome(PlannerState.CANCELLED, NOT_BEGUN)
            self._plans = True
        try:
            outcome = self._plan_one(wish)
            with self._state:
                self._last = outcome
        finally:
            with self._state:
                self._plans = False
                self._state.notify_all()
        self._report(PlannerStatus(**outcome.status))
        return outcome

    def _log(self, outcome: PlanningOutcome) -> None:
        log = (
            rospy.loginfo if outcome.state in (PlannerState.SOLVED, PlannerState.CANCELLED) else rospy.logerr
        )
        log(
            "%s: %s by %s in %.3f s: %s",
            self.scope,
            outcome.state.name,
            outcome.planner or "no planner",
            outcome.seconds,
            outcome.reason,
        )

    def _plan_one(self, wish: _Wish) -> PlanningOutcome:
        request, after = wish.request, wish.after
        problem_path = request.problem_path
        if request.use_problem_topic:
            try:
                problem_path = self._write_problem(problem_path)
            except (OSError, ValueError) as error:
                return PlanningOutcome(PlannerState.INVALID, str(error))
        domain_path = request.domain_path or self._domain_of_knowledge_base()
        for name, path in (("domain", domain_path), ("problem", problem_path)):
            if not path:
                return PlanningOutcome(PlannerState.INVALID, f"no {name}: {name}_path is empty")
            if not self._strict and not os.path.exists(path):
                # As ROSPlan: the call succeeds and nothing is published.
                return PlanningOutcome(
                    PlannerState.SOLVED, f"there is no file {path[:200]} (~strict is false)"
                )
        if after:
            from merlin_rosplan.supervision.plan_preview import LATER_ERRORS, write_later_problem

            try:
                later = os.path.join(self._folder.name, "later.pddl")
                _write(later, write_later_problem(domain_path, problem_path, after))
                problem_path = later
            except LATER_ERRORS as error:
                return PlanningOutcome(PlannerState.INVALID, f"what runs cannot be planned after: {error}")
        from merlin_rosplan.supervision.supervised_planning import Planning

        settings = dataclasses.replace(wish.settings, command=request.planner_command)
        planning = Planning(settings, domain_path, problem_path, self._data_folder(request.data_path))
        with self._state:
            self._current = planning
            self._current_goal = wish.goal.id if wish.goal is not None else None
        # A cancel before this point found no planning to kill.
        if self.closed or wish.cancelled:
            planning.cancel()

        def begun() -> None:
            wish.on_begin()
            self._report(PlannerStatus(state=PlannerStatus.RUNNING, reason=f"planning {problem_path}"))

        try:
            outcome = planning.run(begun)
        finally:
            with self._state:
                self._current = self._current_goal = None
        self._warn(planning.warning)
        if outcome.solved:
            from merlin_pddl.plan_text import AFTER

            # One line, whatever the texts are: the parser numbers such a plan's actions on.
            heading = "" if after is None else f"{' '.join([AFTER, *' '.join(after).split()])}\n"
            message = String(heading + outcome.plan)
            self._hand_over.hand_over(message)
            self._output.publish(message)
        return outcome

    def _warn(self, warning: Optional[str]) -> None:
        if warning is not None and warning not in self._warned:
            self._warned.add(warning)
            rospy.logwarn("%s: %s", self.scope, warning)

    def _write_problem(self, problem_path: str) -> str:
        """Writes the problem received on the topic to a file, as ROSPlan does; returns its path."""
        self._problems.catch_up()
        with self._state:
            # A caller that asks right after the problem was published must not lose the race.
            self._state.wait_for(lambda: self._problem is not None or self.closed, timeout=0.5)
            problem = self._problem
        if problem is None:
            raise ValueError(f"no problem was received on {self._problem_topic}")
        # Not pathlib, as in Planning.
        path = problem_path or os.path.join(self._folder.name, "problem.pddl")
        try:
            if problem_path:
                replace_file(path, problem)
            else:
                # Read by one planning after the other. To replace a file, ext4 writes the disk: 1 to 10 ms.
                with contextlib.suppress(FileNotFoundError):
                    os.unlink(path)
                _write(path, problem)
        except OSError as error:  # also when the folder of this process goes away with its end
            what = error.strerror or error
            raise ValueError(f"{self.scope} ends, or cannot write the problem to {path}: {what}") from error
        return path

    def _data_folder(self, data_path: str) -> Optional[str]:
        if data_path and not os.path.isdir(data_path):
            rospy.logwarn(
                "%s: data_path %s is not a folder: the planner's output is not kept", self.scope, data_path
            )
            return None
        return data_path or None

    def _domain_of_knowledge_base(self) -> str:
        path = get_param(f"{self.knowledge_base}/domain_path", "")
        return str(path or get_param("/rosplan/domain_path", ""))

    def _report(self, status: PlannerStatus) -> None:
        status.header.stamp = rospy.Time.now()
        publish(self._status, status)


def _write(path: str, text: str) -> None:
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)
