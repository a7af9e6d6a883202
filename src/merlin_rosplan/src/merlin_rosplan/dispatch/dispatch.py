# SPDX-License-Identifier: Apache-2.0
"""Dispatching one plan: starts what the schedule allows, watches what runs, stops at the first failure.

One thread runs a dispatch and decides; all other threads only put events into its queue. So nothing polls,
and no decision is made with a lock held. All events in the queue are handled before conditions are checked.
"""

import contextlib
import math
import queue
import threading
from collections import deque
from typing import Any, Deque, Dict, FrozenSet, List, Optional, Set, Union

from merlin_pddl.breakpoints import Breakpoints
from merlin_ros.work.threads import log_failure
from merlin_rosplan.dispatch.coming_conditions import ComingConditions
from merlin_rosplan.dispatch.dispatch_environment import (
    CancelRequest,
    DispatchEnvironment,
    DispatchError,
    DispatchFailure,
    DispatchLimits,
    DispatchReport,
    DispatchState,
    Event,
    Exchange,
    Feedback,
    FeedbackStatus,
    KnowledgeChanged,
    RestWatch,
    Tick,
    together,
)
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
from merlin_rosplan.dispatch.dispatch_running import Running, broken_over_all
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction
from merlin_rosplan.dispatch.operator_model import Conditions

_NOTHING: FrozenSet[str] = frozenset()
_Queue = Union["queue.SimpleQueue[Event]", "queue.Queue[Event]"]


