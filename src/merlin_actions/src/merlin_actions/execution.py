"""One dispatched action, from its dispatch to its answer."""

import threading
from typing import Callable, Dict, NamedTuple, Optional, Sequence, Tuple

from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_sm.pddl_text import action_text

Key = Tuple[int, int]


class Ending(NamedTuple):
    """How an execution ended: whether the action's effects came true, and if not, why."""

    succeeded: bool
    reason: str = ""
    begun: bool = True
    """False when nothing was done at all: the world is as it was before the dispatch."""


class Execution:
    """A ground action that an interface was told to run."""

    def __init__(self, dispatch: ActionDispatch, parameters: Sequence[KeyValue]) -> None:
        self.dispatch = dispatch
        self.parameters = list(parameters)
        self.cancelled = threading.Event()
        self._lock = threading.Lock()  # guards _interrupt
        self._interrupt: Optional[Callable[[], None]] = None

    @property
    def key(self) -> Key:
        """Plan id and action id."""
        return self.dispatch.plan_id, self.dispatch.action_id

    @property
    def binding(self) -> Dict[str, str]:
        """Operator variable → object."""
        return {parameter.key: parameter.value for parameter in self.parameters}

    @property
    def token(self) -> str:
        """Names this execution to the knowledge base."""
        return f"{self.dispatch.plan_id}/{self.dispatch.action_id}/{id(self)}"

    @property
    def text(self) -> str:
        """The ground action as PDDL."""
        return action_text(self.dispatch.name, self.parameters)

    def matches(self, cancel: ActionDispatch) -> bool:
        """Whether a ``cancel_action`` means this execution: ids and parameters have to be the same."""
        return (cancel.plan_id, cancel.action_id) == self.key and [
            (parameter.key, parameter.value) for parameter in cancel.parameters
        ] == [(parameter.key, parameter.value) for parameter in self.dispatch.parameters]

    def cancel(self) -> None:
        """Stops it, in the caller's thread."""
        with self._lock:
            self.cancelled.set()
            interrupt = self._interrupt
        if interrupt is not None:
            interrupt()

    def interruptible(self, interrupt: Optional[Callable[[], None]]) -> None:
        """Announces what stops it from now on; a cancel that came before is passed on at once."""
        with self._lock:
            self._interrupt = interrupt
            pending = self.cancelled.is_set()
        if interrupt is not None and pending:
            interrupt()
