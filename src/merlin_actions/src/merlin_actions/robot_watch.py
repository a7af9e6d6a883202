# SPDX-License-Identifier: Apache-2.0
"""The robots of a planning system, as the bridges see them, and what the knowledge says of them."""

import itertools
import threading
import time
from typing import Callable, Dict, Iterable, List, Optional, Set

import rospy
from merlin_msgs.msg import KnowledgeChanges, RobotHost
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_actions.core.availability import Availability
from merlin_actions.core.robot_book import GONE_AFTER, RobotBook, RobotChange
from merlin_planning.foreign_changes import ForeignChanges
from merlin_planning.knowledge_client import ADD, REMOVE, KnowledgeClient, KnowledgeError, Update, fact
from merlin_planning.robot_roster import RobotRoster, is_node
from merlin_ros.actions.peers import sender_of
from merlin_ros.alarms import TICK, Alarm, TickClock, call_later, every, wait_ticks
from merlin_ros.master.master_link import MasterSilent
from merlin_ros.robot_values import AVAILABLE
from merlin_ros.service_proxy import ServiceError
from merlin_ros.work.threads import CallQueue

RETRY = 0.3  # s of wall time to the second attempt to write; each later pause is twice as long
LONGEST_RETRY = 5.0  # s of wall time between two attempts
LONGEST_NAME = 100  # characters of a name in the log
PUBLISH_LIMIT = 2.0  # s of its own time that an answer waits for the knowledge


class RobotWatch:
    """Follows ``<kb>/robots`` and keeps the facts ``(available ?robot)``, where the domain has them.

    :param knowledge: of the planning system.
    :param gone_after: s of silence after which a robot takes no actions.
    """

    def __init__(self, knowledge: KnowledgeClient, gone_after: float = GONE_AFTER) -> None:
        self._facts = AvailableFacts(knowledge)
        self._roster = RobotRoster()
        self._changed = threading.Condition()  # guards the fields below
        self._book = RobotBook(gone_after)
        self._ticks = TickClock()
        self._settled = False
        self._calls = CallQueue("robots")
        self._listeners: List[Callable[[RobotChange], None]] = []
        self._subscriber = rospy.Subscriber(
            f"{knowledge.name}/robots", RobotHost, self._receive, tcp_nodelay=True, queue_size=100
        )
        every(TICK, self._look)

    def listen(self, callback: Callable[[RobotChange], None]) -> None:
        """Calls back with each change, in order, in a thread of this watch; at once with what is known."""
        with self._changed:
            self._listeners.append(callback)
            known = [RobotChange(robot, True) for robot in self._book.robots if self._book.available(robot)]
        for change in known:
            callback(change)

    def parameter(self, operator: str) -> str:
        """The variable of an operator that names the robot, as a host declares it; empty: none does."""
        with self._changed:
            return self._book.parameter(operator)

    def namespace(self, robot: str) -> str:
        """Where the actions of a robot are."""
        with self._changed:
            return self._book.namespace(robot)

    def why_not(self, robot: str) -> str:
        """Why a robot takes no actions; empty when it does, or has sent no message."""
        with self._changed:
            return self._book.why_not(robot)

    def why_not_each(self) -> Dict[str, str]:
        """:meth:`why_not` of each robot that has sent a message."""
        with self._changed:
            return {robot: self._book.why_not(robot) for robot in self._book.robots}

    def wait(self, robot: str, seconds: float, unless: Callable[[], bool]) -> str:
        """Waits for a robot without a host, or until one says why it takes no actions.

        :param seconds: of the caller's own time.
        :param unless: ends the wait when it is true; call :meth:`wake` when that changes.
        :return: why it takes no actions; empty when it does.
        """

        def over() -> bool:
            heard = robot in self._book.robots and not self._book.is_gone(robot)
            return heard or unless() or rospy.is_shutdown()

        with self._changed:
            in_time = wait_ticks(lambda tick: self._changed.wait_for(over, tick), seconds)
            why = self._book.why_not(robot)
            if in_time and (robot in self._book.robots or unless()):
                return why
            if why:
                return f"{why}, and it did not come back within {seconds:g} s"
            there = ", ".join(self._book.robots) or "none"
            return f"no host says that it is robot {robot} ({seconds:g} s); there are: {there}"

    def wake(self) -> None:
        """Wakes a :meth:`wait`, so that it re-checks `unless`."""
        with self._changed:
            self._changed.notify_all()

    def suspect(self, robot: str, reason: str) -> None:
        """An action was lost with the host of a robot: nothing is sent to it before its next word."""
        with self._changed:
            self._add(self._book.suspect(robot, reason))

    def wait_published(self, robot: str) -> None:
        """Waits until the knowledge says what this watch knows of a robot: the next plan is made from it."""
        self._facts.wait_published(robot, PUBLISH_LIMIT)

    def _receive(self, word: RobotHost) -> None:
        if not is_node(word.node):
            rospy.logwarn_throttle(10.0, f"a robot cannot have a host named {word.node[:LONGEST_NAME]!r}")
            return
        admission = self._roster.admit(word.robot, sender_of(word), time.monotonic())
        if admission.refusal:
            rospy.logwarn(admission.refusal)
        with self._changed:
            if admission.forgotten:
                self._add([self._book.forget(admission.forgotten)])
            if not admission.counts:
                return
            self._add(self._book.hear(word))

    def _add(self, changes: List[RobotChange]) -> None:
        """Takes changes in; called with the lock held."""
        for change in changes:
            timed = change._replace(at=time.monotonic())
            self._facts.put(change.robot, change.available)
            for call in (_log, *self._listeners):
                self._calls.put(call, timed)
        if changes:
            self._changed.notify_all()

    def _look(self) -> None:
        with self._changed:
            self._add(self._book.pass_time(self._ticks.look()))
            if not self._settled and self._ticks.now > GONE_AFTER:
                self._settled = True
                self._facts.settle()