class PlanDispatch:
    """One run of a plan.

    :param schedule: the plan.
    :param environment: what it acts on and asks.
    :param limits: patience.
    :param plan_id: number of this run; feedback about another run is ignored. Feedback with plan id 0 is from
        ROSPlan's own interfaces, which do not set it: it counts once the interface has taken the action.
    :param events: where events come from, for a simulation that keeps its own time; None: a queue of its own.
    :param breakpoints: actions before which it is held; after a change of them it has to get a :class:`Tick`.
    :param watch: judges whether the rest of the plan still fits the world; None: each action is judged at its
        start.
    """

    def __init__(
        self,
        schedule: GraphSchedule,
        environment: DispatchEnvironment,
        limits: DispatchLimits,
        plan_id: int = 0,
        events: "Optional[queue.Queue[Event]]" = None,
        breakpoints: Optional[Breakpoints] = None,
        watch: Optional[RestWatch] = None,
    ) -> None:
        self.plan_id = plan_id
        self._watch = watch
        self._schedule = schedule
        self._environment = environment
        self._limits = limits
        self._events: _Queue = queue.SimpleQueue() if events is None else events  # its thread wakes sooner
        self._breakpoints = Breakpoints() if breakpoints is None else breakpoints
        self._taken_in: Deque[Event] = deque()  # taken from the queue and not handled
        self._cancelled = threading.Event()
        self._suspended = threading.Event()
        self._running: Dict[int, Running] = {}
        self._failure: Optional[DispatchFailure] = None
        self._robot_left: Optional[DispatchFailure] = None  # what runs continues, and nothing else starts
        self._began = 0.0
        self._done = 0
        self._succeeded: Set[int] = set()
        self._used = set(schedule.actions)  # ids that no action of another plan may have
        self._unpublished = False  # whether the report has changed since it was published
        self._changes: Optional[FrozenSet[str]] = _NOTHING  # names that changed since over-all was checked
        self._last: Optional[PlannedAction] = None
        self._unanswered: List[PlannedAction] = []
        self._unstopped: List[PlannedAction] = []
        self._coming = ComingConditions(environment, schedule, limits.settle)
        self._overtaken: Dict[int, Any] = {}  # deadlines of ends that came before what must come first
        self.ended = threading.Event()

    # --- from any thread --------------------------------------------------------------------------

    def put(self, event: Event) -> None:
        """Passes an event to the dispatch."""
        self._events.put(event)

    def cancel(self, reason: str = "cancelled") -> None:
        """Stops the dispatch: no further action starts, running ones get a cancel."""
        self._cancelled.set()
        self._events.put(CancelRequest(reason))

    def exchange(self, wish: Exchange) -> None:
        """Has another plan take the place of what has not begun; the wish says how that ended."""
        self._events.put(wish)
        if self.ended.is_set():  # nothing else would answer it
            self._refuse_late()

    def suspend(self, suspended: bool) -> None:
        """While it is suspended no further action starts; what runs continues."""
        if suspended:
            self._suspended.set()
        else:
            self._suspended.clear()
            self._events.put(Tick())

    # --- the dispatch's own thread ----------------------------------------------------------------

    def run(self) -> DispatchReport:
        """Runs the plan to its end, however that comes. Raises nothing of its own."""
        try:
            self._began = self._environment.now()
            self._schedule.begin(self._began)
            self._unpublished = True  # it is published with the first actions
            self._loop()
        except DispatchError as error:
            self._fail(str(error))
        except Exception:  # whatever it was, what runs is stopped and the caller gets an answer
            self._fail(log_failure(f"dispatch {self.plan_id}"))
        try:
            if self._failure is not None:
                self._stop_running()
        finally:
            failed = self._failure is not None and self._failure.state == DispatchState.FAILED
            self._breakpoints.ended(stepping=failed)  # a plan that failed may be replaced
            self._environment.wake_at(None)
            if self._last is not None:
                self._environment.close(self._last)
            self.ended.set()
            self._refuse_late()
        return self._report()

    def _loop(self) -> None:
        while self._failure is None:
            self._look_at_rest()
            if self._failure is not None:
                return
            looked = self._start_ready()
            if not self._running:
                self._failure = self._failure or self._robot_left
            if self._failure is not None or (self._schedule.finished and not self._running):
                return
            if self._unpublished:
                self._report()
            self._environment.wake_at(self._wake_time(looked))
            self._take_in(self._patience())
            self._handle_all()
            if self._failure is None:
                self._judge()

    def _take_in(self, patience: float) -> None:
        """Waits for an event, and takes all events that have arrived."""
        with contextlib.suppress(queue.Empty):
            wait = None if math.isinf(patience) else max(patience, 0.001)
            self._taken_in.append(self._events.get(timeout=wait))
            while True:
                self._taken_in.append(self._events.get_nowait())

    def _patience(self) -> float:
        """Seconds until one of the running actions may have to be given up."""
        running = self._running.values()
        patience = min([math.inf, *(each.patience() for each in running), *self._coming.time_left(running)])
        for action_id in self._schedule.awaited():
            record = self._running[action_id]
            if record.applied is not None:
                patience = min(patience, record.applied.remaining())
        return min([patience, *(deadline.remaining() for deadline in self._overtaken.values())])

    def _wake_time(self, looked: float) -> Optional[float]:
        times = self._coming.changes_after(looked)
        scheduled = self._schedule.wake_time(looked)
        return min(times if scheduled is None else [scheduled, *times], default=None)

    # --- starting -----------------------------------------------------------------------------------

    def _start_ready(self) -> float:
        """Starts what may start; returns the ROS time at which it looked last."""
        tried: Set[int] = set()
        now = self._environment.now()
        while self._failure is None and not self._cancelled.is_set():
            self._see_starts(now)
            if self._suspended.is_set() or self._robot_left is not None or self._leaving:
                return now
            ready = [action for action in self._schedule.ready(now) if action.id not in tried]
            if self._watch is not None and self._watch.skipped and self._skip(ready, now):
                continue
            if self._breakpoints.armed:
                held = self._breakpoints.held
                ready = [ready[index] for index in self._breakpoints.admit([str(each) for each in ready])]
                self._unpublished = self._unpublished or self._breakpoints.held != held
            if not ready:
                break
            tried.update(action.id for action in ready)
            self._start_all(ready)
            now = self._environment.now()
        waits = self._breakpoints.held or self._cancelled.is_set() or self._coming.expected
        idle = not self._running and not waits
        if idle and not self._schedule.finished and self._wake_time(now) is None and not self._overtaken:
            waiting = self._schedule.waiting()
            if waiting:
                self._fail(f"the plan cannot continue: no action runs, and {waiting[0]} waits forever")
        return now

    def _skip(self, ready: List[PlannedAction], now: float) -> bool:
        """Passes over what is not needed any more; whether there was something."""
        assert self._watch is not None
        skipped = [action for action in ready if action.id in self._watch.skipped]
        for action in skipped:
            self._schedule.started(action.id, now)
            self._schedule.ended(action.id, now)
            self._watch.ended(action.id)
            self._done += 1
            self._unpublished = True
        return bool(skipped)

    def _look_at_rest(self) -> None:
        verdict = None if self._watch is None or self._leaving else self._watch.look()
        if verdict is None:
            return
        if verdict.achieved:
            self._failure = DispatchFailure(DispatchState.SUCCEEDED, verdict.reason)
            return
        self._fail(verdict.reason, verdict.action)

    def _see_starts(self, now: float) -> None:
        for action_id in self._schedule.awaited():
            if self._running[action_id].start_applied(self._environment):
                self._schedule.seen(action_id, now)

    def _start_all(self, ready: List[PlannedAction]) -> None:
        """Starts those whose conditions hold, up to one that cannot start."""
        records = [
            Running(action, self._environment.operator(action), self._environment, self._limits)
            for action in ready
        ]
        needed = [(record.action, record.operator.at_start + record.watched) for record in records]
        together: List[Running] = []
        for record, unmet in zip(records, self._environment.false_of_each(needed)):
            if unmet.empty:
                together.append(record)
                continue
            self._send(together)
            together = []
            if self._cancelled.is_set():
                return
            robot = self._environment.robot_left(record.action, unmet)  # no action brings it back
            running = self._running.values()
            if not robot and self._coming.may_come(record.action, unmet, self._began, running):
                continue
            self._environment.publish_feedback(record.action, FeedbackStatus.PRECONDITION_FALSE)
            self._fail(f"{record.action} cannot start: {unmet.as_false()}", record.action, robot)
            return
        self._send(together)

    def _send(self, records: List[Running]) -> None:
        if not records or self._cancelled.is_set():
            return
        for record in records:
            self._coming.came(record.action.id)
            self._running[record.action.id] = record
            if self._watch is not None:
                self._watch.started(record.action.id)
        for record in records:
            action = self._last = record.action
            self._environment.send(action)
            self._environment.publish_feedback(action, FeedbackStatus.ENABLED)
            if self._breakpoints.armed:
                self._breakpoints.began(str(action))
            self._schedule.started(action.id, self._environment.now(), record.seen_at_once)
        self._report()  # behind them: an interface that has just started begins when it names the action

    # --- what happens -------------------------------------------------------------------------------

    def _handle_all(self) -> None:
        while self._taken_in and self._failure is None:
            event = self._taken_in.popleft()
            if isinstance(event, CancelRequest):
                self._failure = DispatchFailure(DispatchState.CANCELLED, event.reason)
            elif isinstance(event, Feedback):
                self._feedback(event)
            elif isinstance(event, Exchange):
                event.carry_out(self._take_plan)
            elif isinstance(event, KnowledgeChanged):
                if self._watch is not None:
                    self._watch.changed(event)
                self._changes = together(self._changes, event.names)
                for record in self._running.values():
                    record.changed(event.names)

    def _judge(self) -> None:
        """Looks for what went wrong, with everything known that has arrived."""
        affected = [record for record in self._running.values() if record.is_affected(self._changes)]
        self._changes = _NOTHING
        self._check_over_all(affected)
        late = self._schedule.late(self._environment.now())
        if late is not None and self._robot_left is None:
            self._fail(f"a time bound of the plan is broken: {late}")
        self._check_order()
        for record in list(self._running.values()):
            if self._failure is None:
                self._check_interface(record)

    def _feedback(self, feedback: Feedback) -> None:
        record, status = self._meant(feedback), feedback.status
        if record is None:
            return
        if record.leaving is not None:
            self._unpublished = True
            if status == FeedbackStatus.FAILED and feedback.unstopped:
                self._fail(f"{record.action} was cancelled and did not stop", record.action)
            return self._answer(feedback)
        if status == FeedbackStatus.SUCCEEDED:
            if record.is_affected(self._changes):  # while it still ran
                self._check_over_all([record])
            self._done += 1
            self._succeeded.add(feedback.action_id)
            self._unpublished = True
            del self._running[feedback.action_id]
            self._check_end(record)
            self._schedule.ended(feedback.action_id, self._environment.now())
            if self._watch is not None:
                self._watch.ended(feedback.action_id)
        elif status == FeedbackStatus.FAILED:
            del self._running[feedback.action_id]
            named = feedback.reason.startswith(str(record.action))
            failed = "" if named else f"{record.action} failed{': ' if feedback.reason else ''}"
            why = f"{failed}{feedback.reason}"
            self._fail(why, record.action, feedback.robot)
        elif status in (FeedbackStatus.ENABLED, FeedbackStatus.DISPATCHED_TO_START_STATE):
            if record.applied is None:
                record.applied = self._environment.deadline(self._limits.settle)
            record.take(self._environment, self._limits.liveness)

    def _meant(self, feedback: Feedback) -> Optional[Running]:
        """The action that it is about; None: it is of an earlier run, or repeated."""
        record = self._running.get(feedback.action_id)
        if record is None or feedback.plan_id not in (0, self.plan_id):
            return None
        final = feedback.status in (FeedbackStatus.SUCCEEDED, FeedbackStatus.FAILED)
        if final and not record.taken and feedback.plan_id != self.plan_id:
            return None  # latched since an earlier run: interfaces first say that they have taken an action
        return record

    # --- another plan -------------------------------------------------------------------------------

    @property
    def _leaving(self) -> bool:
        """Whether an action has not stopped yet that is not part of the plan: the world is not settled."""
        return any(record.leaving is not None for record in self._running.values())

    def _take_plan(self, wish: Exchange) -> str:
        """Goes on with another plan, and cancels what runs and is not part of it; returns why not."""
        if self._robot_left is not None:
            return self._robot_left.reason
        running = [record for record in self._running.values() if record.leaving is None]
        ongoing = wish.ongoing([record.action for record in running], self._succeeded, self._used)
        applied = [each.seen_at_once or each.start_applied(self._environment) for each in running]
        schedule, watch = wish.make(ongoing)
        self._used |= schedule.actions.keys()
        self._schedule, self._watch = schedule, watch
        self._coming = ComingConditions(self._environment, schedule, self._limits.settle)
        self._done, self._overtaken = 0, {}
        self._began = now = self._environment.now()
        schedule.begin(now)
        for record, seen in zip(running, applied):
            if record.action.id not in schedule.actions:
                record.leaving = self._environment.deadline(self._limits.cancel)
                self._environment.send_cancel(record.action)
                continue
            schedule.started(record.action.id, now, seen)
            if watch is not None:
                watch.started(record.action.id)
        self._report()
        return ""

    def _refuse_late(self) -> None:
        """Answers the wishes that come behind the end."""
        with contextlib.suppress(queue.Empty):
            while True:
                self._answer(self._events.get_nowait())

    # --- what must not happen -----------------------------------------------------------------------

    def _check_over_all(self, records: List[Running]) -> None:
        for record, reason in broken_over_all(records, self._environment, self._limits):
            self._fail(reason, record.action)

    def _check_end(self, record: Running) -> None:
        """Fails when an action has ended without what it needs then.

        While others run, one of them may have changed that since, as planned: the order of the ends is what
        keeps it right.
        """
        needed = Conditions() if self._running else record.needed_at_end
        if needed.empty:
            return
        false = self._environment.false_of(record.action, needed)
        if not false.empty:
            self._fail(f"{record.action} has ended, but {false.as_false()}", record.action)

    def _check_order(self) -> None:
        """Fails when an action has ended too early for the plan; news of two ends may arrive out of order."""
        overtaken = {found.action_id: found for found in self._schedule.overtaken()}
        self._overtaken = {
            action_id: self._overtaken.get(action_id)
            or self._environment.deadline(self._limits.over_all_grace)
            for action_id in overtaken
        }
        for action_id, found in overtaken.items():
            if found.certain or self._overtaken[action_id].remaining() <= 0:
                self._fail(found.text, self._schedule.actions[action_id])

    def _check_interface(self, record: Running) -> None:
        fault = record.fault(self._environment, self._limits)
        if fault is not None:
            self._fail(fault.reason, record.action)
            if fault.gone:
                del self._running[record.action.id]
        # An interface that has just started takes what is latched for an action of an earlier run.
        elif record.asks_again() and self._environment.just_announced(record.action.name):
            self._environment.send(record.action)

    def _fail(self, reason: str, action: Optional[PlannedAction] = None, robot: str = "") -> None:
        """Ends the dispatch; because of a robot that has left, once the others' actions have ended."""
        failure = DispatchFailure(DispatchState.FAILED, reason, action)
        if robot:
            self._robot_left = self._robot_left or failure
        else:
            self._failure = self._failure or failure

    # --- stopping -----------------------------------------------------------------------------------

    def _stop_running(self) -> None:
        """Sends cancels to the running interfaces and waits for their answers."""
        while self._taken_in:
            self._answer(self._taken_in.popleft())
        if not self._running:
            return
        for record in self._running.values():
            self._environment.send_cancel(record.action)
        deadline = self._environment.deadline(self._limits.cancel)
        self._report(DispatchState.CANCELLING)
        while self._running:
            left = deadline.remaining()
            if left <= 0:
                break
            self._take_in(min(left, 1.0))  # an interface that died is noticed within a second
            answered = len(self._running)
            while self._taken_in:
                self._answer(self._taken_in.popleft())
            for record in list(self._running.values()):
                if record.is_dead(record.silence(self._environment), self._limits.liveness):
                    self._give_up(record)
            if len(self._running) < answered:
                self._report(DispatchState.CANCELLING)
        for record in list(self._running.values()):
            self._give_up(record)

    def _give_up(self, record: Running) -> None:
        self._unanswered.append(record.action)
        del self._running[record.action.id]

    def _answer(self, feedback: Event) -> None:
        if isinstance(feedback, Exchange):
            feedback.carry_out(lambda _: "the plan ends, or has ended")
        if not isinstance(feedback, Feedback):
            return
        record = self._meant(feedback)
        if record is None:
            return
        if feedback.status == FeedbackStatus.SUCCEEDED and record.leaving is None:
            self._done += 1
            self._schedule.ended(feedback.action_id, self._environment.now())
        if feedback.unstopped and not (self._failure and self._failure.action is record.action):
            self._unstopped.append(record.action)  # otherwise the failure names it
        if feedback.status in (FeedbackStatus.SUCCEEDED, FeedbackStatus.FAILED):
            del self._running[feedback.action_id]
        else:
            record.taken = True

    def _report(self, state: Optional[DispatchState] = None) -> DispatchReport:
        self._unpublished = False
        running = [each.action for each in sorted(self._running.values(), key=lambda each: each.ends)]
        report = DispatchReport.of(
            state, self._failure, self._schedule, running, self._done, self._unanswered, self._unstopped
        )
        self._environment.changed(report)
        return report
