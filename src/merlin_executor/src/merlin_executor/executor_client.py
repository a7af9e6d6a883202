# SPDX-License-Identifier: Apache-2.0
"""MerlinExecutorClient: sends goals to the Executor and takes them back (paper, section 3.2.2)."""

import threading
from typing import Any, Callable, Iterable, List, Optional, Sequence, Tuple, Union

import rospy
from merlin_msgs.msg import ExecuteAction, ExecuteFeedback, ExecuteGoal, ExecuteResult
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_executor.core.outcome import outcome_name
from merlin_executor.core.request_limits import (
    ON_CLIENT_LOST,
    ON_INTERRUPT,
    check_choice,
    check_priority,
    check_size,
    check_value,
)
from merlin_executor.executor_request import ExecutorRequest
from merlin_executor.goal_check import GoalError, check_goals
from merlin_executor.request_times import When, ros_time
from merlin_executor.resending import END, RESEND, RETURN_WAIT, checked
from merlin_planning.knowledge_client import DEFAULT_KNOWLEDGE_BASE, knowledge_client
from merlin_planning.knowledge_text import parse_goal, to_pddl
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.lease import LASTING
from merlin_ros.service_proxy import when_back

__all__ = [
    "CANCEL",
    "DROP",
    "GO_ON",
    "NEVER",
    "RESUME",
    "ExecutorRequest",
    "Goal",
    "Goals",
    "MerlinExecutorClient",
    "as_list",
    "outcome_name",
]

Goal = Union[str, KnowledgeItem]
Goals = Union[Goal, Sequence[Goal]]
RESUME = ExecuteGoal.RESUME
DROP = ExecuteGoal.DROP
NEVER = ExecuteGoal.NEVER
CANCEL = ExecuteGoal.CANCEL
GO_ON = ExecuteGoal.GO_ON


