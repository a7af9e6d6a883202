# SPDX-License-Identifier: Apache-2.0
"""One dispatched action, from its dispatch to its answer."""

import itertools
import threading
import time
from typing import Any, Callable, Dict, NamedTuple, Optional, Sequence, Tuple, Union

from merlin_pddl.plan_text import call_text
from merlin_ros.work.threads import failure_logged

#: Plan id and action id.
Key = Tuple[int, int]

_numbers = itertools.count(1)


def at_once(concurrent: Union[bool, int]) -> int:
    """How many executions may run at once; 0: any number.

    :param concurrent: a number, or whether they may.
    """
    return 0 if concurrent is True else max(1, int(concurrent))


class Token(NamedTuple):
    """Names an execution to the knowledge base, and what is sent on its behalf to its servers."""

    key: Optional[Key]
    """None in a token that another program has made."""
    life: str
    """Names the process that runs it."""
    number: str = ""
    """Different for each execution of that process."""

    def __str__(self) -> str:
        plan, action = self.key or ("", "")
        return f"{plan}/{action}/{self.life}/{self.number}"

    def left_by_earlier(self, life: str) -> bool:
        """Whether an earlier process of the same node has begun it; never of a token of another program.

        :param life: of this process.
        """
        return self.key is not None and self.life not in ("", life)

    @staticmethod
    def read(text: str) -> "Token":
        """The token that was written as a text."""
        plan, action, life, number = [*text.split("/", 3), "", "", "", ""][:4]
        key = (int(plan), int(action)) if plan.isdigit() and action.isdigit() else None
        return Token(key, life, number)


class Execution:
    """A ground action that was dispatched to an interface.

    :param dispatch: the ``ActionDispatch`` that came.
    :param parameters: ``KeyValue`` for each variable of the operator, in its order.
    :param life: names this process.
    """

    def __init__(self, dispatch: Any, parameters: Sequence[Any], life: str = "") -> None:
        self.dispatch = dispatch
        self.parameters = list(parameters)
        self.arrived = time.monotonic()
        self.cancelled = threading.Event()
        self.cancel_reason = "cancelled"
        self.left_queue = threading.Event()
        """Set when it waits for no other execution any more."""
        self.lane = ""
        """Only executions of the same one wait for each other; the robot that runs it."""
        self.lost = ""
        """Why nothing answers for it any more, as a sentence; empty: something does."""
        self.answered = False
        """Whether the dispatcher has its final answer."""
        self.uninterruptible = False
        """Whether its machine is at a state at which no more urgent request interrupts it."""
        self.token = str(Token(self.key, life, str(next(_numbers))))
        """See :class:`Token`."""
        self._lock = threading.Lock()  # guards _interrupt
        self._interrupt: Optional[Callable[[], None]] = None

    @property
    def key(self) -> Key:
        """Plan id and action id."""
        return self.dispatch.plan_id, self.dispatch.action_id

    @property
    def lease(self) -> str:
        """What names it in the lease of its dispatcher."""
        return f"{self.key[0]}/{self.key[1]}"

    @property
    def binding(self) -> Dict[str, str]:
        """Operator variable → object."""
        return {parameter.key: parameter.value for parameter in self.parameters}

    @property
    def text(self) -> str:
        """The ground action as PDDL."""
        return call_text(self.dispatch.name, tuple(parameter.value for parameter in self.parameters))

    def matches(self, cancel: Any) -> bool:
        """Whether a ``cancel_action`` means this execution: ids and parameters have to be the same."""
        return (cancel.plan_id, cancel.action_id) == self.key and [
            (parameter.key, parameter.value) for parameter in cancel.parameters
        ] == [(parameter.key, parameter.value) for parameter in self.dispatch.parameters]

    def cancel(self, reason: str = "cancelled") -> None:
        """Stops it, in the caller's thread; what users' code raises is logged: others have to stop too."""
        with self._lock:
            if not self.cancelled.is_set():
                self.cancel_reason = reason
            self.cancelled.set()
            interrupt = self._interrupt
        if interrupt is not None:
            with failure_logged(f"the cancel of {self.text}"):
                interrupt()

    def interruptible(self, interrupt: Optional[Callable[[], None]]) -> None:
        """Announces what stops it from now on; a cancel that came before is passed on at once."""
        with self._lock:
            self._interrupt = interrupt
            pending = self.cancelled.is_set()
        if interrupt is not None and pending:
            interrupt()
