# SPDX-License-Identifier: Apache-2.0
"""The Executor's own stages: at rest, goals in, dispatched, again, goals out. The state factory makes them.

They carry out; what their ends mean is decided in :mod:`merlin_executor.core.course` and
:mod:`merlin_executor.core.replanning`.
"""

import threading
from typing import TYPE_CHECKING, Any, Callable, Sequence

import rospy

import smach
from merlin_executor.core.course import ACHIEVED_MEANWHILE
from merlin_executor.core.outcome import Outcome, Verdict
from merlin_executor.node.joint_run import LOOK_LIMIT, PlanningSystem
from merlin_executor.node.own_goals import OwnGoals
from merlin_executor.node.request import ends_by
from merlin_planning.dispatch_client import PART as DISPATCHER
from merlin_planning.dispatch_progress import unmet_reason
from merlin_planning.knowledge_client import KnowledgeError
from merlin_planning.knowledge_text import to_pddl
from merlin_planning.planning_client import Planned, StageError
from merlin_ros.call_scope import CallScope
from merlin_ros.deadline import Deadline, running_time
from merlin_ros.service_proxy import ServiceError, ServiceUnavailable
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED
from merlin_sm.states.planning import (
    FAILED,
    NO_PLAN,
    UNSOLVABLE,
    DispatchPlanState,
    PlanningState,
    PlanState,
)

if TYPE_CHECKING:
    from merlin_executor.node.executor_sm import ExecutorSM

ALREADY_TRUE = "already_true"
REFUSED = "refused"
HOLDS_ALREADY = "the goal holds already"
EXHAUSTED = "exhausted"
LATE = "late"
ROBOT_BACK = "robot_back"
KNOWLEDGE_BASE = "the planning system's knowledge base"
GOALS_GONE = "its goals were removed from the knowledge base: this executor was silent, or another client did"


def _of_knowledge_base(error: ServiceError) -> StageError:
    return StageError(f"{KNOWLEDGE_BASE}: {error}", gone=isinstance(error, ServiceUnavailable))


class Settle(PlanningState):
    """Waits until the planning system is idle: no plan is made on knowledge that still changes."""

    def __init__(self, system: PlanningSystem) -> None:
        super().__init__()
        self._system = system

    def run(self, userdata: Any) -> str:
        """Looks, and waits where something is left."""
        try:
            trouble = self._system.recovery.rest(self.interruptible)
        except ServiceError as error:
            return self.fail_stage(_of_knowledge_base(error))
        if self.preempt_requested():
            return PREEMPTED
        if not trouble:
            return SUCCEEDED
        self.gone = not self._system.dispatcher.available()  # then its return is waited for
        return self.fail(trouble)


class AddGoals(PlanningState):
    """Adds the goals that are not stored yet; ends with already_true when all of them hold, with refused when
    the knowledge base does not take one.

    Of several requests those end here whose goals hold.
    """

    def __init__(self, system: PlanningSystem, own: OwnGoals, run: "ExecutorSM") -> None:
        super().__init__([ALREADY_TRUE, REFUSED])
        self._system = system
        self._own = own
        self._run = run

    def run(self, userdata: Any) -> str:
        """Adds the goals that the knowledge base does not have."""
        run, again = self._run.run, self._run.course.is_replan
        self._system.planning.read_ahead()
        try:
            # What an earlier request, or one that has ended meanwhile, could not remove.
            self._own.keep(run.items if again else [])
            holding = run.holding()
            if all(request in holding for request in run.requests):  # some may have ended meanwhile
                self.reason = HOLDS_ALREADY
                return ALREADY_TRUE
            achieved = Verdict(Outcome.SUCCEEDED, ACHIEVED_MEANWHILE)
            run.end(holding, achieved if again else Verdict(Outcome.ALREADY_TRUE, HOLDS_ALREADY))
            present = {to_pddl(goal).lower() for goal in self._system.knowledge.goals()}
            missing = [item for item in run.items if to_pddl(item).lower() not in present]
            try:
                self._own.add(missing)
            except KnowledgeError as error:  # an object of one of them may have gone since it was sent
                self.reason = str(error)
                return REFUSED
        except ServiceError as error:
            return self.fail_stage(_of_knowledge_base(error))
        except (KnowledgeError, OSError) as error:
            return self.fail(str(error))
        return SUCCEEDED


class PlanInTime(PlanState):
    """Plans. Where that plan ends after a deadline, the planner has to find one in time, or proves that
    there is none: late. robot_back: it found none, and a robot whose host was gone is back.
    """

    def __init__(self, system: PlanningSystem, run: "ExecutorSM") -> None:
        super().__init__(system.planning, lambda: run.course.without)
        self.register_outcomes([LATE, ROBOT_BACK])
        self._system = system
        self._run = run

    def run(self, userdata: Any) -> str:
        """Plans, once or twice."""
        run, planning = self._run.run, self._system.planning
        run.reached = {}
        outcome = super().run(userdata)
        if outcome in (UNSOLVABLE, NO_PLAN):
            back = self._system.robots.wait(self.interruptible, run.robots_waited_for)
            return PREEMPTED if self.preempt_requested() else ROBOT_BACK if back else outcome
        limited = [request for request in run.requests if request.window.is_limited and self._system.proves]
        if outcome != SUCCEEDED or not limited:
            return outcome
        if ends_by(planning.plan_text, min(request.window.deadline for request in limited)):
            return outcome
        now = rospy.get_time()
        deadlines = [request.due(now) for request in limited]
        second = planning.plan(self.interruptible, run.course.without, deadlines=deadlines)
        if self.preempt_requested():
            return PREEMPTED
        if second.verdict is Planned.LATE:
            self.reason = second.reason
            return LATE
        run.reached = dict(zip(limited, second.reached))
        return SUCCEEDED  # where it found none, the first plan still is the last one