class MerlinExecutorClient:
    """Talks to the Executor.

    Goals are PDDL text (``"(checked kitchen)"``) or knowledge items, one or many.

    :param action: name of the Executor's action.
    :param knowledge_base: against which goals are checked before they are sent; None: the Executor does it.
    :param on_client_lost: CANCEL or GO_ON, what becomes of a request when this client dies.
    :param on_lost: END or RESEND, what happens when the Executor is lost while a request runs: it ends with
        INTERNAL and the reason, or it is sent again when the Executor is back within
        :data:`merlin_executor.resending.RETURN_WAIT`. RESEND also sends again what the Executor has cancelled
        because this process was silent, and waits as long for a knowledge base that does not answer.
    :param on_send: called with the goals of a request, as PDDL text, before it is sent.
    :raises ValueError: for another word.
    """

    def __init__(
        self,
        action: str = "merlin/execute",
        knowledge_base: Optional[str] = DEFAULT_KNOWLEDGE_BASE,
        on_client_lost: int = CANCEL,
        on_lost: str = END,
        on_send: Callable[[Sequence[str]], None] = lambda goals: None,
    ) -> None:
        self._client = ActionClient(action, ExecuteAction)
        self._knowledge = knowledge_client(knowledge_base) if knowledge_base else None
        self._on_client_lost = on_client_lost
        self.on_lost = checked(on_lost)
        self._on_send = on_send
        self._lock = threading.Lock()  # guards the field below
        self._requests: List[ExecutorRequest] = []

    def wait_for_executor(
        self, timeout: Optional[float] = None, unless: Callable[[], bool] = lambda: False
    ) -> bool:
        """Waits until the Executor runs.

        :param timeout: s; None: until ROS shuts down.
        :param unless: ends the wait when it is true.
        :return: whether it runs.
        """
        return self._client.wait_for_server(timeout, unless)

    @property
    def name(self) -> str:
        """Resolved name of the Executor's action."""
        return self._client.name

    @property
    def executor_alive(self) -> bool:
        """Whether the Executor answers."""
        return self._client.alive

    def send(
        self,
        goals: Goals,
        priority: int = 0,
        on_interrupt: int = RESUME,
        on_done: Optional[Callable[[ExecutorRequest], None]] = None,
        on_feedback: Optional[Callable[[ExecuteFeedback], None]] = None,
        on_client_lost: Optional[int] = None,
        on_lost: Optional[str] = None,
        by: str = "",
        given_up: Optional[threading.Event] = None,
        not_before: Optional[When] = None,
        deadline: Optional[When] = None,
        alone: bool = False,
        survives: bool = False,
        value: float = 1.0,
        name: str = "",
    ) -> ExecutorRequest:
        """Sends goals and returns at once.

        :param priority: higher is more urgent; a more urgent request interrupts the running one.
        :param on_interrupt: RESUME or DROP, what happens to this one when it is interrupted; or NEVER: once
            it has begun, more urgent ones wait until it has ended.
        :param on_done: called with the ended request, in another thread.
        :param on_feedback: called with each feedback, in another thread.
        :param on_client_lost: CANCEL or GO_ON; None: as the client does by default.
        :param on_lost: END or RESEND; None: as the client does by default.
        :param by: the person on whose behalf it is sent, for all that show it; empty: the client's own.
        :param given_up: ends the wait for the knowledge base when it is set.
        :param not_before: before which it does not begin, a ROS time, or s from now; None: at once.
        :param deadline: by which the goals have to hold, likewise; when it passes, the request ends as LATE.
            None: there is none.
        :param alone: it is never planned together with other requests.
        :param survives: it goes on when this client dies, and in the next life of the Executor, whatever
            `on_client_lost` and `on_lost` say. :meth:`follow` finds it again.
        :param value: what it is worth among those of its priority, where not all can be in time.
        :param name: of one that survives: while it has not ended, this node finds it again by sending it once
            more under the same name, also in its next life. Empty: it gets a name of its own.
        :raises ValueError: for a time that is not one, or not in the future, or a value that is not above 0.
        :raises PDDLSyntaxError: for text that is not a PDDL goal.
        :raises RequestTooLarge: for more than the Executor takes, a priority that is no int32, or an
            `on_interrupt` or `on_client_lost` that is not one of its constants.
        :raises GoalError: for goals that the domain or the world does not know.
        :raises merlin_ros.service_proxy.ServiceError: when the knowledge base does not answer.
        """
        texts, items = _split(goals)
        check_size(texts, len(items))
        on_lost = on_lost or self.on_lost
        on_client_lost = self._on_client_lost if on_client_lost is None else on_client_lost
        knowledge = self._knowledge
        if knowledge is not None:
            checked_items = [*(item for text in texts for item in parse_goal(text)), *items]
            when_back(
                lambda: check_goals(checked_items, knowledge),
                RETURN_WAIT if on_lost == RESEND else 0.0,
                lambda: rospy.logwarn(f"goals wait for the knowledge base, at most {RETURN_WAIT:g} s"),
                given_up,
            )
        goal = ExecuteGoal(
            goals=texts,
            items=items,
            priority=check_priority(priority),
            on_interrupt=check_choice("on_interrupt", on_interrupt, ON_INTERRUPT),
            on_client_lost=check_choice("on_client_lost", on_client_lost, ON_CLIENT_LOST),
            by=by,
            not_before=ros_time(not_before, "not_before"),
            deadline=ros_time(deadline, "deadline"),
            alone=alone,
            survives=survives,
            value=check_value(value),
        )
        self._on_send([*texts, *map(to_pddl, items)])
        known = lasting_id(name) if survives and name else ""
        request = ExecutorRequest(self._client, goal, on_done, on_feedback, on_lost, known)
        return self._noted(request)

    def follow(
        self,
        request: str,
        on_done: Optional[Callable[[ExecutorRequest], None]] = None,
        on_feedback: Optional[Callable[[ExecuteFeedback], None]] = None,
    ) -> ExecutorRequest:
        """Finds a request that survives again, also one of another client.

        :param request: its id; of one that does not run or wait any more, the result is REFUSED.
        :raises ValueError: for an id of a request that does not survive.
        """
        if not request.endswith(LASTING):
            raise ValueError(f"{request!r} is not the id of a request that survives")
        goal = ExecuteGoal(survives=True)
        return self._noted(ExecutorRequest(self._client, goal, on_done, on_feedback, known=request))

    def _noted(self, request: ExecutorRequest) -> ExecutorRequest:
        with self._lock:
            self._requests = [known for known in self._requests if not known.done] + [request]
        return request

    def execute(self, goals: Goals, timeout: Optional[float] = None, **options: Any) -> ExecuteResult:
        """Sends goals and waits for the end; a time-out cancels them and waits for that.

        :param timeout: s; None: as long as it takes.
        :raises rospy.ROSInterruptException: when this node shuts down before. Else as :meth:`send`.
        """
        request = self.send(goals, **options)
        if not request.wait(timeout):
            request.cancel()
            request.wait()
        result = request.result
        if result is None:
            raise rospy.ROSInterruptException("the node shuts down before its request has ended")
        return result

    def cancel_all(self) -> None:
        """Cancels every request of this client but those that survive, which go on without it."""
        with self._lock:
            requests = list(self._requests)
        for request in requests:
            request.leave()


def lasting_id(name: str) -> str:
    """The id of a request that survives and that this node has sent under a name; see :meth:`.send`."""
    return f"{rospy.get_name()}-{name}{LASTING}"


def as_list(goals: Goals) -> List[Goal]:
    """One goal or many as a list."""
    return list(goals) if isinstance(goals, Iterable) and not isinstance(goals, str) else [goals]


def _split(goals: Goals) -> Tuple[List[str], List[KnowledgeItem]]:
    parts = as_list(goals)
    texts = [part for part in parts if isinstance(part, str)]
    items = [part for part in parts if isinstance(part, KnowledgeItem)]
    if len(texts) + len(items) != len(parts):
        raise GoalError("goals are PDDL text or knowledge items")
    return texts, items
