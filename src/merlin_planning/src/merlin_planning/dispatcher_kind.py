"""What differs between dispatchers: ROSPlan's own publish no status, ours do.

The client of a dispatcher holds its lock for all methods but those that may block.
"""

from abc import ABC, abstractmethod
from typing import Callable, List, NamedTuple, Optional, Sequence, Tuple

from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_planning.dispatch_progress import Action, DispatchProgress, DispatchResult, Reply


class Hold(NamedTuple):
    """Where a dispatcher is held by an operator's wish."""

    held: str = ""
    """The action before which it is held now, as PDDL text; empty: it is not."""
    breakpoints: Tuple[str, ...] = ()
    """Actions before which it will be, with ``*`` for any argument."""


class DispatcherKind(ABC):
    """How a dispatcher is dealt with."""

    #: It publishes its status.
    reports: bool
    #: It stops the other actions by itself when one fails.
    stops_after_failure: bool

    @property
    @abstractmethod
    def busy(self) -> bool:
        """True when it is known to carry out a plan."""

    @property
    @abstractmethod
    def at_rest(self) -> bool:
        """False while a last status of the present dispatch may follow."""

    hold = Hold()

    @property
    def failed_action(self) -> str:
        """The action of the present dispatch that failed, as PDDL text; empty: it names none."""
        return ""

    @abstractmethod
    def begin(self, plan: Sequence[ActionDispatch]) -> DispatchProgress:
        """A dispatch begins; returns its book."""

    @abstractmethod
    def wait(self, plan: Sequence[ActionDispatch], interrupted: Callable[[], bool]) -> str:
        """Waits, with a limit, until the dispatcher can be given the plan. Blocks.

        :param interrupted: ends the wait.
        :return: what is missing; empty: it may be sent.
        """

    @abstractmethod
    def send(self, ended: Callable[[object], None], owner: Optional[str]) -> None:
        """Gives it the plan.

        :param ended: called, from another thread, with the dispatcher's answer or what the call has raised.
        :param owner: id of the goal of this process's own server on whose behalf it is dispatched.
        """

    @abstractmethod
    def cancel(self) -> None:
        """Sends the cancel of the dispatch. May block."""

    @abstractmethod
    def end(self, hangs: bool) -> None:
        """The dispatch is over for its client.

        :param hangs: whether the dispatcher has not answered.
        """

    @abstractmethod
    def started(self, progress: DispatchProgress) -> bool:
        """True when the dispatcher is known to have begun the dispatch: a cancel before would be lost."""

    @abstractmethod
    def failure_grace(self, slack: Optional[float]) -> Optional[float]:
        """Time for it to end after an action failed, s of running time; None: no limit.

        :param slack: the time that it gets after a cancel.
        """

    @abstractmethod
    def to_cancel(self, progress: DispatchProgress) -> List[Action]:
        """The actions to which the client itself has to pass a cancel on."""

    @abstractmethod
    def result(self, progress: DispatchProgress, reply: Reply) -> DispatchResult:
        """How the dispatch ended."""

    def patience(self) -> Optional[float]:
        """How long it may send nothing until it is given up, s of running time; None: it is not."""
        return None

    def other_plan(self) -> bool:
        """Whether it carries out an older plan than the one that was meant."""
        return False
