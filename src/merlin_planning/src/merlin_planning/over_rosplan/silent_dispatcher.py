"""A dispatcher of the original ROSPlan, as a client deals with it: by a service, and what is heard."""

import threading
from typing import Callable, List, Optional, Sequence, Set

from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_dispatch_msgs.srv import DispatchService

from merlin_planning.dispatch_progress import Action, DispatchProgress, DispatchResult, Reply, ground
from merlin_planning.dispatcher_kind import DispatcherKind
from merlin_planning.over_rosplan.dispatch_readiness import DispatchReadiness
from merlin_planning.over_rosplan.plain_progress import PlainProgress
from merlin_ros.deadline import limit
from merlin_ros.service_proxy import ServiceProxy

#: Time for ROSPlan's dispatcher to stop by itself after a failed action, s of running time.
FAILURE_GRACE = 0.5


class SilentDispatcher(DispatcherKind):
    """A dispatcher without status, as ROSPlan's own are: its service is called.

    :param name: its global name.
    :param readiness: what is known of the interfaces and of the plan that it has.
    :param call_cancel: calls its service for the cancel.
    :param stuck_after: s of running time without an action under way, after which a dispatch is given up;
        zero or less: never.
    """

    reports = False
    stops_after_failure = False
    busy = False
    at_rest = True

    def __init__(
        self, name: str, readiness: DispatchReadiness, call_cancel: Callable[[], object], stuck_after: float
    ) -> None:
        self._name = name
        self._service = ServiceProxy(f"{name}/dispatch_plan", DispatchService)
        self._readiness = readiness
        self._call_cancel = call_cancel
        self._stuck_after = stuck_after
        self._takers: Set[str] = set()  # operators whose interfaces say when they take an action
        self._book = PlainProgress(None, self._takers)

    def available(self) -> bool:
        """Whether the dispatcher, of either kind, is there now."""
        return self._service.available()

    def begin(self, plan: Sequence[ActionDispatch]) -> DispatchProgress:
        """Nothing is remembered of an earlier dispatch."""
        first = ground(plan[0].name, [entry.value for entry in plan[0].parameters]) if plan else None
        self._book = PlainProgress(first, self._takers)
        return self._book

    def wait(self, plan: Sequence[ActionDispatch], interrupted: Callable[[], bool]) -> str:
        """For the action interfaces, and for the plan; whether it is there itself shows when it is called."""
        self._readiness.wait(plan, interrupted)
        return ""

    def send(self, ended: Callable[[object], None], owner: Optional[str]) -> None:
        """Calls the service, in a thread of its own."""
        service = self._service

        def call() -> None:
            try:
                ended(service())
            except BaseException as error:  # the thread that waits for the end must learn of it
                ended(error)

        threading.Thread(target=call, name=f"dispatch of {self._name}", daemon=True).start()

    def cancel(self) -> None:
        """Calls the service for it."""
        self._call_cancel()

    def end(self, hangs: bool) -> None:
        """The next dispatch gets a connection of its own while the call hangs in its thread."""
        if hangs:
            self._service = ServiceProxy(f"{self._name}/dispatch_plan", DispatchService)

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

    def patience(self) -> Optional[float]:
        """A limit while nothing is under way: it would wait for ever."""
        return limit(self._stuck_after) if self._book.stands else None

    def other_plan(self) -> bool:
        """It may still hold an older plan when it is called."""
        return self._book.other_plan
