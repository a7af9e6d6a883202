#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""Times of a plan are ROS times: bounds, timed literals, durations, and a clock that jumps back."""

import tempfile
import threading
import time
import unittest

import rospy
from merlin_msgs.msg import DispatchStatus
from rosgraph_msgs.msg import Clock
from rosplan_dispatch_msgs.srv import DispatchService, ParsingService
from rosplan_knowledge_msgs.msg import DomainFormula

import rostest
from merlin_planning.knowledge_client import ADD, REMOVE, Update, fact, function_value, knowledge_client
from merlin_test import LONG
from merlin_test.topic_links import init_node, patient_service

DISPATCHER = "/rosplan_plan_dispatcher"


class Times(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.clock = rospy.Publisher("/clock", Clock, queue_size=10, latch=True)
        cls.time = 100.0
        cls.tick(0.0)
        cls.knowledge = knowledge_client()
        cls.parse = patient_service("/rosplan_parsing_interface/parse_plan_from_file", ParsingService)
        cls.dispatch = patient_service(f"{DISPATCHER}/dispatch_plan", DispatchService)
        cls.strict = patient_service("/strict_dispatcher/dispatch_plan", DispatchService)
        cls.changed = threading.Condition()
        cls.statuses = []
        cls.subscribers = [
            rospy.Subscriber(f"{dispatcher}/dispatch_status", DispatchStatus, cls.note)
            for dispatcher in (DISPATCHER, "/strict_dispatcher")
        ]
        assert cls.strict.wait(LONG)
        assert cls.dispatch.wait(LONG) and cls.parse.wait(LONG) and cls.knowledge.wait(LONG)
        # An interface takes for old what it gets as it is connected; after that it announces itself.
        # By its second word, a second after its first, it has heard of the clock, too.
        announced = []
        interfaces = rospy.Subscriber(
            "/rosplan_knowledge_base/pddl_action_parameters",
            DomainFormula,
            lambda message: announced.append(message._connection_header["callerid"]),
        )
        while min(announced.count("/painter"), announced.count("/strict_painter")) < 2:
            rospy.rostime.wallsleep(0.01)
        interfaces.unregister()
        # An action that begins before its process has heard of the clock would see a jump.
        stamp = None
        while stamp != rospy.Time.from_sec(cls.time):
            cls.tick(0.0)
            cls.knowledge.update([Update(REMOVE, fact("powered")), Update(ADD, fact("powered"))])
            stamp = cls.knowledge.propositions("powered")[0].initial_time

    @classmethod
    def tick(cls, seconds):
        cls.time += seconds
        cls.clock.publish(Clock(rospy.Time.from_sec(cls.time)))

    @classmethod
    def note(cls, status):
        with cls.changed:
            cls.statuses.append(status)
            cls.changed.notify_all()

    def setUp(self):
        self.knowledge.update(
            [Update(ADD, function_value("battery", ["ann"], 50.0)), Update(ADD, fact("powered"))]
            + [Update(REMOVE, fact("painted", ""))]
        )
        with self.changed:
            self.statuses.clear()

    def wait(self, predicate):
        with self.changed:
            seen = self.changed.wait_for(lambda: any(predicate(s) for s in self.statuses), LONG)
            self.assertTrue(seen, self.statuses)
            return next(status for status in self.statuses if predicate(status))

    def start(self, *lines, dispatch=None):
        with tempfile.NamedTemporaryFile("w", suffix=".plan") as file:
            file.write("".join(f"{line}\n" for line in lines))
            file.flush()
            self.assertTrue(self.parse(plan_path=file.name).plan_parsed)
        answers = []
        thread = threading.Thread(target=lambda: answers.append((dispatch or self.dispatch)()), daemon=True)
        thread.start()

        def result():
            thread.join(LONG)
            self.assertTrue(answers, "the dispatch does not end")
            self.wait(self.ended)
            return answers[0]

        return result

    def ended(self, status):
        """The last word on a dispatch that was seen to run."""
        known = {other.plan_id for other in self.statuses if other.state != DispatchStatus.IDLE}
        return status.state == DispatchStatus.IDLE and status.plan_id in known

    @staticmethod
    def running(status):
        return bool(status.running)

    def until(self, predicate):
        """Lets the clock run until the status says so."""
        end = time.monotonic() + LONG
        while time.monotonic() < end:
            with self.changed:
                if any(predicate(status) for status in self.statuses):
                    return
                self.changed.wait(0.02)
            self.tick(0.1)
        self.fail("it does not come")

    def test_a_simulated_action_takes_its_time_on_the_ros_clock(self):
        result = self.start("0.0: (paint ann leg) [5.0]")
        self.wait(self.running)
        began = self.time  # the clock stands until here: the action has begun at this time, or later
        self.until(lambda status: status.steps_done == 1)
        self.assertTrue(result().success)
        self.assertGreaterEqual(self.time - began, 7.9)
        self.assertTrue(self.knowledge.query([fact("painted", "leg")])[0])

    def test_with_bounds_an_action_that_takes_too_long_ends_the_plan(self):
        result = self.start("0.0: (paint ann leg) [2.0]", dispatch=self.strict)
        self.wait(self.running)
        self.until(self.ended)  # the graph allows 2 s and a tenth
        self.assertFalse(result().success)
        self.wait(lambda status: "(paint ann leg) should have ended" in status.reason)
        self.assertFalse(self.knowledge.query([fact("painted", "leg")])[0])

    def test_a_timed_fact_is_waited_for_without_bounds_too(self):
        self.knowledge.update([Update(REMOVE, fact("powered"))])
        later = fact("powered")
        later.initial_time = rospy.Time.from_sec(self.time + 10.0)
        self.knowledge.update([Update(ADD, later)])
        began = self.time
        result = self.start("11.0: (paint ann leg) [1.0]")
        self.wait(lambda status: status.state == DispatchStatus.RUNNING)
        self.until(self.running)
        self.assertGreaterEqual(self.time - began, 9.8)
        self.until(lambda status: status.steps_done == 1)
        self.assertTrue(result().success)

    def test_a_clock_that_jumps_back_leaves_the_dispatcher_usable(self):
        result = self.start("0.0: (paint ann leg) [5.0]")
        self.wait(self.running)
        self.tick(-50.0)
        self.until(lambda status: status.steps_done == 1)
        self.assertTrue(result().success)
        self.tick(100.0)
        with self.changed:
            self.statuses.clear()
        result = self.start("0.0: (paint ann seat) [1.0]")
        self.until(lambda status: status.steps_done == 1)
        self.assertTrue(result().success)


if __name__ == "__main__":
    init_node("plan_times_test")
    rostest.rosrun("merlin_test", "plan_times", "__main__")
