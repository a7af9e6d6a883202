"""What differs between dispatchers: ROSPlan's own publish no status, ours do.

Not thread-safe. :class:`merlin_sm.dispatch_client.DispatchClient` begins with :class:`SilentDispatcher` and
continues with :class:`ReportingDispatcher` from the first status on.
"""

from abc import ABC, abstractmethod
from typing import List, NamedTuple, Optional, Tuple

from merlin_msgs.msg import DispatchStatus

from merlin_sm.dispatching.progress import Action, DispatchProgress, DispatchResult, Reply

#: Time for ROSPlan's dispatcher to stop by itself after a failed action, s of running time.
FAILURE_GRACE = 0.5


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
    #: It may still hold an older plan when it is called.
    may_hold_old_plan: bool
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
    def begin(self) -> None:
        """A dispatch begins."""

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


class SilentDispatcher(DispatcherKind):
    """A dispatcher without status, as ROSPlan's own are."""

    reports = False
    may_hold_old_plan = True
    stops_after_failure = False
    busy = False
    at_rest = True

    def begin(self) -> None:
        """Nothing is remembered of an earlier dispatch."""

    def started(self, progress: DispatchProgress) -> bool:
        """True when an action of it was seen: a stray cancel would stop the next dispatch instead."""
        return bool(progress.running or progress.failed)

    def failure_grace(self, slack: Optional[float]) -> Optional[float]:
        """Short: the esterel dispatcher does not notice a failed action."""
        return FAILURE_GRACE

    def to_cancel(self, progress: DispatchProgress) -> List[Action]:
        """All that run: the simple dispatcher passes no cancel on."""
        return list(progress.running.values())

    def result(self, progress: DispatchProgress, reply: Reply) -> DispatchResult:
        """From the answers of the action interfaces."""
        return progress.result(reply)


class ReportingDispatcher(DispatcherKind):
    """A dispatcher that publishes its status, as those of MERLIN do.

    :param status: the first one.
    """

    reports = True
    may_hold_old_plan = False
    stops_after_failure = True

    def __init__(self, status: DispatchStatus) -> None:
        self.receive(status)

    def receive(self, status: DispatchStatus) -> None:
        """Keeps the status that the dispatcher has published last."""
        self._status, self._is_new = status, True
        self.hold = Hold(status.held, tuple(status.breakpoints))

    def begin(self) -> None:
        """Forgets that the present status is of this dispatch."""
        self._is_new = False

    @property
    def busy(self) -> bool:
        """True unless the status says idle."""
        return bool(self._status.state != DispatchStatus.IDLE)

    @property
    def failed_action(self) -> str:
        """As the last status says."""
        return str(self._status.failed_action) if self._is_new else ""

    @property
    def at_rest(self) -> bool:
        """True after a status of this dispatch that says idle."""
        return self._is_new and not self.busy

    def started(self, progress: DispatchProgress) -> bool:
        """True when the status says so."""
        return self.busy

    def failure_grace(self, slack: Optional[float]) -> Optional[float]:
        """Our dispatcher stops the other actions itself, within its own deadline."""
        return slack

    def to_cancel(self, progress: DispatchProgress) -> List[Action]:
        """None: it passes a cancel on."""
        return []

    def result(self, progress: DispatchProgress, reply: Reply) -> DispatchResult:
        """With what the status says of the failure."""
        if not self._is_new:
            return progress.result(reply)
        status = self._status
        return progress.result(reply, status.failed_action, status.reason, status.unmet_goals)
