# SPDX-License-Identifier: Apache-2.0
"""Dispatches a plan, follows its actions, and cancels it, over our dispatchers and ROSPlan's own."""

import threading
from functools import partial
from typing import AbstractSet, Callable, FrozenSet, List, Optional, Sequence, Set, Tuple

import rospy
from merlin_msgs.msg import DispatchStatus, RunningAction
from merlin_msgs.srv import ExchangePlan
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback, NonBlockingDispatchAction
from rospy.core import is_shutdown_requested
from std_srvs.srv import Empty

from merlin_planning.action_messages import answer_in, cancel_of, dispatched_action, reply_of
from merlin_planning.dispatch_progress import CANCEL_ACTION, PART, Action, DispatchProgress, DispatchResult
from merlin_planning.dispatcher_kind import DispatcherKind, Hold, ReportingDispatcher
from merlin_planning.knowledge_client import DEFAULT_KNOWLEDGE_BASE
from merlin_planning.over_rosplan import SilentDispatcher
from merlin_planning.planning_client import Interruptible
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.actions.lease import LeaseChange, LeaseState
from merlin_ros.actions.lease_watch import LeaseWatch
from merlin_ros.deadline import Deadline, limit, running_time
from merlin_ros.publishing import publish
from merlin_ros.service_proxy import ServiceError, ServiceProxy, ServiceUnavailable

BEGIN_WAIT = 1.0  # s of running time for the first action of a plan that is to be cancelled to be seen
STATUS_GRACE = 0.5  # s of running time for the dispatcher's status behind its answer
ANSWER_GRACE = 0.3  # s of running time for an interface's answer behind the end of the dispatch
ORPHAN_GRACE = 1.0  # s of running time for the actions of a dispatcher that is gone to end
SLACK = 1.0  # s that a dispatcher gets beyond its own cancel deadline
STUCK_AFTER = 20.0  # s of running time without an action under way, for a dispatcher without status
FOREIGN_WAIT = 6.0  # s of running time for the plan of another client to end, where a cancel has no limit
OWNER_LOOK = 0.5  # s between two looks whether the owner of a foreign dispatch still lives
EXCHANGE_LIMIT = 12.0  # s for the dispatcher to exchange a plan; it gives up before
LISTEN = 1.0  # s after which a client has received the lease of any other owner of the dispatch
INTERRUPTED = "cancelled while another plan was carried out"
WITHDRAWN = "cancelled before the plan was dispatched"
_BUSY = "is being dispatched already"


