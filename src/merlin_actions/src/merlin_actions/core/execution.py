# SPDX-License-Identifier: Apache-2.0
"""One dispatched action, from its dispatch to its answer."""

import itertools
import threading
from typing import (
    Any,
    Callable,
    Dict,
    FrozenSet,
    Iterable,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Protocol,
    Sequence,
    Tuple,
    Union,
)

from merlin_pddl.formula import call_text
from merlin_ros.work.threads import log_failure

#: Plan id and action id.
Key = Tuple[int, int]

_numbers = itertools.count(1)


LATCH_GRACE = 0.3  # s after connecting to a dispatcher in which its latched, perhaps old, message arrives
KEEP_CONNECTIONS = 8  # of earlier processes of the dispatcher


class LatchedDispatches:
    """Puts dispatches aside that may be older than the interface. Not thread-safe.

    :ivar connected: when the dispatcher's connection was opened, s of running time; None: not yet.
    """

    def __init__(self) -> None:
        self.connected: Optional[float] = None
        self._names_waiting = False  # whether the dispatcher says for which actions it waits
        self._headers: List[Mapping[str, str]] = []  # of the connections that a message came over
        self._aside: Dict[Key, Any] = {}
        self._awaited: FrozenSet[Key] = frozenset()

    def may_be_old(self, message: Any, now: float) -> bool:
        """Whether a message may be an old one; to be asked of each, in their order.

        On a busy machine a latched message comes long after the connection. Of a dispatcher that says for
        which actions it waits, the first message of a connection is always a latched one.

        :param now: s of running time.
        """
        header = getattr(message, "_connection_header", None) or {}
        first = not any(header is known for known in self._headers)  # rospy keeps one for each connection
        if first:
            self._headers = [*self._headers[-KEEP_CONNECTIONS:], header]
        just_connected = self.connected is None or now - self.connected < LATCH_GRACE
        return header.get("latching") == "1" and (just_connected or (first and self._names_waiting))

    def put_aside(self, dispatch: Any, old: bool) -> bool:
        """Puts a dispatch aside that may be old, unless its dispatcher has said that it waits for it.

        One that begins ends the wait of those of other plans.
        """
        key = dispatch.plan_id, dispatch.action_id
        aside = old and key not in self._awaited
        if aside:
            self._aside[key] = dispatch
        else:
            self._aside = {each: kept for each, kept in self._aside.items() if each[0] == key[0]}
        return aside

    def drop(self, dispatch: Any) -> None:
        """Its action is cancelled."""
        self._aside.pop((dispatch.plan_id, dispatch.action_id), None)

    def take(self, awaited: Iterable[Key]) -> List[Any]:
        """Takes those that the dispatcher says it waits for."""
        self._names_waiting, self._awaited = True, frozenset(awaited)
        return [self._aside.pop(key) for key in list(self._aside) if key in self._awaited]


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


class ParameterMessage(Protocol):
    """The fields of diagnostic_msgs/KeyValue."""

    key: str
    value: str


class ActionMessage(Protocol):
    """The fields of rosplan_dispatch_msgs/ActionDispatch that an execution has."""

    name: str
    plan_id: int
    action_id: int
    duration: float
    parameters: Sequence[ParameterMessage]


class Execution:
    """A ground action that was dispatched to an interface.

    :param dispatch: the ``ActionDispatch`` that came.
    :param parameters: ``KeyValue`` for each variable of the operator, in its order.
    :param life: names this process.
    """

    def __init__(
        self, dispatch: ActionMessage, parameters: Sequence[ParameterMessage], life: str = ""
    ) -> None:
        self.dispatch = dispatch
        self.parameters = list(parameters)
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

    def matches(self, cancel: ActionMessage) -> bool:
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
        if interrupt is None:
            return
        try:
            interrupt()
        except Exception:
            log_failure(f"the cancel of {self.text}")

    def interruptible(self, interrupt: Optional[Callable[[], None]]) -> None:
        """Announces what stops it from now on; a cancel that came before is passed on at once."""
        with self._lock:
            self._interrupt = interrupt
            pending = self.cancelled.is_set()
        if interrupt is not None and pending:
            interrupt()
