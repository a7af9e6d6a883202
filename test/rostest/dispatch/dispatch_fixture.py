# SPDX-License-Identifier: Apache-2.0
"""Interfaces that answer a plan dispatcher as a test wants it, and what its tests have in common."""

import tempfile
import threading

import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import DispatchStatus
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback, NonBlockingDispatchAction
from rosplan_dispatch_msgs.srv import DispatchService, ParsingService
from rosplan_knowledge_msgs.msg import DomainFormula
from std_srvs.srv import Empty

from merlin_planning.knowledge_client import (
    ADD,
    REMOVE,
    REMOVE_GOAL,
    Update,
    fact,
    function_value,
    knowledge_client,
)
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.service_proxy import ServiceError
from merlin_test import LONG
from merlin_test.topic_links import patient_service, wait_for_publishers

KNOWLEDGE_BASE = "/rosplan_knowledge_base"


PUBLISHERS = {}  # topic -> the one of this process


def publisher(topic, kind, **options):
    """A publisher that stays: a node that still has the dying link of one does not connect to the next."""
    if topic not in PUBLISHERS:
        PUBLISHERS[topic] = rospy.Publisher(topic, kind, **options)
    return PUBLISHERS[topic]


class Interfaces:
    """Answers dispatched actions as the test wants; it applies no effects."""

    def __init__(self, dispatcher, announced=("paint", "store_part", "move", "inspect")):
        self.changed = threading.Condition()
        self.dispatched = []  # every message on action_dispatch, tombstones and cancels too
        self.greeted = False
        self.answers = {}  # operator -> what to do
        self.feedback = publisher(f"{dispatcher}/action_feedback", ActionFeedback, latch=True, queue_size=100)
        self.announcements = publisher(
            f"{KNOWLEDGE_BASE}/pddl_action_parameters", DomainFormula, queue_size=10
        )
        self.announced = set(announced)
        self.stopped = threading.Event()
        self.announcer = threading.Thread(target=self.announce, daemon=True)
        self.subscriber = rospy.Subscriber(
            f"{dispatcher}/action_dispatch", ActionDispatch, self.receive, tcp_nodelay=True
        )
        while not (self.feedback.get_num_connections() and self.announcements.get_num_connections()):
            assert not self.stopped.wait(0.01)
        # A dispatcher latches a message from its start; it is not for us, and shows that it sends to us.
        with self.changed:
            assert self.changed.wait_for(lambda: self.greeted, LONG), "nothing latched"
            self.dispatched.clear()
        self.announcer.start()

    def announce(self):
        while True:
            for name in list(self.announced):
                self.announcements.publish(DomainFormula(name=name))
            if self.stopped.wait(0.3):
                return

    def close(self):
        self.stopped.set()
        self.announcer.join()
        self.subscriber.unregister()

    def receive(self, message):
        with self.changed:
            self.greeted = True
            if message.action_id >= 0:  # below is the one that says that nothing was dispatched yet
                self.dispatched.append(message)
            self.changed.notify_all()
        if message.name == "cancel_action":
            if "on_cancel" in self.answers:
                self.answer(message, *self.answers["on_cancel"])
            return
        for answer in self.answers.get(message.name, [(1,), (2,)]):
            self.answer(message, *answer)

    def answer(self, message, status, reason="", plan_id=None, **more):
        self.feedback.publish(
            ActionFeedback(
                action_id=message.action_id,
                plan_id=message.plan_id if plan_id is None else plan_id,
                status=status,
                information=[KeyValue(*each) for each in {"reason": reason, **more}.items() if each[1]],
            )
        )

    def wait(self, predicate, count=1):
        def seen():
            return sum(1 for message in self.dispatched if predicate(message)) >= count

        with self.changed:
            assert self.changed.wait_for(seen, LONG), [(m.name, m.action_id) for m in self.dispatched]
            return [message for message in self.dispatched if predicate(message)][-1]

    def names(self):
        with self.changed:
            return [message.name for message in self.dispatched]


def named(name):
    return lambda message: message.name == name


class DispatchFixture:
    """A parser and a dispatcher, and interfaces that answer as a test wants it."""

    kind = ""

    @classmethod
    def setUpClass(cls):
        dispatcher = cls.dispatcher = f"/{cls.kind}_dispatcher"
        cls.knowledge = knowledge_client(KNOWLEDGE_BASE)
        cls.parse = patient_service(f"/{cls.kind}_parser/parse_plan_from_file", ParsingService)
        cls.dispatch = patient_service(f"{dispatcher}/dispatch_plan", DispatchService)
        cls.cancel = patient_service(f"{dispatcher}/cancel_dispatch", Empty)
        cls.action = ActionClient(f"{dispatcher}/dispatch_plan_action", NonBlockingDispatchAction)
        cls.statuses, cls.since = [], rospy.Time()
        cls.status_changed = threading.Condition()
        cls.status_subscriber = rospy.Subscriber(
            f"{dispatcher}/dispatch_status", DispatchStatus, cls.receive_status
        )
        assert cls.dispatch.wait(LONG) and cls.parse.wait(LONG) and cls.action.wait_for_server(LONG)
        assert cls.knowledge.wait(LONG)
        wait_for_publishers(cls.status_subscriber)

    @classmethod
    def tearDownClass(cls):
        cls.status_subscriber.unregister()
        cls.action.shutdown()

    @classmethod
    def receive_status(cls, status):
        with cls.status_changed:
            if status.header.stamp >= cls.since:
                cls.statuses.append(status)
            cls.status_changed.notify_all()

    def setUp(self):
        self.interfaces = Interfaces(self.dispatcher)
        self.addCleanup(self.interfaces.close)
        self.addCleanup(self.cancel)  # a dispatch that a failed test left running
        self.knowledge.update(
            [Update(REMOVE, fact("broken", "")), Update(ADD, fact("powered")), Update(REMOVE_GOAL, fact(""))]
            + [Update(REMOVE, fact("painted", "")), Update(REMOVE, fact("stored", ""))]
            + [Update(ADD, function_value("battery", [robot], 50.0)) for robot in ("ann", "bob")]
        )
        self.forget_statuses()

    def forget_statuses(self):
        """From now on only statuses count that are published from now on; one of before may still come."""
        with self.status_changed:
            self.statuses.clear()
            type(self).since = rospy.Time.now()

    def give(self, *lines):
        with tempfile.NamedTemporaryFile("w", suffix=".plan") as file:
            file.write("".join(f"{line}\n" for line in lines))
            file.flush()
            return self.parse(plan_path=file.name).plan_parsed

    def last_status(self, state=DispatchStatus.IDLE):
        with self.status_changed:
            assert self.status_changed.wait_for(
                lambda: self.statuses and self.statuses[-1].state == state, LONG
            )
            return self.statuses[-1]

    def start(self):
        answers = []

        def call():
            try:
                answers.append(self.dispatch())
            except ServiceError as error:
                answers.append(error)

        thread = threading.Thread(target=call, daemon=True)
        thread.start()

        def result():
            thread.join(2 * LONG)  # an interface that announced itself slowly counts as alive for longer
            assert answers, "the dispatch does not end"
            return answers[0]

        return result

    def tombstones(self):
        """Cancels after the last answer; waits for one to come."""
        self.interfaces.wait(named("cancel_action"))
        return [m for m in self.interfaces.dispatched if m.name == "cancel_action"]

    def refused(self, part, line="0.0: (paint ann leg) [5.0]"):
        self.give(line)
        self.forget_statuses()
        self.assertFalse(self.dispatch().success)
        self.assertIn(part, self.last_status().reason)
        self.assertEqual(self.interfaces.names(), [])
