"""MerlinExecutorClient: sends goals to the Executor and takes them back (paper, section 3.2.2)."""

from typing import Any, Callable, Optional, Sequence, Union

from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import ExecuteAction, ExecuteFeedback, ExecuteGoal, ExecuteResult
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_executor.goal_check import GoalError, check_goals
from merlin_sm.action_client import ActionClient, ClientGoal
from merlin_sm.knowledge_client import DEFAULT_KNOWLEDGE_BASE, knowledge_client
from merlin_sm.pddl_text import parse_goal

Goals = Union[str, Sequence[Union[str, KnowledgeItem]]]
RESUME = ExecuteGoal.RESUME
DROP = ExecuteGoal.DROP


class ExecutorRequest:
    """A request that was sent."""

    def __init__(self, sent: ClientGoal) -> None:
        self._sent = sent

    @property
    def id(self) -> str:
        """The actionlib goal id; ``merlin/status`` and ``merlin/queue`` name the request by it."""
        return self._sent.id

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self._sent.done

    @property
    def state(self) -> int:
        """A constant of actionlib_msgs/GoalStatus."""
        return self._sent.status

    @property
    def feedback(self) -> Optional[ExecuteFeedback]:
        """The last feedback."""
        return self._sent.feedback

    @property
    def result(self) -> Optional[ExecuteResult]:
        """How it ended; None while it runs. An Executor that disappeared gives INTERNAL and the reason."""
        if not self.done:
            return None
        result: ExecuteResult = self._sent.result
        if self.state == GoalStatus.LOST:
            result = ExecuteResult(outcome=ExecuteResult.INTERNAL, reason=self._sent.text)
        elif self.state == GoalStatus.RECALLED and not result.reason:
            result = ExecuteResult(outcome=ExecuteResult.CANCELLED, reason=self._sent.text)
        return result

    def cancel(self) -> None:
        """Stops it, wherever it is: queued, planning or under way. The answer is its end."""
        self._sent.cancel()

    def wait(self, timeout: Optional[float] = None) -> bool:
        """Waits for its end.

        :param timeout: s, which stand still while the simulator is paused; None: as long as it takes.
        :return: whether it has ended.
        """
        return self._sent.wait(timeout)


class MerlinExecutorClient:
    """Talks to the Executor.

    Goals are PDDL text (``"(checked kitchen)"``) or knowledge items, one or many.

    :param action: name of the Executor's action.
    :param knowledge_base: against which goals are checked before they are sent; None: the Executor does it.
    """

    def __init__(
        self, action: str = "merlin/execute", knowledge_base: Optional[str] = DEFAULT_KNOWLEDGE_BASE
    ) -> None:
        self._client = ActionClient(action, ExecuteAction)
        self._knowledge = knowledge_client(knowledge_base) if knowledge_base else None
        self._requests: list = []

    def wait_for_executor(self, timeout: Optional[float] = None) -> bool:
        """Waits until the Executor is there, s; None: until ROS shuts down."""
        return self._client.wait_for_server(timeout)

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
    ) -> ExecutorRequest:
        """Sends goals and returns at once.

        :param priority: higher is more urgent; a more urgent request interrupts the running one.
        :param on_interrupt: RESUME or DROP, what happens to this one when it is interrupted.
        :param on_done: called with the ended request, in another thread.
        :param on_feedback: called with each feedback, in another thread.
        :raises PDDLSyntaxError: for text that is no PDDL goal.
        :raises GoalError: for goals that the domain or the world does not know.
        """
        texts, items = _split(goals)
        if self._knowledge is not None:
            check_goals([*(item for text in texts for item in parse_goal(text)), *items], self._knowledge)
        goal = ExecuteGoal(goals=texts, items=items, priority=priority, on_interrupt=on_interrupt)
        done = (lambda sent: on_done(ExecutorRequest(sent))) if on_done else None
        feedback = (lambda sent, message: on_feedback(message)) if on_feedback else None
        request = ExecutorRequest(self._client.send(goal, done, feedback))
        self._requests = [known for known in self._requests if not known.done] + [request]
        return request

    def execute(self, goals: Goals, timeout: Optional[float] = None, **options: Any) -> ExecuteResult:
        """Sends goals and waits for the end; a time-out cancels them and waits for that.

        :param timeout: s; None: as long as it takes.
        """
        request = self.send(goals, **options)
        if not request.wait(timeout):
            request.cancel()
            request.wait()
        assert request.result is not None
        return request.result

    def cancel_all(self) -> None:
        """Cancels every request of this client."""
        for request in self._requests:
            request.cancel()


def outcome_name(outcome: int) -> str:
    """The name of an outcome: 2 → ``CANCELLED``."""
    names = (
        name for name in dir(ExecuteResult) if name.isupper() and getattr(ExecuteResult, name) == outcome
    )
    return next(names, str(outcome))


def _split(goals: Goals) -> tuple:
    parts = [goals] if isinstance(goals, (str, KnowledgeItem)) else list(goals)
    texts = [part for part in parts if isinstance(part, str)]
    items = [part for part in parts if isinstance(part, KnowledgeItem)]
    if len(texts) + len(items) != len(parts):
        raise GoalError("goals are PDDL text or knowledge items")
    return texts, items