class Dispatch(DispatchPlanState):
    """Dispatches the plan. A goal that was removed from the knowledge base would count as achieved."""

    def __init__(self, system: PlanningSystem, run: "ExecutorSM") -> None:
        # Of several requests the first one owns the dispatch: while its client is silent, nothing moves.
        super().__init__(
            system.dispatcher, run.take_result, lambda: run.run.request.plan, lambda: run.run.request.goal.id
        )
        self._knowledge = system.knowledge
        self._run = run

    def run(self, userdata: Any) -> str:
        """Dispatches. The goals of the requests count: not those of a newcomer, nor of another client."""
        revision = self._run.run.revision
        revision.open()
        try:
            outcome = super().run(userdata)
        finally:
            revision.close()
        dispatched = self._run.course.dispatched
        unmet = outcome == FAILED and dispatched.unmet and not dispatched.action
        if outcome != SUCCEEDED and not unmet:
            return outcome
        try:
            items = self._run.run.items
            with CallScope(LOOK_LIMIT):
                answers = self._knowledge.query(items)
        except ServiceError as error:
            return self.fail_stage(_of_knowledge_base(error))
        missing = [to_pddl(item) for item, holds in zip(items, answers) if not holds]
        if not missing:
            self.reason = ""  # that of the dispatcher names goals of a newcomer
            return SUCCEEDED
        if unmet:
            if self.reason == unmet_reason(dispatched.unmet):
                self.reason = unmet_reason(missing)
            return outcome
        self.reason = GOALS_GONE
        return PREEMPTED if self.preempt_requested() else FAILED


class Replan(PlanningState):
    """Plans the goal again where that may help; waits for a planning system that was ended."""

    def __init__(self, system: PlanningSystem, run: "ExecutorSM") -> None:
        super().__init__([EXHAUSTED])
        self._system = system
        self._run = run

    def run(self, userdata: Any) -> str:
        """Decides; waits while a base is held, and before all new plans but the first."""
        course = self._run.course
        end = course.end
        decision = course.replan()
        self.reason = end.reason
        if not decision.again:
            return EXHAUSTED
        cancelled = threading.Event()
        guard = self._system.guard

        def cancel() -> None:
            cancelled.set()
            guard.wake()

        self.interruptible(cancel)
        try:
            guard.wait_released(cancelled.is_set)
            if end.gone and not self._back(cancelled):
                return PREEMPTED if cancelled.is_set() else ABORTED
            self._run.run.plan_again()
            if Deadline(decision.wait).wait_event(cancelled):
                return PREEMPTED
        finally:
            self.interruptible(None)
        rospy.loginfo(f"planning again ({course.replans}): {self.reason}")
        return SUCCEEDED

    def _back(self, cancelled: threading.Event) -> bool:
        """Whether all parts of the planning system run, or return in time."""
        dispatcher, wait = self._system.dispatcher, self._system.return_wait
        absence = self._run.course.absence
        left = absence.lost(running_time(), wait)
        if left is None:
            self.gone = True
            self.reason = (
                f"{self.reason}; lost {absence.losses} times, and not back for {wait:g} s in between"
            )
            return False
        rospy.logwarn(f"{self.reason}; waits {left:.1f} s for its return")
        part = self._system.planning.wait_back(
            left, cancelled, lambda: "" if dispatcher.available() else DISPATCHER
        )
        if part and not cancelled.is_set():
            self.gone = True
            self.reason = f"{self.reason}; {part} did not return within {wait:g} s"
        absence.back(running_time())
        return not part and not cancelled.is_set()


class RemoveGoals(smach.State):
    """Ends every run, whatever happened, and gives the machine its outcome.

    :param outcomes: of the machine.
    :param finish: removes the goals and returns one of them; called also when the run is being preempted.
    """

    def __init__(self, outcomes: Sequence[str], finish: Callable[[], str]) -> None:
        super().__init__(outcomes=outcomes)
        self._finish = finish

    def execute(self, userdata: Any) -> str:
        """Ends the run; SMACH calls it."""
        self.service_preempt()
        return self._finish()


for _name, _state in (
    ("settle", Settle),
    ("add_goals", AddGoals),
    ("plan_in_time", PlanInTime),
    ("dispatch_goals", Dispatch),
    ("replan", Replan),
    ("remove_goals", RemoveGoals),
):
    MerlinStateFactory.register(_name, _state)
