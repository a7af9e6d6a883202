# SPDX-License-Identifier: Apache-2.0
"""Runs requests by their agenda: one worker, events from any thread, one answer for each. Without ROS.

One run carries out one request, or several together. An unexpected exception in a run ends its requests with
the reason. What fails while something is published, answered or tidied up is logged: each other request gets
its answer, and the worker continues.
"""

import threading
from functools import partial
from typing import Callable, Dict, Generic, List, Optional, Sequence, Tuple, cast

from merlin_executor.core.agenda import Agenda, AgendaAnswer, Decision, Refusal, ReviseRun, StopRun
from merlin_executor.core.outcome import Outcome, Stop, StopKind, Verdict, crashed
from merlin_executor.core.ticket import T
from merlin_executor.core.time_window import Outlook
from merlin_ros.alarms import wait_ticks
from merlin_ros.work.threads import failure_logged, log_failure, start_thread

TIDY_PERIOD = 1.0  # s between two attempts to remove what a run has left
_AGAIN = Stop(StopKind.ANOTHER)


class Stages(Generic[T]):
    """The stages that execute requests."""

    def prepare(self) -> None:
        """Forgets earlier cancels; called before each run."""
        raise NotImplementedError

    def cancel(self) -> None:
        """Stops the run, also one that is prepared and has not begun; from any thread, in milliseconds."""
        raise NotImplementedError

    def revise(self) -> bool:
        """Has the plan that is carried out exchanged for one for :meth:`Engine.revision`; never blocks.

        How that ends is said by :meth:`Engine.revised`. False: it cannot be exchanged.
        """
        return False

    def run_requests(self, requests: Sequence[T]) -> Verdict:
        """Runs requests in one plan to its end, in the calling thread; the verdict says how it ended."""
        raise NotImplementedError

    def clean_up(self) -> None:
        """Removes the goals that a run has left, where that is possible now."""
        raise NotImplementedError

    @property
    def left(self) -> bool:
        """Whether a run has left something that :meth:`clean_up` could not remove yet."""
        return False


