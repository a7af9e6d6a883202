# SPDX-License-Identifier: Apache-2.0
"""The requests of one run: their goals, and the end of each whose goals hold before the plan ends."""

import threading
from typing import Callable, Dict, FrozenSet, List, NamedTuple, Optional, Sequence, Set

import rospy
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_executor.core.course import ACHIEVED_MEANWHILE
from merlin_executor.core.engine import Engine
from merlin_executor.core.outcome import Outcome, Verdict
from merlin_executor.node.guard_client import GuardClient
from merlin_executor.node.own_goals import OwnGoals
from merlin_executor.node.plan_revision import PlanRevision
from merlin_executor.node.recovery import Recovery
from merlin_executor.node.request import Request, goals_of
from merlin_executor.node.robot_return import RobotReturn
from merlin_planning.dispatch_client import DispatchClient
from merlin_planning.knowledge_client import KnowledgeClient, KnowledgeError
from merlin_planning.knowledge_text import to_pddl
from merlin_planning.planning_client import PlanningClient
from merlin_ros.call_scope import CallScope
from merlin_ros.service_proxy import ServiceError
from merlin_ros.work.threads import CallQueue
from merlin_sm.states.planning import CALL_GRACE

LOOK_LIMIT = 2.0  # s of wall time for one look at the knowledge base
_LOOKS = 5  # so often at most the goals are asked again because an action began or ended meanwhile


class PlanningSystem(NamedTuple):
    """The parts of a planning system, and what watches over the robot that it moves."""

    knowledge: KnowledgeClient
    planning: PlanningClient
    dispatcher: DispatchClient
    recovery: Recovery
    guard: GuardClient
    robots: RobotReturn
    return_wait: float
    """s of running time for a part that was ended to return."""
    proves: bool = True
    """Whether a request whose plan is late is planned once more, with its deadline."""
    leave_limit: float = 2.0
    """s of wall time for a plan without a request that leaves a run; then all of that stops."""


class JointRun:
    """One request, or several in one plan: each ends when its own goals hold, the last one with the run.

    With one request nothing is asked that its stages do not ask.

    :param requests: all of one course.
    :param system: carries out the plan.
    :param own: the goals of this Executor.
    :param engine: has all requests; ends those whose goals hold, but the last one.
    """

    def __init__(
        self, requests: Sequence[Request], system: PlanningSystem, own: OwnGoals, engine: Engine[Request]
    ) -> None:
        self.requests = list(requests)
        """Those that have not ended; replaced as a whole."""
        self.course = requests[0].course
        self._system = system
        self._own = own
        self._engine = engine
        self.revision = PlanRevision(self, system, own, engine)
        self.reached: Dict[Request, float] = {}
        """s from the begin of the plan that was made last until goals hold that do so before its end."""
        self.robots_waited_for: Set[str] = set()
        """Whose return this run has waited for already."""
        self._steps_done = 0
        self._looks = CallQueue("goals that hold")
        self._calls: Optional[CallScope] = None  # of a look under way
        self._lock = threading.Lock()  # guards `requests` and the fields below while that changes
        self._expected: List[Request] = []
        self._over = False

    @property
    def request(self) -> Request:
        """The first of them."""
        return self.requests[0]

    @property
    def items(self) -> List[KnowledgeItem]:
        """Their goals, each once."""
        return goals_of(self.requests)

    @property
    def stopped(self) -> bool:
        """Whether one of them is to stop, and the run with it."""
        return any(request.stop is not None for request in self.requests)

    def holding(self) -> List[Request]:
        """Those whose goals hold now.

        :raises ServiceError: when the knowledge base does not answer.
        """
        requests, items = self.requests, self.items
        holds: Dict[str, bool] = dict(zip(map(_key, items), self._system.knowledge.query(items)))
        return [request for request in requests if all(holds.get(_key(item)) for item in request.items)]

    def end(self, requests: Sequence[Request], verdict: Verdict) -> None:
        """Ends requests whose goals hold; those goals leave the knowledge base that no other one needs."""
        with self._lock:
            first = self.requests[0]
            left = [request for request in self.requests if request not in requests] or self.requests[-1:]
            ended = [request for request in self.requests if request not in left]
            if self._over or not ended:
                return
            self.requests = left
            self._keep_goals()
            if ended[0] is first:
                self._system.dispatcher.hand_over(left[0].goal.id)
            self._engine.achieved(ended, verdict)

    def expect(self, newcomers: Sequence[Request]) -> None:
        """These are about to join: only their goals and those of the run may be stored."""
        with self._lock:
            self._expected = list(newcomers)
            self._keep_goals()

    def go_on(self, members: Callable[[], Sequence[Request]]) -> None:
        """Others have joined it, or some have left.

        :param members: has them do so; returns all that run.
        """
        with self._lock:
            self._expected = []
            self.requests = list(members())
        self._looks.put(self.look)

    def _keep_goals(self) -> None:
        try:
            self._own.keep(goals_of([*self.requests, *self._expected]))
        except (KnowledgeError, ServiceError, OSError) as error:  # they are removed with the others
            rospy.logwarn(
                f"goals that are not needed stay in the knowledge base until the plan ends: {error}"
            )

    def dispatch_changed(self) -> None:
        """Looks which goals hold when an action has ended; called by a subscriber, never blocks."""
        done = self._system.dispatcher.steps_done
        if len(self.requests) > 1 and done != self._steps_done:
            self._looks.put(self.look)
        self._steps_done = done
        self.revision.dispatch_changed()

    def plan_again(self) -> None:
        """A further plan is about to be made: those that wait may join."""
        with self._lock:
            self.requests = list(self._engine.planned_again())

    def cancel(self) -> None:
        """Limits the calls of a look and of a revision under way; from any thread."""
        self.revision.request_preempt()
        calls = self._calls
        if calls is not None:
            calls.end(CALL_GRACE)

    def close(self) -> None:
        """The run is over: no request ends by it any more."""
        with self._lock:
            self._over = True

    def look(self) -> None:
        """Ends those whose goals hold now, and not only while an action runs; asks the knowledge base."""
        if self._over or len(self.requests) < 2:
            return
        try:
            with CallScope(LOOK_LIMIT) as self._calls:
                found = self._achieved()
                if found:
                    self.end(found, Verdict(Outcome.SUCCEEDED, ACHIEVED_MEANWHILE))
        except ServiceError as error:  # the end of the next action, or of the plan, says it again
            rospy.logwarn(f"which goals hold is not known now: {error}")

    def _achieved(self) -> List[Request]:
        """Those whose goals hold, and not only while an action runs."""
        for _ in range(_LOOKS):
            meanwhile = self._meanwhile()
            if meanwhile is None:
                return []
            found = [
                request
                for request in self.holding()
                if not any(_atom(to_pddl(item)) in meanwhile for item in request.items)
            ]
            if not found or self._meanwhile() == meanwhile:
                return found
        return []

    def _meanwhile(self) -> Optional[FrozenSet[str]]:
        """Atoms that are as they are only while an action runs; None: not known, as over the original."""
        literals = self._system.recovery.meanwhile()
        if literals is None:
            return None if self._system.dispatcher.running else frozenset()
        return frozenset(map(_atom, literals))


def _key(item: KnowledgeItem) -> str:
    return to_pddl(item).lower()


def _atom(literal: str) -> str:
    """``(not (door_open hall))`` → ``door_open hall``."""
    return literal.lower().replace("(not ", "").strip("() ")
