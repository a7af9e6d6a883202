# SPDX-License-Identifier: Apache-2.0
"""Exchanges the plan of a run while its actions go on: for newcomers that join, and for one that leaves.

For newcomers the new plan follows all that runs. When one leaves, those of the running actions go on that a
plan for the others would have, too; where that are none, the run is stopped and planned again.
"""

import threading
from functools import partial
from typing import AbstractSet, Any, Callable, List, Optional, Sequence

import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import RunningAction

from merlin_executor.core.engine import Engine
from merlin_executor.node.joint_run import JointRun, PlanningSystem, goals_of
from merlin_executor.node.own_goals import OwnGoals
from merlin_executor.node.request import Request
from merlin_planning.knowledge_client import KnowledgeError
from merlin_planning.knowledge_text import action_text, to_pddl
from merlin_planning.planning_client import Planned, StageError
from merlin_ros.alarms import call_later
from merlin_ros.call_scope import CallScope
from merlin_ros.service_proxy import ServiceError
from merlin_ros.work.threads import CallQueue
from merlin_sm.states.planning import CALL_GRACE

JOIN_LIMIT = 10.0  # s of wall time for a plan with newcomers; then they wait
PART_LIMIT = 2.0  # s of wall time for a plan without one that leaves; then the run stops
TRIES = 2
_NOT_NEEDED = "what runs is not needed by the others"