class Engine(Generic[T]):
    """Runs requests in one worker, as their agenda decides, and answers each once.

    :param stages: carry them out.
    :param on_status: called when what runs has changed, without a lock.
    :param on_queue: called when what waits has changed, without a lock.
    :param on_end: called with the verdict on each request whose run has ended, before it is published.
    :param on_answered: called likewise behind the answers: with the requests of one verdict, that verdict,
        and, for the first ones of a run that crashed, the error.
    :param agenda: decides; None: one without a clock.
    :param wake_at: called with the ROS time, s, at which :meth:`look` has to be called; None: not at all.
    :ivar agenda: what runs, stops or is paused may be read at any time, and breakpoints be set before a
        :meth:`look`. For what waits ask the engine; for a change :meth:`decide`.
    """

    def __init__(
        self,
        stages: Stages[T],
        on_status: Callable[[], None],
        on_queue: Callable[[], None],
        on_end: Callable[[T, Verdict], None],
        on_answered: Callable[[Sequence[T], Verdict, Optional[BaseException]], None],
        agenda: Optional[Agenda[T]] = None,
        wake_at: Callable[[Optional[float]], None] = lambda when: None,
    ) -> None:
        self._stages = stages
        self._on_status = on_status
        self._on_queue = on_queue
        self._on_end = on_end
        self._on_answered = on_answered
        self._changed = threading.Condition()  # held for each event, and to ask what waits
        self.agenda: Agenda[T] = agenda or Agenda()
        self._wake_at = wake_at
        self._over = threading.Event()  # the worker has ended

    def start(self) -> None:
        """Begins to run requests."""
        start_thread("executor", self._work)

    def shutdown(self, timeout: float) -> None:
        """Cancels what runs and answers what waits.

        :param timeout: s for the run to end, which a stall of the process does not use up.
        """
        self.decide(lambda agenda: agenda.close())
        wait_ticks(self._over.wait, timeout)

    @property
    def waiting(self) -> List[T]:
        """The requests that wait, in the order in which they would run."""
        with self._changed:
            return self.agenda.waiting

    def outlooks(self) -> List[Tuple[T, Outlook]]:
        """The requests that wait, as :attr:`waiting`, and what can be expected of each."""
        with self._changed:
            return self.agenda.outlooks()

    def lines(self) -> List[Tuple[T, Tuple[int, ...]]]:
        """The requests that wait, and what is before each, see :meth:`.Agenda.lines`."""
        with self._changed:
            return self.agenda.lines()

    def look(self) -> None:
        """Time has passed: decides what that changes."""
        self.decide(lambda agenda: [])

    def decide(self, event: Callable[[Agenda[T]], List[Decision]]) -> None:
        """Puts an event on the agenda and carries out what that decides; from any thread."""
        with self._changed:
            stopped = self.agenda.stopping
            answers = self._carry_out([*self.agenda.elapse(), *event(self.agenda)])
            stops = self.agenda.stopping and not stopped
            self._changed.notify_all()
        if stops:  # what stops may take its time, and say nothing
            self._tell(self._on_status)
        self._tell(self._on_queue)
        for request, verdict in answers.items():
            self._answer(request, verdict)

    def decide_on(
        self, wanted: Callable[[T], bool], event: Callable[[Agenda[T], T], List[Decision]]
    ) -> Optional[T]:
        """Likewise, for an event on one request; returns it. None: no such request waits or runs."""
        found: List[T] = []

        def decide(agenda: Agenda[T]) -> List[Decision]:
            both = [*agenda.waiting, *agenda.together]
            found[:] = [request for request in both if wanted(request)]
            return event(agenda, found[0]) if found else []

        self.decide(decide)
        return found[0] if found else None

    def achieved(self, requests: Sequence[T], verdict: Verdict) -> None:
        """The goals of some of the requests that run together hold: each but the last one ends now."""
        with self._changed:
            answers = self._carry_out(self.agenda.achieved(requests, verdict))
        self._conclude(answers, {}, None)

    def planned_again(self) -> List[T]:
        """The run is to be planned again, with requests that have come meanwhile; called by its stages.

        :return: all that run now.
        """
        with self._changed:
            wanted = self.agenda.planned_again()
        return self.revised(wanted)

    def revision(self) -> List[T]:
        """The requests for which the plan that is carried out should be, see :attr:`.Agenda.revision`."""
        with self._changed:
            return self.agenda.revision

    def revised(self, wanted: Sequence[T], refusal: Optional[Refusal] = None) -> List[T]:
        """The plan that is carried out is for these requests from now on, or cannot be.

        :param refusal: why it cannot be; None: it is.
        :return: all that run now.
        """
        with self._changed:
            before, agenda = self.agenda.together, self.agenda
            decided = agenda.not_revised(wanted, refusal) if refusal else agenda.revised(wanted)
            answers = self._carry_out(decided)
            members = agenda.together
            joined = [request for request in members if request not in before]
            for request in joined:  # before another event: it is under way from now on
                self._tell(partial(request.join, members[0]))
        for request in joined:
            self._tell(request.accept)
        self._conclude(answers, {}, None)
        return members

    def _carry_out(self, decisions: Sequence[Decision]) -> Dict[T, Verdict]:
        """Stops or revises the run, with the lock held; returns the answers, to be given without it."""
        stops = any(isinstance(decision, StopRun) for decision in decisions)
        if not stops and any(isinstance(decision, ReviseRun) for decision in decisions):
            stops = not self._stages.revise() and bool(self.agenda.not_revised(self.agenda.revision))
        if stops:
            self._tell(self._stages.cancel)
        self._set_alarm()
        answers = [decision for decision in decisions if isinstance(decision, AgendaAnswer)]
        return {cast(T, answer.ticket): answer.verdict for answer in answers}

    def _work(self) -> None:
        reported = ""  # the hold that was reported last
        while True:
            with self._changed:
                request = self.agenda.begin()
                requests = self.agenda.together
                self._set_alarm()
                held = self.agenda.breakpoints.held
                if request is None and held == reported:
                    if self.agenda.closing:
                        self._over.set()
                        return
                    left = self._stages.left
                    if self._changed.wait(TIDY_PERIOD if left else None) or not left:
                        continue
                unprepared = self._prepare(requests) if requests else None
            if held != reported:
                reported = held
                self._tell(self._on_status)
                if request is None:
                    continue
            if request is None:
                with failure_logged("what a request has left could not be removed"):  # it is tried again
                    self._stages.clean_up()
                continue
            verdict, error = (crashed(unprepared), unprepared) if unprepared else self._run(requests)
            self._finish(verdict, error)

    def _set_alarm(self) -> None:
        """Called with the lock held, whenever the agenda has changed."""
        self._tell(lambda: self._wake_at(self.agenda.next_change))

    def _prepare(self, requests: Sequence[T]) -> Optional[BaseException]:
        """Prepares a run, before a cancel can reach it; called with the lock held.

        Returns what that raised.
        """
        try:
            for request in requests:
                request.begin(requests)
            self._stages.prepare()
        except BaseException as error:  # the client gets its answer, and the worker continues
            return error
        return None

    def _run(self, requests: Sequence[T]) -> Tuple[Verdict, Optional[BaseException]]:
        try:
            for request in requests:
                request.accept()
            self._tell(self._on_queue)
            return self._stages.run_requests(requests), None
        except BaseException as error:  # the client gets its answer, and the worker continues
            try:
                self._stages.clean_up()
            except Exception as second:
                error.__context__ = second
            return crashed(error), error

    def _finish(self, verdict: Verdict, error: Optional[BaseException]) -> None:
        """Ends a run, and its requests unless they run again."""
        with self._changed:
            members = self.agenda.together
            final = self._carry_out(self.agenda.ended(verdict))
            self._changed.notify_all()
        again = {
            request: Verdict(Outcome.CANCELLED, (request.stop or _AGAIN).reason)
            for request in members
            if request not in final
        }
        self._conclude(final, again, error)

    def _conclude(
        self, final: Dict[T, Verdict], again: Dict[T, Verdict], error: Optional[BaseException]
    ) -> None:
        """Publishes the end of requests, answers them, and logs it.

        :param final: the verdicts on those that end.
        :param again: why others run again.
        """
        shown = {**again, **final}
        for request, verdict in shown.items():
            self._tell(partial(self._on_end, request, verdict))
        # Idle is published before the answer: a client that has the answer may rely on it.
        self._tell(self._on_status)
        self._tell(self._on_queue)
        for request, verdict in final.items():
            self._answer(request, verdict)
        alike: Dict[Verdict, List[T]] = {}
        for request, verdict in shown.items():
            alike.setdefault(verdict, []).append(request)
        for number, (verdict, requests) in enumerate(alike.items()):
            self._tell(partial(self._on_answered, requests, verdict, None if number else error))

    def _answer(self, request: T, verdict: Verdict) -> None:
        try:
            request.end(verdict)
        except BaseException as error:  # its client waits for an answer, whatever keeps this one from it
            log_failure("the executor continues")
            self._tell(partial(request.end, crashed(error)))

    @staticmethod
    def _tell(callback: Callable[[], object]) -> None:
        """Calls a callback; when it fails, the request is answered and the next one begins all the same."""
        with failure_logged("the executor continues", BaseException):  # SMACH's states and users' code
            callback()
