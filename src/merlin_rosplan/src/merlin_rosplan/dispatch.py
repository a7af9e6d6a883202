"""Dispatching one plan: starts what the schedule allows, watches what runs, stops at the first failure.

One thread runs a dispatch and decides; everybody else only puts events into its queue. So nothing polls, and
no decision is made with a lock held.
"""

import logging
import math
import queue
import threading
from dataclasses import dataclass
from typing import Any, Dict, FrozenSet, List, Optional, Set

from merlin_rosplan.dispatch_outside import (
    Cancel,
    DispatchError,
    DispatchLimits,
    DispatchReport,
    DispatchState,
    Event,
    Feedback,
    FeedbackStatus,
    KnowledgeChanged,
    Outside,
)
from merlin_rosplan.dispatch_schedule import PlannedAction, Schedule
from merlin_rosplan.operator_model import Conditions, Operator, broken_by_own_end, over_all_before_start

_log = logging.getLogger(__name__)


@dataclass
class _Running:
    """An action that was dispatched and has not ended."""

    action: PlannedAction
    operator: Operator
    acknowledge: Any
    accept: Any
    watched: Conditions
    settle: Any
    pending: Conditions  # over-all conditions that the start effects bring about; watched once seen true
    names: FrozenSet[str] = frozenset()
    taken: bool = False
    alive: Optional[Any] = None  # until then its interface is alive, having taken the action
    sent_again: bool = False
    grace: Optional[Any] = None
    broken: str = ""


@dataclass
class _Failure:
    state: DispatchState
    reason: str
    action: Optional[PlannedAction] = None


