# SPDX-License-Identifier: Apache-2.0
"""A dispatcher of the original ROSPlan, which publishes no status: what its client knows and does itself.

ROSPlan hands a plan over by a topic and starts it by a service, and nothing keeps the two in order: a plan of
before is carried out when the service is faster. The esterel dispatcher draws each plan that it receives, on
``plan_graph``; the drawing says that the plan has come. The simple dispatcher says nothing.
"""

import re
import threading
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Set

import rospy
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_dispatch_msgs.srv import DispatchService
from rosplan_knowledge_msgs.msg import DomainFormula
from std_msgs.msg import String

from merlin_planning.action_messages import dispatched_action, ground_action
from merlin_planning.dispatch_progress import Action, DispatchAnswer, DispatchProgress, Ground, ground
from merlin_planning.dispatcher_kind import DispatcherKind
from merlin_ros.alarms import call_later
from merlin_ros.deadline import Deadline, limit
from merlin_ros.late_topics import subscribe
from merlin_ros.master.master_link import ERRORS, bounded_master
from merlin_ros.service_proxy import ServiceProxy
from merlin_ros.work.threads import start_thread

#: Time for ROSPlan's dispatcher to stop by itself after a failed action, s of running time.
FAILURE_GRACE = 0.5
INTERFACE_WAIT = 3.0  # s of running time for the action interfaces of a plan to announce themselves
DRAWING_WAIT = 2.0  # s of running time for a dispatcher that draws its plans to draw the new one
SEND_AGAIN = 2.0  # s of wall time after which an action is sent again that no interface has taken
ANNOUNCED = 1000  # operators whose interfaces are remembered; any node may announce some
_START = re.compile(r'^\s*(\d+)\s*\[\s*label="([^"\\(]*)_start\\n\(([^"]*)\)"', re.MULTILINE)


def drawn_actions(drawing: str) -> List[Ground]:
    """The actions of a drawn plan graph, in the order of the plan.

    :param drawing: DOT text as on ROSPlan's ``plan_graph``.
    """
    starts = sorted((int(number), name, arguments) for number, name, arguments in _START.findall(drawing))
    return [ground(name, arguments.split(",") if arguments else []) for _, name, arguments in starts]


class PlainProgress(DispatchProgress):
    """Judges from the dispatched actions and their answers alone. Not thread-safe.

    :param stuck_after: s of running time without an action under way, after which the dispatch is given up;
        zero or less: never.
    :param plan: that is meant; empty: not known.
    :param takers: operators whose interfaces say when they take an action, and whether one was seen to take
        another beside it; those of this dispatch are added.
    """

    def __init__(self, stuck_after: float, plan: Sequence[ActionDispatch], takers: Dict[str, bool]) -> None:
        super().__init__()
        self._stuck_after, self._takers = limit(stuck_after), takers
        self._plan = {step.action_id: step for step in plan}
        self.watched: Set[int] = set()
        """Ids of actions that may be sent again."""
        # Any that begin before one has ended may be seen first: what ROSPlan's dispatchers send close before
        # another message is dropped by their queue of one.
        end = min((step.dispatch_time + step.duration for step in plan), default=0.0)
        self._first = {ground_action(step) for step in plan if step.dispatch_time <= end}

    @property
    def other_plan(self) -> bool:
        """It may still have held an older plan when it was called; also when nothing was dispatched."""
        return bool(self._first) and self._seen not in self._first

    @property
    def patience(self) -> Optional[float]:
        """A limit while nothing is under way, as far as the answers say: the dispatcher would wait for ever.

        An action that nothing has taken does not count where its interface would have said so: the message
        may be lost.
        """
        running = any(
            action.id in self._taken or action.name.lower() not in self._takers
            for action in self.running.values()
        )
        over = not running and all(len(answers) > 1 for answers in self._early.values())
        return self._stuck_after if over else None

    def untaken(self, action_id: int) -> str:
        """An action that nothing has taken though its interface would say so, as PDDL text; else nothing.

        An interface may take one action after the other, and would carry out both messages of the next one.
        """
        action = self.running.get(action_id)
        if action is None or self._stopping or action_id in self._taken:
            return ""
        several = self._takers.get(action.name.lower())
        return action.text if several or (several is not None and not self._beside(action)) else ""

    def _beside(self, action: Action) -> bool:
        """Whether an interface has taken another action of this operator, which runs."""
        others = (each for each in self.running.values() if each.id in self._taken and each.id != action.id)
        return any(each.name.lower() == action.name.lower() for each in others)

    def answered(
        self, action_id: int, plan_id: int, answer: DispatchAnswer, information: Mapping[str, str]
    ) -> bool:
        """Notes too which interfaces say that they take an action, and a failure of one that was not seen."""
        ends = super().answered(action_id, plan_id, answer, information)
        missed, answers = self._plan.get(action_id), self._early.get(action_id, ())
        if missed is not None and answer is DispatchAnswer.FAILED and len(answers) > 1:
            self.dispatched(dispatched_action(missed))
            self._found.add(action_id)
            return True
        action = self.running.get(action_id)
        if action is not None and action_id in self._taken:
            name = action.name.lower()
            self._takers[name] = self._takers.get(name, False) or self._beside(action)
        return ends


