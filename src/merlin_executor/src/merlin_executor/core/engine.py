"""Runs requests by their agenda: one worker, events from any thread, one answer for each. Without ROS.

What nothing foresaw, in a run or an answer, ends that request with the reason; the worker goes on.
"""

import logging
import threading
from typing import Callable, Generic, List, Optional, Tuple, TypeVar, cast

from merlin_executor.core.agenda import Agenda, AgendaAnswer, Decision, StopRun, Ticket
from merlin_executor.core.outcome import Outcome, StopKind, Verdict, crashed
from merlin_pddl.breakpoints import Breakpoints

TIDY_PERIOD = 1.0  # s between two attempts to remove what a run has left

_log = logging.getLogger(__name__)


class Job(Ticket):
    """A request as the engine wants it."""

    def begin(self) -> None:
        """A run begins: the first, or after an interruption."""

    def accept(self) -> None:
        """Called when the request runs for the first time."""

    def end(self, verdict: Verdict) -> bool:
        """Answers the client; False when that was done before."""
        raise NotImplementedError


J = TypeVar("J", bound=Job)


class Stages(Generic[J]):
    """What carries a request out."""

    def prepare(self) -> None:
        """Forgets earlier cancels; called before each run."""
        raise NotImplementedError

    def cancel(self) -> None:
        """Stops the run, also one that is prepared and has not begun; from any thread, never blocks."""
        raise NotImplementedError

    def run_request(self, request: J) -> Verdict:
        """Runs it."""
        raise NotImplementedError

    def clean_up(self) -> None:
        """Removes what a run has left, as far as that is possible now."""
        raise NotImplementedError

    @property
    def left(self) -> bool:
        """Whether a run has left something that :meth:`clean_up` could not remove yet."""
        return False


class Engine(Generic[J]):
    """Queues requests and runs them.

    :param stages: carry them out.
    :param on_status: called when what runs has changed, without a lock.
    :param on_queue: called when what waits has changed, without a lock.
    :param on_end: called with each request whose run has ended, the verdict, and the traceback if it crashed.
    """

    def __init__(
        self,
        stages: Stages[J],
        on_status: Callable[[], None],
        on_queue: Callable[[], None],
        on_end: Callable[[J, Verdict, Optional[BaseException]], None],
    ) -> None:
        self._stages = stages
        self._on_status = on_status
        self._on_queue = on_queue
        self._on_end = on_end
        self._changed = threading.Condition()  # guards the agenda
        self._agenda: Agenda[J] = Agenda()
        self._worker = threading.Thread(target=self._work, name="executor", daemon=True)

    def start(self) -> None:
        """Begins to run requests."""
        self._worker.start()

    def shutdown(self, timeout: float) -> None:
        """Cancels what runs and answers what waits.

        :param timeout: s for the run to end.
        """
        self.decide(lambda agenda: agenda.close())
        self._worker.join(timeout)

    @property
    def paused(self) -> bool:
        """Whether no further request begins."""
        return self._agenda.paused

    @property
    def breakpoints(self) -> Breakpoints:
        """Goals before whose request the engine is held; after a change it has to :meth:`decide`."""
        return self._agenda.breakpoints

    @property
    def running(self) -> Optional[J]:
        """The request that runs."""
        return self._agenda.running

    @property
    def waiting(self) -> List[J]:
        """The requests that wait, in the order in which they would run."""
        with self._changed:
            return self._agenda.waiting

    def decide(self, event: Callable[[Agenda[J]], List[Decision]]) -> None:
        """Puts an event on the agenda and carries out what that decides; from any thread."""
        with self._changed:
            decisions = event(self._agenda)
            if any(isinstance(decision, StopRun) for decision in decisions):
                self._stages.cancel()
            self._changed.notify_all()
        self._on_queue()
        for decision in decisions:
            if isinstance(decision, AgendaAnswer):
                cast(J, decision.ticket).end(decision.verdict)

    def decide_on(self, wanted: Callable[[J], bool], event: Callable[[Agenda[J], J], List[Decision]]) -> None:
        """Likewise, for an event on one request; without effect when no such request waits or runs."""

        def decide(agenda: Agenda[J]) -> List[Decision]:
            running = [agenda.running] if agenda.running is not None else []
            found = next((request for request in [*agenda.waiting, *running] if wanted(request)), None)
            return event(agenda, found) if found is not None else []

        self.decide(decide)

    def _work(self) -> None:
        told = ""  # what was told to be held
        while True:
            with self._changed:
                request = self._agenda.begin()
                held = self._agenda.breakpoints.held
                if request is None and held == told:
                    if self._agenda.closing:
                        return
                    left = self._stages.left
                    if self._changed.wait(TIDY_PERIOD if left else None) or not left:
                        continue
                elif request is not None:
                    request.begin()
                    self._stages.prepare()
            if held != told:
                told = held
                self._on_status()
                if request is None:
                    continue
            if request is None:
                self._tidy()
                continue
            verdict, error = self._run(request)
            self._finish(request, verdict, error)

    def _tidy(self) -> None:
        try:
            self._stages.clean_up()
        except Exception:  # the worker goes on, and tries again
            _log.exception("what a request has left could not be removed")

    def _run(self, request: J) -> Tuple[Verdict, Optional[BaseException]]:
        try:
            request.accept()
            self._on_queue()
            return self._stages.run_request(request), None
        except BaseException as error:  # the client gets its answer, and the worker goes on
            try:
                self._stages.clean_up()
            except Exception as second:
                error.__context__ = second
            return crashed(error), error

    def _finish(self, request: J, verdict: Verdict, error: Optional[BaseException]) -> None:
        """Ends a run, and its request unless that runs again."""
        with self._changed:
            decisions = self._agenda.ended(verdict)
            self._changed.notify_all()
        final = next((answer.verdict for answer in decisions if isinstance(answer, AgendaAnswer)), None)
        try:
            shown = final or Verdict(Outcome.CANCELLED, StopKind.INTERRUPTED.value)
            self._on_end(request, shown, error)
            # Idle is published before the answer: a client that has the answer may rely on it.
            self._on_status()
            self._on_queue()
        except BaseException:  # what cannot be published must not keep the answer, nor the next request
            _log.exception("the end of a request could not be published")
        if final is not None:
            request.end(final)