class DispatchClient:
    """Sends plans to one dispatcher, one at a time, follows their actions, and cancels them.

    A dispatcher that publishes its status gets a goal of ``dispatch_plan_action``, which this client leases.
    The others are ROSPlan's own, and get the call of a service.

    :param dispatcher: its name (scope).
    :param knowledge_base: where action interfaces announce themselves.
    :param cancel_deadline: s of running time for a cancelled dispatch to end; zero or less: no limit.
    :param stuck_after: s of running time without an action under way, after which a dispatch is given up at a
        dispatcher that would wait for ever, as ROSPlan's do; zero or less: never.
    :param on_change: called by a subscriber when the running actions, the steps done or the hold change, and
            when the dispatcher begins or ends.
    """

    def __init__(
        self,
        dispatcher: str = "rosplan_plan_dispatcher",
        knowledge_base: str = DEFAULT_KNOWLEDGE_BASE,
        cancel_deadline: float = 5.0,
        on_change: Callable[[], None] = lambda: None,
        stuck_after: float = STUCK_AFTER,
    ) -> None:
        self.name = rospy.resolve_name(dispatcher)
        self.cancel_deadline = cancel_deadline
        self._on_change = on_change
        self._cancel = ServiceProxy(f"{dispatcher}/cancel_dispatch", Empty, timeout=2.0)
        self._exchange = ServiceProxy(f"{dispatcher}/exchange_plan", ExchangePlan, timeout=EXCHANGE_LIMIT)
        self._begun = running_time()
        self._changed = threading.Condition()  # guards the fields below
        self._progress = DispatchProgress()
        self._active = self._cancelling = self._requested = False
        self._ended = True
        self._number = 0  # of the present dispatch
        self._plain = SilentDispatcher(
            self.name, rospy.resolve_name(knowledge_base), self._changed, self._call_cancel, stuck_after
        )
        server = ActionClient(f"{dispatcher}/dispatch_plan_action", NonBlockingDispatchAction)
        self._reporting = ReportingDispatcher(server)
        self._kind: DispatcherKind = self._plain  # until its first status
        actions = f"{dispatcher}/action_dispatch"
        self._cancel_publisher = rospy.Publisher(actions, ActionDispatch, queue_size=1000)
        for topic, message_class, callback in (
            ("action_dispatch", ActionDispatch, self._receive_dispatch),
            ("action_feedback", ActionFeedback, self._receive_feedback),
            ("dispatch_status", DispatchStatus, self._receive_status),
        ):
            rospy.Subscriber(f"{dispatcher}/{topic}", message_class, callback, tcp_nodelay=True)
        self._watch = LeaseWatch(f"{dispatcher}/lease", self._dispatcher_changed)
        self._owners = LeaseWatch(f"{dispatcher}/dispatch_plan_action/lease")

    def available(self) -> bool:
        """Whether the dispatcher is there now."""
        return self._plain.available()

    def wait_status(self, timeout: float) -> bool:
        """Waits for the dispatcher's first status, s of running time; ROSPlan's own publish none."""
        with self._changed:
            return Deadline(timeout).wait(self._changed, lambda: self._kind.reports)

    @property
    def running(self) -> List[RunningAction]:
        """The actions under way, in the order in which they are to end."""
        with self._changed:
            actions = self._progress.under_way if self._active else ()
            for action in actions:
                action.message.uninterruptible = action.id in self._progress.kept
            return [action.message for action in actions]

    @property
    def steps_done(self) -> int:
        """Actions of this dispatch that have succeeded."""
        return len(self._progress.succeeded)

    @property
    def succeeded(self) -> FrozenSet[int]:
        """Ids of these."""
        with self._changed:
            return frozenset(self._progress.succeeded)

    @property
    def ended(self) -> FrozenSet[int]:
        """Ids of all actions of this dispatch that have ended, also those of plans that were exchanged."""
        with self._changed:
            return frozenset(self._progress.ended)

    @property
    def begun(self) -> bool:
        """Whether the dispatcher has taken the plan of the present dispatch; known of one with a status."""
        with self._changed:
            return self._active and self._reporting.busy

    @property
    def unstopped(self) -> Tuple[str, ...]:
        """Actions of this dispatch that had to stop and may still run, as PDDL text."""
        with self._changed:
            return self._progress.unstopped(False)

    @property
    def hold(self) -> Hold:
        """Before which actions the dispatcher holds, and before which it will hold."""
        return self._reporting.hold

    @property
    def busy(self) -> bool:
        """Whether the dispatcher carries out a plan that this client does not wait for."""
        with self._changed:
            return self._busy()

    def free(
        self,
        interruptible: Interruptible,
        longest: Optional[float] = None,
        deadline: Optional[Deadline] = None,
    ) -> str:
        """Waits for the end of a dispatch that another client, or an earlier process of this one, has left.

        It is cancelled, unless its owner lives. The interruption ends the wait. Without a cancel deadline, an
        owner that lives still has an end to be waited for; only a dispatcher that took the cancel has none.

        :param longest: s of running time for that one to stop; None: no limit.
        :param deadline: of the wait; None: a little more than the cancel deadline.
        :return: why the dispatcher is still busy, as a sentence, or INTERRUPTED; empty when it is free.
        """
        deadline = deadline or self._foreign_wait()
        if not self.busy:
            return ""
        if not self.available():
            return f"{PART} {self.name} is gone"
        interrupted = threading.Event()

        def interrupt() -> None:
            interrupted.set()
            with self._changed:
                self._changed.notify_all()

        asked = gone = False
        interruptible(interrupt)
        try:
            while self.busy and not gone and not deadline.expired and not interrupted.is_set():
                if not asked and self._abandoned():
                    asked = True
                    rospy.logwarn(f"{self.name} carries out a plan that has no owner; it is cancelled")
                    if self._call_cancel() and limit(self.cancel_deadline) is None:
                        deadline = Deadline(longest)
                # A master that hangs does not matter for a dispatcher that was cancelled.
                gone = asked and not (self._cancel.connected or self.available())
                with self._changed:
                    look = Deadline(min(OWNER_LOOK, deadline.remaining()))
                    look.wait(self._changed, lambda: interrupted.is_set() or not self._busy())
        finally:
            interruptible(None)
        if interrupted.is_set() or not self.busy:
            return INTERRUPTED if interrupted.is_set() else ""
        if gone:
            return f"{PART} {self.name} is gone"
        owner = self._other_owner()
        if owner:
            return f"{PART} {self.name} carries out a plan of {owner}"
        return f"{PART} {self.name} carries out an earlier plan and does not stop"

    def dispatch(
        self, interruptible: Interruptible, plan: Sequence[ActionDispatch] = (), owner: Optional[str] = None
    ) -> DispatchResult:
        """Dispatches the present plan and waits for its end. The interruption cancels it.

        :param plan: what is meant. ROSPlan's dispatchers may still hold an older plan when they are called;
            one that begins with none of the actions that begin this plan is cancelled and dispatched again.
        :param owner: id of the goal of this process's own server on whose behalf it is dispatched.
        """
        foreign = self._foreign_wait()  # for all plans of others together
        busy = self.free(interruptible, deadline=foreign)
        result = self._refused(busy) if busy else self._dispatch_once(interruptible, plan, owner)
        if _BUSY in result.reason:  # another client was faster
            busy = self.free(interruptible, deadline=foreign)
            result = self._refused(busy) if busy else self._dispatch_once(interruptible, plan, owner)
        if self._stale(result):
            rospy.logwarn(f"{self.name} did not have the new plan yet; dispatching again")
            result = self._dispatch_once(interruptible, plan, owner)
        return result

    @property
    def can_exchange(self) -> bool:
        """Whether the dispatcher can replace the rest of a plan while actions go on; ROSPlan's own cannot."""
        return self._kind.reports

    def exchange(
        self,
        plan: Sequence[ActionDispatch],
        keep: Sequence[RunningAction],
        known: Optional[AbstractSet[int]] = None,
    ) -> str:
        """Replaces the rest of the plan that another thread dispatches, without a stop of what goes on.

        First the new plan is made: :attr:`running` is looked at, these actions are given to
        :meth:`.planning_client.PlanningClient.plan` as `after`, and the plan is parsed. Then this is called.
        What runs and is neither in `keep` nor a first step of the new plan is cancelled; what has not begun
        is dropped. The steps of the new plan begin when their conditions allow, behind what goes on where
        they need its effects.

        The call of :meth:`dispatch` goes on, and returns how the new plan ends; a cancel stops all of it.

        :param plan: the one that was parsed last.
        :param keep: of :attr:`running`: the actions that the new plan counts on. One that has succeeded
            meanwhile does no harm; with one that has failed the exchange is refused.
        :param known: ids of the actions that had begun when the plan was asked for. It is refused when
            another one has ended, or runs and is not a first step of it. None: all that have begun by now.
        :return: why the plan is not exchanged, as a sentence; empty: the new plan runs.
        """
        kept = {action.action_id for action in keep}
        with self._changed:
            goal = self._kind.goal() if self._active and not self._cancelling else ""
            if not goal:
                return f"{PART} {self.name} carries out no plan of this node that it could exchange"
            known = self._progress.ended | self._progress.running.keys() if known is None else known
            take_back = self._progress.exchange({*kept, *(action.action_id for action in plan)})
        try:
            refused = str(self._exchange(goal=goal, keep=sorted(kept), known=sorted(known)).refused)
        except ServiceError as error:
            refused = f"{PART} does not exchange its plan: {error}"
        if refused:
            with self._changed:
                take_back()
        else:
            self._on_change()
        return refused

    def hand_over(self, owner: str) -> None:
        """The dispatch that runs is on behalf of another goal of this process's own server from now on.

        :param owner: id of that goal.
        """
        with self._changed:
            if self._active:
                self._kind.goal(owner)

    def cancel(self) -> None:
        """Cancels the running dispatch; before it runs, as soon as it does. Never blocks.

        The thread that waits for the dispatch sends the cancel: a hung dispatcher costs its caller no time.
        """
        with self._changed:
            if self._active:
                self._requested = self._cancelling = True
                self._progress.stop()
                self._changed.notify_all()

    def _foreign_wait(self) -> Deadline:
        patience = limit(self.cancel_deadline)
        return Deadline(FOREIGN_WAIT if patience is None else patience + SLACK)

    def _refused(self, reason: str) -> DispatchResult:
        cancelled = reason == INTERRUPTED
        return DispatchResult(False, cancelled, reason=reason, gone=not cancelled and not self.available())

    # --- one dispatch ---------------------------------------------------------------------------------

    def _dispatch_once(
        self, interruptible: Interruptible, plan: Sequence[ActionDispatch], owner: Optional[str]
    ) -> DispatchResult:
        with self._changed:
            kind, number = self._kind, self._number
            self._progress = kind.begin(plan)
            self._active = True
            self._ended = self._cancelling = self._requested = False
        answers: List[object] = []

        def ended(answer: object) -> None:
            with self._changed:
                if number != self._number:
                    return
                if isinstance(answer, ClientGoal) and answer.hangs:
                    self._cancelling = True  # it has not ended
                else:
                    answers.append(answer)
                    self._ended = True
                self._changed.notify_all()

        interruptible(self.cancel)
        try:
            missing = kind.wait(plan, lambda: self._requested)
            with self._changed:
                if self._requested:
                    self._ended = True
                    return DispatchResult(False, cancelled=True, reason=WITHDRAWN)
            if missing:
                ended(ServiceUnavailable(missing))
            else:
                kind.send(ended, owner)
            if self._wait_for_end(kind):
                return self._result(answers[0])
            with self._changed:
                return self._progress.hung(self.name, self.cancel_deadline)
        finally:
            interruptible(None)
            with self._changed:
                self._active = False
                hangs, self._ended = not self._ended, True
                self._number += 1
            kind.end(hangs)
            self._on_change()

    def _wait_for_end(self, sent_by: DispatcherKind) -> bool:
        """False when a dispatch that is cancelled, or whose action failed, does not end in time.

        A dispatcher that is silent is cancelled: it may hang, and then nothing else would end this wait.

        :param sent_by: passes a cancel on; a status that comes meanwhile makes the dispatcher another kind.
        """
        patience = limit(self.cancel_deadline)
        # The dispatcher keeps the same deadline and names what did not answer; it gets a moment longer.
        slack = None if patience is None else patience + SLACK
        with self._changed:
            self._wait_while_it_runs()
            if not self._ended and not self._cancelling:
                grace = Deadline(self._kind.failure_grace(slack))
                grace.wait(self._changed, lambda: self._ended or self._cancelling)
                if self._kind.reports and not self._ended and not self._cancelling:
                    return False
                self._cancelling = True
            # ROSPlan's dispatchers lose a cancel that comes before the plan; that of a goal names the goal.
            begun = Deadline(BEGIN_WAIT if patience is None else min(BEGIN_WAIT, patience)).wait(
                self._changed, lambda: self._ended or self._kind.started(self._progress)
            )
        goes_on = not self._ended
        while goes_on:
            cancelled = self._cancel_actions(sent_by.cancel(self._progress))
            with self._changed:
                Deadline(slack).wait(self._changed, partial(self._over, begun, cancelled))
                goes_on, begun = not self._ended and self._over(begun, cancelled), True
        return self._ended

    def _over(self, begun: bool, cancelled: Set[int]) -> bool:
        """Whether it has ended, or was cancelled before it had begun, and has: that cancel was lost."""
        return self._ended or not (begun or self._progress.running.keys() <= cancelled)

    def _wait_while_it_runs(self) -> None:
        """Waits, with the lock held, while nothing has failed; a dispatch that stands still is cancelled."""
        progress = self._progress

        def over() -> bool:
            return self._ended or self._cancelling or bool(progress.failed)

        def changed(seen: int) -> bool:
            return over() or progress.messages != seen

        while not over() and not rospy.is_shutdown():
            patience = None if self._kind.reports else progress.patience
            deadline = Deadline(patience)
            deadline.wait(self._changed, partial(changed, progress.messages))
            if patience and deadline.expired and progress.patience and not self._kind.reports and not over():
                progress.stand_still(patience)
                rospy.logwarn(f"{progress.failed_reason}; the plan is cancelled")
                self._cancelling = True

    def _stale(self, result: DispatchResult) -> bool:
        """Whether a dispatcher of ROSPlan's ran something else than the plan that was meant."""
        with self._changed:
            if self._requested or result.goal_achieved or result.gone:
                return False
            return self._progress.other_plan and not self._kind.reports

    def _cancel_actions(self, actions: Sequence[Action]) -> Set[int]:
        for action in actions:
            publish(self._cancel_publisher, cancel_of(action))
        return {action.id for action in actions}

    def _call_cancel(self) -> bool:
        """Whether the dispatcher took the cancel."""
        try:
            self._cancel()
        except ServiceError as error:
            rospy.logwarn(f"cancel of {self.name}: {error}")
            return False
        return True

    def _stop_orphans(self) -> None:
        """Ends the actions of a dispatcher that is gone; they would run on until they miss it."""
        with self._changed:
            orphans = list(self._progress.running.values())
        self._cancel_actions(orphans)
        with self._changed:
            Deadline(ORPHAN_GRACE).wait(self._changed, lambda: not self._progress.running)
            if self._requested:  # then the answer says what has stopped
                patience = Deadline(limit(self.cancel_deadline))
                patience.wait(self._changed, lambda: not self._progress.unanswered)

    def _result(self, answer: object) -> DispatchResult:
        with self._changed:
            reply = reply_of(answer, self.name, self._progress.begun)
        if reply.gone and not is_shutdown_requested():  # then everything ends by itself
            self._stop_orphans()
        with self._changed:
            missing = partial(self._progress.answers_missing, achieved=reply.achieved)
            # A success that waits for no answer is one at once.
            if (not reply.achieved or missing("")) and not reply.gone and self._kind.reports:
                # The last status may arrive a moment after the answer of the service.
                Deadline(STATUS_GRACE).wait(
                    self._changed, lambda: not self._kind.reports or self._reporting.at_rest
                )
            Deadline(ANSWER_GRACE).wait(self._changed, lambda: not missing(self._reporting.failed_action))
            return self._kind.result(self._progress, reply)

    # --- what is heard --------------------------------------------------------------------------------

    def _busy(self) -> bool:
        return not self._active and self._reporting.busy

    def _abandoned(self) -> bool:
        return running_time() - self._begun > LISTEN and not self._other_owner()

    def _other_owner(self) -> str:
        """Another node that owns a plan of the dispatcher; empty: none."""
        return next((owner for owner in self._owners.owners if owner != rospy.get_name()), "")

    def _receive_dispatch(self, dispatch: ActionDispatch) -> None:
        with self._changed:
            if not self._active or dispatch.name == CANCEL_ACTION:
                return
            first = not self._progress.begun
            self._progress.dispatched(dispatched_action(dispatch))
            self._kind.dispatched(dispatch.action_id, partial(publish, self._cancel_publisher, dispatch))
            if first and self._progress.other_plan and not self._kind.reports:
                self._cancelling = True
            self._changed.notify_all()
        self._on_change()

    def _receive_feedback(self, feedback: ActionFeedback) -> None:
        found = answer_in(feedback)
        if found is None:
            return
        with self._changed:
            changes = self._active and self._progress.answered(feedback.action_id, feedback.plan_id, *found)
            self._changed.notify_all()
        if changes:
            self._on_change()

    def _receive_status(self, status: DispatchStatus) -> None:
        with self._changed:
            before = self.hold, self._reporting.busy
            self._reporting.receive(status)
            self._kind = self._reporting
            self._changed.notify_all()
        if before != (self.hold, self._reporting.busy):
            self._on_change()

    def _dispatcher_changed(self, change: LeaseChange) -> None:
        if change.state is not LeaseState.LOST or change.released:
            return
        # A restarted dispatcher may lose what it held before while it carries out this plan.
        if not self._watch.beside(change.goal):
            with self._changed:
                self._cancelling = self._cancelling or self._active
                self._changed.notify_all()