class PlanRevision:
    """Revises the plan of one run, in a thread of its own, while that is dispatched.

    :param run: its requests.
    :param requests: says for which requests the plan should be, and is told for which it is.
    """

    def __init__(
        self,
        run: JointRun,
        system: PlanningSystem,
        own: OwnGoals,
        requests: Engine[Request],
    ) -> None:
        self._run = run
        self._knowledge, self._planning = system.knowledge, system.planning
        self._dispatcher = system.dispatcher
        self._own = own
        self._requests = requests
        self._calls = CallQueue("another plan")
        self._limits = CallQueue("limit of another plan")
        self._working = threading.Lock()  # held by the thread that revises
        self._changed = threading.Condition()  # guards the fields below
        self._closed = self._over = False
        self._interrupt: Optional[Callable[[], None]] = None
        self._scope: Optional[CallScope] = None

    def open(self) -> None:
        """The plan is about to be dispatched."""
        with self._changed:
            self._closed = False
        if self._requests.revision():  # of one that came since the plan was made
            self.ask()

    def ask(self) -> bool:
        """Has the plan exchanged; False: that is not possible. From any thread, never blocks."""
        if self._closed or not self._dispatcher.can_exchange:
            return False
        left = [request for request in self._run.requests if request.stop is None]
        if left:
            # Nothing moves for the first one of before when that leaves because its client is gone.
            self._dispatcher.hand_over(left[0].goal.id)
            self._calls.put(self._work)
        return bool(left)

    def interrupt(self) -> None:
        """Ends what is under way; from any thread, never blocks."""
        with self._changed:
            self._over = True
            scope, interrupt = self._scope, self._interrupt
            self._changed.notify_all()
        if scope is not None:
            scope.end(CALL_GRACE)
        if interrupt is not None:
            interrupt()

    def close(self) -> None:
        """The dispatch has ended. Waits for what is under way, each step of which has a limit."""
        with self._changed:
            self._closed = True
        self.interrupt()
        with self._working:
            wanted = self._requests.revision()
        if wanted:
            self._requests.revised(wanted, False)

    def dispatch_changed(self) -> None:
        """An action has begun or ended; called by a subscriber."""
        with self._changed:
            self._changed.notify_all()

    # --- in the thread that revises -----------------------------------------------------------------

    def _work(self) -> None:
        with self._working:
            tries = 0
            wanted: List[Request] = []
            while not self._closed:
                before, wanted = wanted, self._requests.revision()
                tries = tries + 1 if wanted == before else 1
                if not wanted:
                    return
                why = self._revise(wanted)
                if why and not self._closed and (tries == TRIES or why == _NOT_NEEDED):
                    rospy.loginfo(f"the plan is not exchanged: {why}")
                    self._requests.revised(wanted, False)

    def _revise(self, wanted: List[Request]) -> str:
        """Exchanges the plan for one for these; returns why not, as a sentence."""
        parts = all(request in self._run.requests for request in wanted)
        limit = PART_LIMIT if parts else JOIN_LIMIT
        alarm = call_later(limit, partial(self._limits.put, self._late, wanted))
        try:
            with CallScope(limit) as scope:
                with self._changed:
                    self._over, self._scope = self._closed, scope
                dropped = self._exchange(wanted, parts)
        except (StageError, KnowledgeError, ServiceError, OSError) as error:
            if not parts:
                with CallScope(CALL_GRACE):
                    self._run.expect([])
            return str(error)
        finally:
            alarm.cancel()
            self._scope = None
        with self._changed:
            # The dispatch fails when what the new plan lacks does not stop in time.
            self._changed.wait_for(
                lambda: self._closed or not dropped & {each.action_id for each in self._dispatcher.running}
            )
            if dropped and self._closed:
                return "the dispatch has ended"
        self._run.go_on(lambda: self._requests.revised(wanted, True))
        return ""

    def _late(self, wanted: List[Request]) -> None:
        self.interrupt()
        self._requests.revised(wanted, False)

    def _exchange(self, wanted: List[Request], parts: bool) -> AbstractSet[int]:
        """Returns the ids of the actions that are stopped; raises StageError and what its calls raise."""
        run, running = self._run, self._dispatcher.running
        kept = self._needed(running, wanted) if parts else running
        if running and not kept:
            raise StageError(_NOT_NEEDED)
        if not parts:
            run.expect(wanted)
        items = goals_of(wanted)
        self._own.keep(items)
        there = {to_pddl(goal).lower() for goal in self._knowledge.goals()}
        self._own.add([item for item in items if to_pddl(item).lower() not in there])
        self._planning.generate_problem()
        found = self._planning.plan(self._interruptible, run.course.without, list(map(_text, kept)))
        if found.verdict is not Planned.SOLVED:
            raise StageError(found.reason or found.verdict.value)
        plan = self._planning.parse_plan()
        known = {action.action_id for action in running}
        steps = {action_text(step.name, step.parameters) for step in plan}
        begun = [each for each in self._dispatcher.running if each.action_id not in known]
        if self._requests.revision() != wanted or any(_text(each) not in steps for each in begun):
            raise StageError("the plan went on meanwhile")
        refused = self._dispatcher.exchange(plan, kept, wanted[0].goal.id)
        if refused:
            raise StageError(refused)
        ids = {action.action_id for action in kept}
        before = [step for step in run.request.plan if step.action_id in ids]
        for request in wanted:
            request.take_plan([*before, *plan], kept)
        return known - ids

    def _needed(self, running: Sequence[RunningAction], wanted: Sequence[Request]) -> List[RunningAction]:
        """Those of the running actions that a plan for these requests has that begins where they began."""
        if not running:
            return []
        answer = self._planning.preview(
            goals=[text for request in wanted for text in request.texts],
            without=self._run.course.without,
            facts=[literal for action in running for literal in self._undone(action)],
        )
        steps = {step.lower() for step in answer.actions}
        return [action for action in running if _text(action).lower() in steps]

    def _undone(self, action: RunningAction) -> List[str]:
        """What its start effects have changed, as it was before."""
        operator = self._knowledge.operator(action.name)
        objects = {parameter.key: parameter.value for parameter in action.parameters}

        def ground(formula: Any) -> str:
            return action_text(
                formula.name, [KeyValue(value=objects.get(p.key, p.key)) for p in formula.typed_parameters]
            )

        return [
            *map(ground, operator.at_start_del_effects),
            *(f"(not {ground(formula)})" for formula in operator.at_start_add_effects),
        ]

    def _interruptible(self, interrupt: Optional[Callable[[], None]]) -> None:
        with self._changed:
            self._interrupt, over = interrupt, self._over
        if over and interrupt is not None:
            interrupt()


def _text(action: RunningAction) -> str:
    return action_text(action.name, action.parameters)
