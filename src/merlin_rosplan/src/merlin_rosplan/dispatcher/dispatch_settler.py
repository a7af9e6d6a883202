# SPDX-License-Identifier: Apache-2.0
"""Settles what actions have left open in the knowledge base whose interfaces have died without an answer."""

import threading
from typing import Callable, Optional, Sequence

import rospy

from merlin_planning.execution_journal import ExecutionJournal
from merlin_ros.deadline import Deadline
from merlin_ros.service_proxy import ServiceError
from merlin_ros.work.threads import start_thread
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction

CALL_LIMIT = 10.0  # s of wall time for one call of the knowledge base
#: s of running time after which an interface that lives is left to settle its execution itself
PATIENCE = 60.0
LOOK = 1.0  # s of wall time between two looks; what watches the interfaces takes fewer for a stall
RETRY = 1.0  # s of wall time until a knowledge base that does not answer is asked again


class DispatchSettler:
    """Closes executions of unanswered actions (INTERRUPT), once their interfaces are silent.

    An interface that lives, or comes back, settles its executions itself: a second INTERRUPT changes nothing.

    :param knowledge_base: its global name.
    :param silence: s since the last announcement of an operator's interface; None: never announced.
    :param liveness: s of silence after which it is dead; None: never.
    """

    def __init__(
        self, knowledge_base: str, silence: Callable[[str], Optional[float]], liveness: Optional[float]
    ) -> None:
        self._silence = silence
        self._liveness = liveness
        self._closed = threading.Event()
        self._journal = ExecutionJournal(knowledge_base, CALL_LIMIT)

    def settle(self, plan_id: int, actions: Sequence[PlannedAction]) -> None:
        """Settles each of the actions, in a thread of its own that ends after PATIENCE."""
        for action in actions:
            start_thread(f"settle {action}", self._follow, plan_id, action)

    def shutdown(self) -> None:
        """Ends the threads."""
        self._closed.set()

    def _follow(self, plan_id: int, action: PlannedAction) -> None:
        patience = Deadline(PATIENCE)
        while not patience.expired:
            wait = self._until_dead(action.name)
            if wait <= 0:
                try:
                    self._interrupt(f"{plan_id}/{action.id}/", str(action))
                    return
                except ServiceError as error:
                    rospy.logwarn("the execution of %s is still open: %s", action, error)
                    wait = RETRY
            if self._closed.wait(min(wait, LOOK, patience.remaining() + 0.01)):
                return

    def _until_dead(self, operator: str) -> float:
        """s of silence until the interface counts as dead; zero or less: it does now."""
        silence = self._silence(operator)
        if silence is None:
            return 0.0
        return PATIENCE if self._liveness is None else self._liveness - silence

    def _interrupt(self, prefix: str, text: str) -> None:
        """Closes what is open of an action.

        :raises ServiceError: when the knowledge base does not answer.
        """
        if not self._journal.offered():
            return  # the original ROSPlan: its interfaces apply effects by themselves
        for execution in self._journal.open():
            if not execution.token.startswith(prefix):
                continue
            refused = self._journal.interrupt(execution)
            if refused:
                rospy.logerr("the execution of %s cannot be closed: %s", text, refused)
            else:
                rospy.logwarn("%s is interrupted in the knowledge base: its interface is gone", text)
