# SPDX-License-Identifier: Apache-2.0
"""Exchanges the plan of a run while its actions go on: for newcomers that join, and for one that leaves.

For newcomers the new plan follows all that runs. When one leaves, those of the running actions go on that a
plan for the others would have, too; where that are none, or no plan can be asked for, the run is stopped and
planned again. A leave ends the look for a plan with newcomers, which are tried again behind it.
"""

import threading
from functools import partial
from time import monotonic
from typing import TYPE_CHECKING, Any, Callable, Dict, List, Sequence

import rospy
from merlin_msgs.msg import PlannerStatus, RunningAction

from merlin_executor.core.agenda import Refusal
from merlin_executor.core.engine import Engine
from merlin_executor.core.outcome import LONGEST_REASON
from merlin_executor.core.standstill import MOVES
from merlin_executor.node.own_goals import OwnGoals
from merlin_executor.node.request import Request, goals_of
from merlin_pddl.plan_text import call_text
from merlin_pddl.text_reader import shortened
from merlin_planning.knowledge_text import step_text, to_pddl
from merlin_planning.planning_client import MASTER, Planned, StageError
from merlin_ros.alarms import call_later
from merlin_ros.call_scope import CallScope
from merlin_ros.master.master_link import master_answers
from merlin_ros.work.threads import CallQueue, failure_text
from merlin_sm.states.merlin_state import SUCCEEDED
from merlin_sm.states.planning import CALL_GRACE, PlanningState

if TYPE_CHECKING:
    from merlin_executor.node.joint_run import JointRun, PlanningSystem

JOIN_LIMIT = 10.0  # s of wall time for a plan with newcomers; then they wait
TOO_LONG = "no plan for all was found in time"
TOO_LATE = "its deadline is before the end of what runs"
TRIES = 2
GATHER = 0.02  # s of wall time for others to leave, too: where all do, nothing is to be planned