class SilentDispatcher(DispatcherKind):
    """A dispatcher without status, as ROSPlan's own are: its service is called.

    :param name: its global name.
    :param knowledge_base: the global name of the one where action interfaces announce themselves.
    :param changed: guards what is known, and is notified when it changes.
    :param call_cancel: calls the dispatcher's service for the cancel.
    :param stuck_after: see :class:`PlainProgress`.
    """

    def __init__(
        self,
        name: str,
        knowledge_base: str,
        changed: threading.Condition,
        call_cancel: Callable[[], object],
        stuck_after: float,
    ) -> None:
        self._name, self._drawings = name, f"{name}/plan_graph"
        self._service = ServiceProxy(f"{name}/dispatch_plan", DispatchService)
        self._changed = changed
        self._call_cancel = call_cancel
        self._stuck_after = stuck_after
        self._announced: Dict[str, None] = {}  # operators, the one that is silent for longest first
        self._drawn: Optional[List[Ground]] = None  # the plan that the dispatcher has received last
        self._subscriber: Optional[rospy.Subscriber] = None
        self._plan: Sequence[ActionDispatch] = ()  # of the present dispatch
        self._progress: Optional[PlainProgress] = None  # likewise
        self._takers: Dict[str, bool] = {}  # operators whose interfaces say when they take an action
        rospy.Subscriber(f"{knowledge_base}/pddl_action_parameters", DomainFormula, self._receive_interface)

    def available(self) -> bool:
        """Whether the dispatcher, of either kind, is there now."""
        return self._service.available()

    def begin(self, plan: Sequence[ActionDispatch]) -> DispatchProgress:
        """Nothing is remembered of an earlier dispatch."""
        self._plan = plan
        self._progress = PlainProgress(self._stuck_after, plan, self._takers)
        return self._progress

    def dispatched(self, action_id: int, send: Callable[[], object]) -> None:
        """Has an action sent again, once, when no interface takes it: the message to it is lost."""
        progress = self._progress
        if progress is None or action_id in progress.watched:
            return
        progress.watched.add(action_id)

        def look() -> None:
            with self._changed:
                lost = progress.untaken(action_id) if progress is self._progress else ""
            if lost:
                rospy.logwarn(f"nothing takes {lost}; it is sent again")
                send()

        call_later(SEND_AGAIN, look)

    def wait(self, plan: Sequence[ActionDispatch], interrupted: Callable[[], bool]) -> str:
        """For the action interfaces, and for the plan; whether it is there itself shows when it is called."""
        operators = {action.name.lower() for action in plan}
        with self._changed:
            Deadline(INTERFACE_WAIT).wait(
                self._changed, lambda: interrupted() or operators <= self._announced.keys()
            )
        if plan and self._draws():
            meant = [ground_action(action) for action in plan]
            with self._changed:
                Deadline(DRAWING_WAIT).wait(self._changed, lambda: interrupted() or self._drawn == meant)
        return ""

    def send(self, ended: Callable[[object], None], owner: Optional[str]) -> None:
        """Calls the service, in a thread of its own."""
        service = self._service

        def call() -> None:
            try:
                ended(service())
            except BaseException as error:  # the thread that waits for the end must learn of it
                ended(error)

        start_thread(f"dispatch of {self._name}", call)

    def cancel(self, progress: DispatchProgress) -> Sequence[Action]:
        """Calls the service for it; the simple dispatcher passes it on to no action."""
        with self._changed:
            progress.find(map(dispatched_action, self._plan))
            running = list(progress.running.values())
        self._call_cancel()
        return running

    def end(self, hangs: bool) -> None:
        """The next dispatch gets a connection of its own while the call hangs in its thread."""
        self._progress = None
        if hangs:
            self._service = ServiceProxy(f"{self._name}/dispatch_plan", DispatchService)

    def started(self, progress: DispatchProgress) -> bool:
        """True when an action runs or failed, or it stands still: a stray cancel stops the next dispatch."""
        return bool(progress.running or progress.failed or progress.failed_reason)

    def failure_grace(self, slack: Optional[float]) -> Optional[float]:
        """Short: the esterel dispatcher does not notice a failed action."""
        return FAILURE_GRACE

    def _draws(self) -> bool:
        """Whether the dispatcher publishes drawings; they are subscribed as late as this.

        One with a status needs none, and draws large graphs only for subscribers.
        """
        try:
            if self._drawings not in dict(bounded_master().getPublishedTopics("")):
                return False
            if self._subscriber is None:
                self._subscriber = subscribe(self._drawings, String, self._receive_drawing)
        except ERRORS:
            return False
        return True

    def _receive_interface(self, formula: DomainFormula) -> None:
        name = formula.name.lower()
        with self._changed:
            others = [other for other in self._announced if other != name]
            self._announced = dict.fromkeys([*others, name][-ANNOUNCED:])
            self._changed.notify_all()

    def _receive_drawing(self, drawing: String) -> None:
        with self._changed:
            self._drawn = drawn_actions(drawing.data)
            self._changed.notify_all()
