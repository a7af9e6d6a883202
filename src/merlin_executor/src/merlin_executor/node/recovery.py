# SPDX-License-Identifier: Apache-2.0
"""Brings the planning system to rest before anything is planned: no dispatch runs, no execution is open."""

import threading
from typing import Collection, Dict, FrozenSet, List, NamedTuple, Optional

import rospy
from merlin_msgs.msg import KnowledgeChanges, OpenExecution

from merlin_planning.dispatch_client import DispatchClient
from merlin_planning.execution_journal import ExecutionJournal, execution_text
from merlin_planning.knowledge_client import KnowledgeClient
from merlin_planning.planning_client import Interruptible
from merlin_ros.deadline import running_time
from merlin_ros.late_topics import subscribe
from merlin_ros.master.master_link import MasterSilent
from merlin_ros.service_proxy import ServiceError

CALL_LIMIT = 5.0  # s of wall time for one call
#: s of running time that the bridges have to settle their executions themselves.
BRIDGE_GRACE = 5.0
#: How often the Executor tries to settle one.
ATTEMPTS = 3
LOOK = 0.5  # s between two looks for executions that were closed without a change of the knowledge


class Recovery:
    """Settles what an earlier Executor, dispatcher or bridge has left.

    Used by one thread; :meth:`meanwhile` by any.

    Over the original ROSPlan, which keeps no journal of executions, only a running dispatch is looked for.

    :param knowledge: with the journal.
    :param dispatcher: of the plans.
    """

    def __init__(self, knowledge: KnowledgeClient, dispatcher: DispatchClient) -> None:
        self._knowledge = knowledge
        self._dispatcher = dispatcher
        self._journal = ExecutionJournal(knowledge.name, CALL_LIMIT)
        self._has: Optional[bool] = None  # whether there is a journal; None: not known yet

    def rest(self, interruptible: Interruptible, longest: Optional[float] = None) -> str:
        """Waits until the planning system is at rest. The interruption ends the wait.

        :param longest: s of running time for a plan to stop that is cancelled without a limit; None: none.
        :return: why it is not, as a sentence; empty when it is.
        :raises ServiceError: when the journal does not answer.
        """
        busy = self._dispatcher.free(interruptible, longest)
        if busy or not self._has_journal():
            return busy
        if not self._journal.open():  # as always but after a fault
            return ""
        woken, interrupted = threading.Event(), threading.Event()

        def interrupt() -> None:
            interrupted.set()
            woken.set()

        changes = f"{self._knowledge.name}/changes"
        subscriber = None
        try:
            subscriber = subscribe(changes, KnowledgeChanges, lambda _: woken.set())
        except MasterSilent as error:  # it looks now and then anyway
            rospy.logwarn(str(error))
        interruptible(interrupt)
        try:
            return self._settle(woken, interrupted)
        finally:
            interruptible(None)
            if subscriber is not None:
                subscriber.unregister()

    def meanwhile(self) -> Optional[FrozenSet[str]]:
        """Literals that hold only while an execution is open, as PDDL text; None: there is no journal.

        :raises ServiceError: when the journal does not answer.
        """
        if not self._has_journal():
            return None
        return frozenset(text for execution in self._journal.open() for text in execution.meanwhile)

    def _settle(self, woken: threading.Event, interrupted: threading.Event) -> str:
        leftovers = Leftovers()
        why = ""
        while not interrupted.is_set() and not rospy.is_shutdown():
            woken.clear()
            found = {execution.token: execution for execution in self._journal.open()}
            look = leftovers.look(running_time(), found)
            for token in look.settle:
                why = self._interrupt(found[token])
            if look.done:
                names = ", ".join(execution_text(found[token]) for token in look.stuck)
                return f"{names} was begun and cannot be settled: {why}" if names else ""
            if not look.settle:
                woken.wait(min(look.wait, LOOK))
        return ""

    def _interrupt(self, execution: OpenExecution) -> str:
        """Settles one execution; returns why that failed."""
        rospy.logwarn(
            f"{execution_text(execution)} of {execution.owner} was left open; it is settled as interrupted"
        )
        try:
            return self._journal.interrupt(execution)
        except ServiceError as error:
            return str(error)

    def _has_journal(self) -> bool:
        if self._has is None:
            there = self._journal.available()
            if there or self._knowledge.wait(0.0):  # a knowledge base that is gone says nothing about it
                self._has = there
            return there
        return self._has


class Look(NamedTuple):
    """What a look at the journal asks for."""

    settle: List[str]
    """Tokens of the executions to settle now."""
    wait: float
    """s until the next look at the latest; 0 with nothing to settle: everything is put right, or given up."""
    stuck: List[str]
    """Tokens of the executions that cannot be settled."""

    @property
    def done(self) -> bool:
        """Whether nothing is left to wait for."""
        return not self.settle and self.wait <= 0.0


class Leftovers:
    """Decides about the open executions in one recovery: which are settled, and when.

    One that is open while no plan is dispatched belongs to a bridge that was ended. The bridge that comes
    back settles it (docs/reliability.md); where none comes, the Executor does.
    """

    def __init__(self) -> None:
        self._since: Dict[str, float] = {}
        self._tried: Dict[str, int] = {}

    def look(self, now: float, open_tokens: Collection[str]) -> Look:
        """Looks at the journal.

        :param now: s of running time.
        :param open_tokens: of the executions that are open now, oldest first.
        """
        self._since = {token: self._since.get(token, now) for token in open_tokens}
        due = [token for token in open_tokens if now - self._since[token] >= BRIDGE_GRACE]
        settle = [token for token in due if self._tried.get(token, 0) < ATTEMPTS]
        stuck = [token for token in due if token not in settle]
        for token in settle:
            self._tried[token] = self._tried.get(token, 0) + 1
        waiting = [BRIDGE_GRACE - (now - self._since[token]) for token in open_tokens if token not in due]
        return Look(settle, min(waiting, default=0.0), stuck)