class Dispatch:
    """One run of a plan.

    Parameters
    ----------
    schedule: the plan.
    outside: the world.
    limits: patience.
    plan_id: number of this run; feedback about another run is ignored. Feedback with plan id 0 is from
        ROSPlan's own interfaces, which do not set it: it counts once the interface has taken the action.
    """

    def __init__(
        self, schedule: Schedule, outside: Outside, limits: DispatchLimits, plan_id: int = 0
    ) -> None:
        self.plan_id = plan_id
        self._schedule = schedule
        self._outside = outside
        self._limits = limits
        self._events: queue.Queue[Event] = queue.Queue()
        self._cancelled = threading.Event()
        self._running: Dict[int, _Running] = {}
        self._failure: Optional[_Failure] = None
        self._done = 0
        self._last: Optional[PlannedAction] = None
        self._unanswered: List[PlannedAction] = []
        self._unsettled: Set[int] = set()  # actions whose conditions may be about to come true
        self._literals: Dict[int, Any] = {}  # deadlines of their timed literals
        self.ended = threading.Event()

    # --- from any thread --------------------------------------------------------------------------

    def put(self, event: Event) -> None:
        """Tells the dispatch that something has happened."""
        self._events.put(event)

    def cancel(self, reason: str = "cancelled") -> None:
        """Stops the dispatch: no further action starts, running ones are told to stop."""
        self._cancelled.set()
        self._events.put(Cancel(reason))

    # --- the dispatch's own thread ----------------------------------------------------------------

    def run(self) -> DispatchReport:
        """Runs the plan to its end, however that comes. Raises nothing of its own."""
        try:
            self._schedule.begin(self._outside.now())
            self._report()
            self._loop()
        except DispatchError as error:
            self._fail(str(error))
        except Exception as error:  # whatever it was, what runs is stopped and the caller gets an answer
            _log.exception("dispatch %d", self.plan_id)
            self._fail(f"{type(error).__name__}: {error}")
        try:
            if self._failure is not None:
                self._stop_running()
        finally:
            self._outside.wake_at(None)
            if self._last is not None:
                self._outside.close(self._last)
            self.ended.set()
        report = self._report()
        return report

    def _loop(self) -> None:
        while self._failure is None:
            looked = self._start_ready()
            if self._failure is not None or (self._schedule.finished and not self._running):
                return
            self._outside.wake_at(self._schedule.wake_time(looked))
            self._handle(self._next_event())

    def _next_event(self) -> Optional[Event]:
        try:
            patience = self._patience()
            return self._events.get(timeout=None if math.isinf(patience) else max(patience, 0.001))
        except queue.Empty:
            return None

    def _patience(self) -> float:
        """Seconds until one of the running actions may have to be given up."""
        patience = math.inf
        for record in self._running.values():
            if not record.taken:
                first = record.acknowledge.remaining()
                patience = min(patience, first if first > 0 else min(record.accept.remaining(), 1.0))
            else:
                patience = min(patience, 1.0)  # its interface may die in silence
            if record.grace is not None:
                patience = min(patience, record.grace.remaining())
        for action_id in self._unsettled:
            patience = min([patience, *self._settling(action_id)])
        return patience

    def _start_ready(self) -> float:
        """Starts what may start; returns the ROS time at which it looked last."""
        tried: Set[int] = set()
        now = self._outside.now()
        while not self._cancelled.is_set():
            ready = [action for action in self._schedule.ready(now) if action.id not in tried]
            if not ready:
                break
            for action in ready:
                tried.add(action.id)
                if self._cancelled.is_set() or not self._start(action):
                    return now
            now = self._outside.now()
        idle = not self._running and not self._unsettled and not self._cancelled.is_set()
        if idle and not self._schedule.finished and self._schedule.wake_time(now) is None:
            waiting = self._schedule.waiting()
            if waiting:
                self._fail(f"the plan cannot go on: nothing runs, and {waiting[0]} waits for what never ends")
        return now

    def _start(self, action: PlannedAction) -> bool:
        operator = self._outside.operator(action)
        first = over_all_before_start(operator)
        needed = operator.at_start + first
        unmet = self._outside.false_of(action, needed)
        if self._cancelled.is_set():
            return False
        if not unmet.empty and self._may_settle(action):
            return True
        self._unsettled.discard(action.id)
        if not unmet.empty:
            self._outside.tell(action, FeedbackStatus.PRECONDITION_FALSE)
            self._fail(f"{action} cannot start: {unmet.as_false()}", action)
            return False
        self._running[action.id] = _Running(
            action,
            operator,
            self._outside.deadline(self._limits.acknowledge),
            self._outside.deadline(self._limits.accept),
            first,
            self._outside.deadline(self._limits.settle),
            operator.over_all - first,
            operator.over_all.names,
        )
        self._last = action
        self._report()  # first: an interface that has just started asks the status whether it is meant
        self._outside.send(action)
        self._outside.tell(action, FeedbackStatus.ENABLED)
        self._schedule.started(action.id, self._outside.now())
        return True

    def _may_settle(self, action: PlannedAction) -> bool:
        """Whether what the action needs may be on its way: a timed literal, or start effects of what runs."""
        if action.id not in self._literals and self._schedule.waits_for_time(action.id):
            self._literals[action.id] = self._outside.deadline(self._limits.settle)
        self._unsettled.add(action.id)
        return bool(self._settling(action.id))

    def _settling(self, action_id: int) -> List[float]:
        """Seconds that are left for each thing that may make an action's conditions true."""
        deadlines = [record.settle for record in self._running.values()]
        if action_id in self._literals:
            deadlines.append(self._literals[action_id])
        return [left for left in (deadline.remaining() for deadline in deadlines) if left > 0]

    def _handle(self, event: Optional[Event]) -> None:
        if isinstance(event, Cancel):
            self._failure = _Failure(DispatchState.CANCELLED, event.reason)
            return
        if isinstance(event, Feedback):
            self._feedback(event)
        elif isinstance(event, KnowledgeChanged):
            self._watch_over_all(event)
        if self._failure is None:
            late = self._schedule.late(self._outside.now())
            if late is not None:
                self._fail(f"a time bound of the plan is broken: {late}")
        for record in list(self._running.values()):
            if self._failure is None:
                self._check_interface(record)

    def _feedback(self, feedback: Feedback) -> None:
        record = self._running.get(feedback.action_id)
        if record is None or feedback.plan_id not in (0, self.plan_id):
            return  # of an earlier run, or an answer told twice
        status = feedback.status
        final = status in (FeedbackStatus.SUCCEEDED, FeedbackStatus.FAILED)
        if final and not record.taken and feedback.plan_id != self.plan_id:
            return  # latched since an earlier run: interfaces report that they have taken an action first
        if status == FeedbackStatus.SUCCEEDED:
            self._done += 1
            del self._running[feedback.action_id]
            self._schedule.ended(feedback.action_id, self._outside.now())
            self._report()
        elif status == FeedbackStatus.FAILED:
            del self._running[feedback.action_id]
            why = f": {feedback.reason}" if feedback.reason else ""
            self._fail(f"{record.action} failed{why}", record.action)
        elif status in (FeedbackStatus.ENABLED, FeedbackStatus.DISPATCHED_TO_START_STATE):
            record.taken = True
            record.alive = self._outside.deadline(self._limits.liveness)

    def _watch_over_all(self, event: KnowledgeChanged) -> None:
        for record in list(self._running.values()):
            if record.names and (event.names is None or record.names & event.names):
                self._check_over_all(record)
                if self._failure is not None:
                    return

    def _check_over_all(self, record: _Running) -> None:
        pending = record.pending
        if not pending.empty:
            still = self._outside.false_of(record.action, pending)
            record.pending = still
            record.watched += pending - still
        if record.watched.empty:
            return
        broken = self._outside.false_of(record.action, record.watched)
        if broken.empty:
            record.grace = None
            return
        own = (
            all(broken_by_own_end(record.operator, atom, False) for atom in broken.positive)
            and all(broken_by_own_end(record.operator, atom, True) for atom in broken.negative)
            and all(entry.functions & record.operator.end_effects.functions for entry in broken.comparisons)
            and all(entry.reads & record.operator.end_effects.names for entry in broken.expressions)
        )
        record.broken = broken.as_false()
        if not own:
            self._fail(f"{record.action} cannot go on: {record.broken}", record.action)
        elif record.grace is None:
            # Interfaces apply the end effects before they report the end.
            record.grace = self._outside.deadline(self._limits.over_all_grace)

    def _check_interface(self, record: _Running) -> None:
        action = record.action
        silence = self._outside.silence(action.name)
        unanswered = not record.taken and record.acknowledge.remaining() <= 0
        if record.grace is not None and record.grace.remaining() <= 0:
            self._fail(f"{action} cannot go on: {record.broken}", action)
        elif unanswered and silence is None:
            self._fail(f"no action interface for {action.name}", action)
            del self._running[action.id]
        elif self._dead(record, silence) and (record.taken or unanswered):
            self._fail(f"the action interface of {action.name} is gone, silent for {silence:.1f} s", action)
            del self._running[action.id]
        elif unanswered and not record.sent_again:
            # An interface that has just started takes what is latched for an action of an earlier run.
            record.sent_again = True
            if self._outside.young(action.name):
                self._outside.send(action)
        elif not record.taken and record.accept.remaining() <= 0:
            self._fail(
                f"the action interface of {action.name} is alive but did not take {action} "
                f"within {self._limits.accept:g} s",
                action,
            )

    def _dead(self, record: _Running, silence: Optional[float]) -> bool:
        """Whether an interface that announced itself has stopped; taking an action is a sign of life too."""
        liveness = self._limits.liveness
        if silence is None or liveness is None or silence <= liveness:
            return False
        return record.alive is None or record.alive.remaining() <= 0

    def _fail(self, reason: str, action: Optional[PlannedAction] = None) -> None:
        if self._failure is None:
            self._failure = _Failure(DispatchState.FAILED, reason, action)

    def _stop_running(self) -> None:
        """Tells the running interfaces to stop and waits for their answers."""
        if not self._running:
            return
        self._report(DispatchState.CANCELLING)
        for record in self._running.values():
            self._outside.send_cancel(record.action)
        deadline = self._outside.deadline(self._limits.cancel)
        while self._running:
            left = deadline.remaining()
            if left <= 0:
                break
            try:
                # Who dies in silence is noticed every second.
                event = self._events.get(timeout=min(left, 1.0))
            except queue.Empty:
                event = None
            if isinstance(event, Feedback):
                self._answer(event)
            for record in list(self._running.values()):
                if self._dead(record, self._outside.silence(record.action.name)):
                    self._give_up(record)
        for record in list(self._running.values()):
            self._give_up(record)

    def _give_up(self, record: _Running) -> None:
        self._unanswered.append(record.action)
        del self._running[record.action.id]

    def _answer(self, feedback: Feedback) -> None:
        record = self._running.get(feedback.action_id)
        if record is None or feedback.plan_id not in (0, self.plan_id):
            return
        if feedback.status == FeedbackStatus.SUCCEEDED:
            self._done += 1
            self._schedule.ended(feedback.action_id, self._outside.now())
        if feedback.status in (FeedbackStatus.SUCCEEDED, FeedbackStatus.FAILED):
            del self._running[feedback.action_id]
            self._report(DispatchState.CANCELLING)
        else:
            record.taken = True

    def _report(self, state: Optional[DispatchState] = None) -> DispatchReport:
        failure = self._failure
        total = len(self._schedule.actions)
        if state is None:
            if failure is None:
                done = self._schedule.finished and not self._running
                state = DispatchState.SUCCEEDED if done else DispatchState.RUNNING
            elif failure.state == DispatchState.CANCELLED and self._schedule.finished:
                state = DispatchState.SUCCEEDED
            else:
                state = failure.state
        reason = failure.reason if failure is not None else f"{self._done} of {total} actions done"
        if failure is not None and state == DispatchState.SUCCEEDED:
            reason = "the last action had ended when the cancel came through"
        if self._unanswered:
            names = ", ".join(str(action) for action in self._unanswered)
            reason += f"; no answer to the cancel from {names}"
        report = DispatchReport(
            state,
            reason,
            tuple(record.action for record in self._running.values()),
            self._done,
            total,
            failure.action if failure is not None else None,
            tuple(self._unanswered),
        )
        self._outside.changed(report)
        return report