class PlanRevision(PlanningState):
    """Revises the plan of one run, in a thread of its own, while that is dispatched. A preempt ends that.

    :param run: its requests.
    :param requests: knows the requests that the plan should be for, and takes note of those that it is for.
    """

    def __init__(
        self, run: "JointRun", system: "PlanningSystem", own: OwnGoals, requests: Engine[Request]
    ) -> None:
        super().__init__()
        self._run = run
        self._knowledge, self._planning = system.knowledge, system.planning
        self._dispatcher, self._system = system.dispatcher, system
        self._own = own
        self._requests = requests
        self._calls_put = CallQueue("another plan").put
        self._limits = CallQueue("limit of another plan")
        self._working = threading.Lock()  # held by the thread that revises; guards the field below
        self._comes_late = False  # whether it is proven that not all that are wanted would be in time
        self._turn = threading.Lock()  # guards the fields below, and that a preempt is for what is wanted
        self._wanted: List[Request] = []
        self._leave_by: Dict[str, float] = {}  # by id of those that leave; monotonic
        self._changed = threading.Condition()  # notified when an action has ended, or nothing is waited for
        self._closed = False

    def open(self) -> None:
        """The plan is about to be dispatched."""
        self._closed = False
        if self._requests.revision():  # of one that came since the plan was made
            self.ask()

    def ask(self) -> bool:
        """Has the plan exchanged; False: that is not possible. From any thread, never blocks."""
        left = [request for request in self._run.requests if request.stop is None]
        if self._closed or not left or not self._dispatcher.can_exchange:
            return False
        leaving = [request for request in self._run.requests if request.stop is not None]
        if not leaving:
            self._calls_put(self._work)
            return True
        if self._run.request in leaving:  # its client may end before it has left: nothing would move then
            self._dispatcher.hand_over(left[0].goal.id)
        with self._turn:
            for request in leaving:
                self._leave_by.setdefault(request.goal.id, monotonic() + self._system.leave_limit)
            joins = self._joins()
            if joins:
                self.request_preempt()
        if joins:  # what it waits for may hang
            late = partial(self._stays, leaving, left)
            call_later(self._system.leave_limit, partial(self._limits.put, late))
        call_later(GATHER, partial(self._calls_put, self._work))
        return True

    def close(self) -> None:
        """The dispatch has ended. Waits for what is under way, each step of which has a limit."""
        self._closed = True
        self.request_preempt()
        with self._working:
            wanted = self._requests.revision()
        if wanted:
            self._requests.revised(wanted, Refusal())

    def dispatch_changed(self) -> None:
        """An action has begun or ended; from any thread."""
        with self._changed:
            self._changed.notify_all()

    # --- in the thread that revises -----------------------------------------------------------------

    def _work(self) -> None:
        with self._working:
            tries, before = 0, self._wanted
            while self._next():
                # The client of one that leaves may end before that has left.
                self._dispatcher.hand_over(self._wanted[0].goal.id)
                tries = tries + 1 if self._wanted == before else 1
                before = self._wanted
                try:
                    done = self.execute(None) == SUCCEEDED or self._closed
                except Exception as error:  # the one that leaves waits for what runs to be stopped
                    done = False
                    self.give_up(failure_text(error))
                if not done and (tries == TRIES or self.given_up):
                    rospy.loginfo(f"the plan is not exchanged: {self.reason}")
                    reason = shortened(self.reason, LONGEST_REASON)
                    self._requests.revised(self._wanted, Refusal(reason, self._comes_late))

    def _next(self) -> List[Request]:
        """Takes the requests that are wanted now; none: there is nothing to do."""
        with self._turn:
            self._wanted = []
            self.service_preempt()
        wanted = [] if self._closed else self._requests.revision()
        with self._turn:
            self._wanted = wanted
            if self._joins() and any(request.stop is not None for request in self._run.requests):
                self.request_preempt()  # that came since the revision was asked
        return wanted

    def _joins(self) -> bool:
        """Whether what is worked on has newcomers."""
        return any(request not in self._run.requests for request in self._wanted)

    def _left_to_leave(self) -> float:
        """Returns s until the first of those that leave has to have left, whatever it has waited for."""
        now, limit = monotonic(), self._system.leave_limit
        with self._turn:
            here = [request.goal.id for request in self._run.requests]
            self._leave_by = {each: self._leave_by[each] for each in here if each in self._leave_by}
            return max(0.0, min(self._leave_by.values(), default=now + limit) - now)

    def run(self, userdata: Any) -> str:
        """Exchanges the plan for one for the requests that are wanted."""
        wanted, self._comes_late = self._wanted, False
        parts = all(request in self._run.requests for request in wanted)
        limit = self._left_to_leave() if parts else JOIN_LIMIT
        alarm = call_later(limit, partial(self._limits.put, self._late, wanted))
        try:
            if parts and not master_answers(limit / 2.0):  # the other half is for the plan
                self.given_up = True
                raise StageError(f"{MASTER} does not answer", gone=True)
            # A plan that is parsed before would be taken for the one that is to be dispatched.
            self._wait_for(lambda: self.preempt_requested() or self._dispatcher.begun)
            dropped = self._exchange(wanted, parts)
        except Exception as error:  # whatever it is, the one that leaves gets its answer
            if not parts:
                with CallScope(CALL_GRACE):
                    self._run.expect([])
            return self.fail_stage(error) if isinstance(error, StageError) else self.fail(str(error))
        finally:
            alarm.cancel()
        ids = {each.action_id for each in dropped}
        # The dispatch fails when what the new plan lacks does not stop in time.
        self._wait_for(lambda: not ids & {each.action_id for each in self._dispatcher.running})
        if dropped and self._closed:
            return self.fail("the dispatch has ended")
        hangs = [text for text in map(step_text, dropped) if text in self._dispatcher.unstopped]
        if hangs or (dropped and not self._system.guard.wait_left()):
            self.given_up = True
            return self.fail(f"{', '.join(hangs)} did not stop" if hangs else MOVES)
        self._run.go_on(lambda: self._requests.revised(wanted))
        return SUCCEEDED

    def _wait_for(self, fits: Callable[[], bool]) -> None:
        """Waits for a change of the dispatch, or its end."""
        self.interruptible(self.dispatch_changed)
        with self._changed:
            self._changed.wait_for(lambda: self._closed or fits())
        self.interruptible(None)

    def _late(self, wanted: List[Request]) -> None:
        with self._turn:
            if self._wanted is not wanted:  # it has just ended
                return
            self.request_preempt()
        self._requests.revised(wanted, Refusal(TOO_LONG))

    def _stays(self, leaving: List[Request], left: List[Request]) -> None:
        """The limit for a leave is over; where it still waits for the end of a join, it stops the run."""
        with self._turn:
            joins = self._joins()
        if joins and not self._closed and any(request in self._run.requests for request in leaving):
            self._requests.revised(left, Refusal(TOO_LONG))

    def _exchange(self, wanted: List[Request], parts: bool) -> List[RunningAction]:
        """Returns the actions that are stopped; raises StageError and what its calls raise."""
        run, running = self._run, self._dispatcher.running
        if not self._dispatcher.begun:
            raise StageError("the dispatch has not begun, or has ended")
        kept = self._needed(running, wanted) if parts else running
        if running and not kept:
            self.given_up = True
            raise StageError("what runs is not needed by the others")
        if not parts:
            run.expect(wanted)
        items = goals_of(wanted)
        self._own.keep(items)
        there = {to_pddl(goal).lower() for goal in self._knowledge.goals()}
        self._own.add([item for item in items if to_pddl(item).lower() not in there])
        ids = {action.action_id for action in running}
        known = ids | self._dispatcher.ended  # the problem knows of these
        self._planning.generate_problem()
        limited = [r for r in wanted if r.window.is_limited and (r not in run.requests or not r.outlook.late)]
        begin = max(rospy.get_time(), run.request.end_of(kept))
        late = [r for r in limited if r not in run.requests and r.window.deadline < begin]
        if not all(all(self._knowledge.query(request.items)) for request in late):
            self.given_up = self._comes_late = True
            raise StageError(TOO_LATE)  # a plan that begins behind its deadline knows only the time to zero
        deadlines = [request.due(begin) for request in limited]
        after = list(map(step_text, kept))
        found = self._planning.plan(self.interruptible, run.course.without, after, deadlines)
        if found.verdict is not Planned.SOLVED:
            self.given_up = self._comes_late = found.verdict is Planned.LATE
            raise StageError(found.reason or found.verdict.value)
        plan = self._planning.parse_plan()
        if self._requests.revision() != wanted:
            raise StageError("other requests are wanted meanwhile")
        begun = self._dispatcher.running
        new = {step_text(each).lower(): each.action_id for each in begun if each.action_id not in known}
        for step in plan:  # the dispatcher has these go on as its first steps
            step.action_id = new.pop(step_text(step).lower(), step.action_id)
        refused = self._dispatcher.exchange(plan, kept, known)
        if refused:
            raise StageError(refused)
        kept_ids = {action.action_id for action in kept}
        before = [step for step in run.request.plan if step.action_id in kept_ids]
        reached = dict(zip(limited, found.reached))
        for request in wanted:
            request.take_plan([*before, *plan], kept, reached.get(request))
        return [action for action in running if action.action_id not in kept_ids]

    def _needed(self, running: Sequence[RunningAction], wanted: Sequence[Request]) -> List[RunningAction]:
        """Those of the running actions that a plan for these requests has that begins where they began.

        :raises StageError: the planner did not find that out.
        """
        if not running:
            return []
        with CallScope() as calls:  # nothing is lost when it ends at once
            self.interruptible(calls.end)
            answer = self._planning.preview(
                goals=[text for request in wanted for text in request.texts],
                without=self._run.course.without,
                facts=[literal for action in running for literal in self._undone(action)],
                urgent=True,
            )
            self.interruptible(None)
        if answer.status.state not in (PlannerStatus.SOLVED, PlannerStatus.UNSOLVABLE):
            raise StageError(answer.status.reason or "no plan of the others was found")
        steps = {step.lower() for step in answer.actions}
        return [action for action in running if step_text(action).lower() in steps]

    def _undone(self, action: RunningAction) -> List[str]:
        """What its start effects have changed, as it was before."""
        operator = self._knowledge.operator(action.name)
        objects = {parameter.key: parameter.value for parameter in action.parameters}

        def ground(formula: Any) -> str:
            return call_text(formula.name, [objects.get(p.key, p.key) for p in formula.typed_parameters])

        return [
            *map(ground, operator.at_start_del_effects),
            *(f"(not {ground(formula)})" for formula in operator.at_start_add_effects),
        ]
