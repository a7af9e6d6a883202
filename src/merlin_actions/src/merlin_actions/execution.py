"""One dispatched action, from its dispatch to its answer."""

import itertools
import threading
from typing import Callable, Dict, Optional, Sequence

from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_actions.core.ending import Ending
from merlin_actions.core.execution_queue import Key
from merlin_actions.left_executions import token_of
from merlin_sm.knowledge_text import action_text

__all__ = ["Ending", "Execution"]
_numbers = itertools.count(1)


class Execution:
    """A ground action that an interface was told to run."""

    def __init__(self, dispatch: ActionDispatch, parameters: Sequence[KeyValue]) -> None:
        self.dispatch = dispatch
        self.parameters = list(parameters)
        self.cancelled = threading.Event()
        self.cancel_reason = "cancelled"
        self.left_queue = threading.Event()
        """Set when it waits for no other execution any more."""
        self.token = token_of(self.key, next(_numbers))
        """Names this execution to the knowledge base, and what is sent on its behalf to its servers."""
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
    def text(self) -> str:
        """The ground action as PDDL."""
        return action_text(self.dispatch.name, self.parameters)

    def matches(self, cancel: ActionDispatch) -> bool:
        """Whether a ``cancel_action`` means this execution: ids and parameters have to be the same."""
        return (cancel.plan_id, cancel.action_id) == self.key and [
            (parameter.key, parameter.value) for parameter in cancel.parameters
        ] == [(parameter.key, parameter.value) for parameter in self.dispatch.parameters]

    def cancel(self, reason: str = "cancelled") -> None:
        """Stops it, in the caller's thread."""
        with self._lock:
            if not self.cancelled.is_set():
                self.cancel_reason = reason
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