def _log(change: RobotChange) -> None:
    log = rospy.loginfo if change.available else rospy.logwarn
    log(change.reason or f"robot {change.robot} takes actions")


class AvailableFacts:
    """Writes ``(available ?robot)``, in another thread: a knowledge base may not answer for a while.

    :param knowledge: to write to.
    """

    def __init__(self, knowledge: KnowledgeClient) -> None:
        self._knowledge = knowledge
        predicate = knowledge.predicates().get(AVAILABLE)
        types = [each.value for each in predicate.typed_parameters] if predicate else []
        self._there = len(types) == 1
        self._type = "".join(types[:1])
        self._changed = threading.Condition()  # guards the field below
        self._availability = Availability()
        self._calls = CallQueue("available robots")
        self._retry: Optional[Alarm] = None  # of the thread of the calls, as is the pause
        self._pause = RETRY
        if self._there:
            self._changes = ForeignChanges(knowledge.name, self._others_changed)

    def put(self, robot: str, available: bool) -> None:
        """Notes whether a robot is available; writes it soon."""
        with self._changed:
            self._availability.put(robot, available)
        self._write_soon()

    def settle(self) -> None:
        """Robots without a message so far are not available, whatever the problem says."""
        with self._changed:
            self._availability.settle()
        self._write_soon()

    def wait_published(self, robot: str, seconds: float) -> None:
        """Waits until the knowledge says what is known of a robot, s of the caller's own time at most."""

        def written() -> bool:
            return not self._there or self._availability.is_written(robot)

        with self._changed:
            wait_ticks(lambda tick: self._changed.wait_for(written, tick), seconds)

    def _others_changed(self, message: Optional[KnowledgeChanges]) -> None:
        robots = None if message is None else _touched(message)
        if robots is None or robots:
            self._calls.put(self._write_again, robots)  # behind what is being written: that may be lost, too

    def _write_again(self, robots: Optional[Set[str]]) -> None:
        with self._changed:
            self._availability.forget(robots)
        self._write_all()

    def _write_soon(self) -> None:
        if self._there:
            self._calls.put(self._write_all)

    def _write_all(self) -> None:
        with self._changed:
            if not self._availability.pending:  # an earlier call has written it
                return
            unsettled = self._availability.unsettled
        try:
            if unsettled:
                # A knowledge base that is not strict may hold one about no robot.
                facts = self._knowledge.propositions(AVAILABLE)
                listed = [item.values[0].value for item in facts if item.values]
                with self._changed:
                    self._availability.compare(listed)
            with self._changed:
                changes = self._availability.changes()
            refused = [text for text in itertools.starmap(self._write, changes.items()) if text]
        except (ServiceError, MasterSilent) as error:
            refused = [str(error)]
        if not refused:
            self._pause = RETRY
            return
        rospy.logwarn_throttle(10.0, f"availability of robots is not written yet: {'; '.join(refused)}")
        if (self._retry is None or not self._retry.waits) and not rospy.is_shutdown():
            # Neither a service that is offered again nor a disk with room gives an event.
            self._retry = call_later(self._pause, self._write_soon)
            self._pause = min(2.0 * self._pause, LONGEST_RETRY)

    def _write(self, robot: str, available: bool) -> str:
        """Writes one; returns why the knowledge base refuses it: the others are written all the same."""
        try:
            self._knowledge.update([Update(ADD if available else REMOVE, fact(AVAILABLE, robot))])
        except KnowledgeError as error:
            if robot.lower() in map(str.lower, self._knowledge.instances(self._type)):
                return str(error)
            # A change that adds it is an event, as is a knowledge base that begins anew.
            words = f"the problem has no object {robot[:LONGEST_NAME]} of type {self._type}; add one"
            rospy.logwarn(f"no plan counts on robot {robot[:LONGEST_NAME]}: {words} ({error})")
        with self._changed:
            self._availability.wrote(robot, available)
            self._changed.notify_all()
        return ""


def _touched(message: KnowledgeChanges) -> Set[str]:
    """The robots of which a change may say something else than was written, and that are objects still."""
    items = (*message.added, *message.removed)
    facts = {item.values[0].value for item in items if item.attribute_name == AVAILABLE and item.values}
    return facts - _instances(message.removed) | _instances(message.added)


def _instances(items: Iterable[KnowledgeItem]) -> Set[str]:
    return {item.instance_name for item in items if item.knowledge_type == KnowledgeItem.INSTANCE}
