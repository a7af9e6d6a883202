#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The sensing interface updates the knowledge base from its topics and services."""

import os
import signal
import subprocess
import threading
import time
import unittest

import rospy
from merlin_msgs.msg import KnowledgeChanges
from rosplan_knowledge_msgs.srv import GetDomainPredicateDetailsService
from std_msgs.msg import Bool, Float32, String
from std_srvs.srv import SetBool, SetBoolResponse, Trigger, TriggerResponse

import rostest
from merlin_planning.knowledge_client import ADD, REMOVE, Update, fact, instance, knowledge_client
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_test import LONG
from merlin_test.knowledge_fixture import Received
from merlin_test.node_path import node_path
from merlin_test.topic_links import init_node, pid_of, wait_for_connections, wait_for_publishers

DETAILS = "/rosplan_knowledge_base/domain/predicate_details"


def marked(predicate):
    """Whether a knowledge base that lives has a predicate as sensed."""
    try:
        return ServiceProxy(DETAILS, GetDomainPredicateDetailsService)(predicate).is_sensed
    except ServiceError:
        return False


class Sensing(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.knowledge = knowledge_client()
        assert cls.knowledge.wait(LONG)
        cls.changed = threading.Condition()
        cls.changes = 0
        cls.watch = rospy.Subscriber(
            "/rosplan_knowledge_base/changes", KnowledgeChanges, cls.receive, tcp_nodelay=True
        )
        cls.publishers = {
            name: rospy.Publisher(name, message_class, queue_size=10)
            for name, message_class in (("/power", Bool), ("/battery", Float32), ("/place", String))
        }
        wait_for_connections(*cls.publishers.values())
        Received("/rosplan_knowledge_base/changes", KnowledgeChanges)  # both are connected now

    @classmethod
    def receive(cls, _):
        with cls.changed:
            cls.changes += 1
            cls.changed.notify_all()

    def eventually(self, predicate):
        """Asks again after each change of the knowledge."""
        with self.changed:
            self.assertTrue(self.changed.wait_for(predicate, LONG))

    def holds(self, *atom):
        return self.knowledge.query([fact(*atom)])[0]

    def battery(self):
        return {f.values[0].value: f.function_value for f in self.knowledge.functions("battery")}["ann"]

    def test_a_fact_follows_its_topic_both_ways(self):
        for value in (False, True, False, True):
            self.publishers["/power"].publish(value)
            self.eventually(lambda value=value: self.holds("powered") == value)

    def test_a_number_follows_its_topic(self):
        for value in (12.5, 80.0):
            self.publishers["/battery"].publish(value)
            self.eventually(lambda value=value: self.battery() == value)

    def test_a_function_of_the_script_says_several_facts(self):
        for here, other in (("store", "bench"), ("bench", "store")):
            self.publishers["/place"].publish(here)
            self.eventually(
                lambda here=here, other=other: (
                    self.holds("at", "ann", here) and not self.holds("at", "ann", other)
                )
            )

    def test_what_somebody_else_changes_is_put_right(self):
        self.publishers["/power"].publish(True)
        self.eventually(lambda: self.holds("powered"))
        self.knowledge.update([Update(REMOVE, fact("powered"))])
        self.eventually(lambda: self.holds("powered"))

    def test_a_sensing_function_that_fails_does_not_stop_the_others(self):
        self.publishers["/place"].publish("nonsense")
        self.publishers["/battery"].publish(33.0)
        self.eventually(lambda: self.battery() == 33.0)
        self.publishers["/place"].publish("bench")
        self.eventually(lambda: self.holds("at", "ann", "bench"))

    def test_what_the_knowledge_base_refuses_does_not_keep_the_rest(self):
        # In one batch: the unknown place, and the change of the battery.
        self.publishers["/place"].publish("moon")
        self.publishers["/battery"].publish(44.0)
        self.eventually(lambda: self.battery() == 44.0)
        self.publishers["/battery"].publish(45.0)
        self.eventually(lambda: self.battery() == 45.0)
        self.knowledge.update([Update(ADD, instance("place", "moon"))])
        self.eventually(lambda: self.holds("at", "ann", "moon"))
        self.publishers["/place"].publish("bench")
        self.eventually(lambda: self.holds("at", "ann", "bench") and not self.holds("at", "ann", "moon"))
        self.knowledge.update([Update(REMOVE, instance("place", "moon"))])

    def test_a_request_that_cannot_be_made_is_tried_again(self):
        service = rospy.Service("/look", SetBool, lambda request: SetBoolResponse(request.data, ""))
        self.addCleanup(service.shutdown)
        self.eventually(lambda: self.holds("painted", "seat"))

    def test_a_service_is_asked_again_and_again(self):
        painted = threading.Event()
        service = rospy.Service("/inspect", Trigger, lambda _: TriggerResponse(painted.is_set(), ""))
        self.addCleanup(service.shutdown)
        self.eventually(lambda: not self.holds("painted", "leg"))
        painted.set()
        self.eventually(lambda: self.holds("painted", "leg"))

    def test_sensed_predicates_are_marked(self):
        self.assertTrue(marked("powered"))
        self.assertFalse(marked("stored"))

    def test_a_knowledge_base_that_begins_anew_without_a_state_file_gets_marks_and_facts_again(self):
        self.publishers["/power"].publish(True)
        self.eventually(lambda: self.holds("powered"))
        os.kill(pid_of("/rosplan_knowledge_base"), signal.SIGKILL)
        end = time.monotonic() + LONG
        while not marked("powered"):
            self.assertLess(time.monotonic(), end)
            rospy.rostime.wallsleep(0.01)
        wait_for_publishers(self.watch)
        self.eventually(lambda: self.holds("powered"))

    def test_a_wrong_sensor_is_named(self):
        call = {"srv_type": "std_srvs/Trigger", "time_between_calls": 1.0}
        for key, sensor, reason in (
            ("topics", {"topic": "/power", "msg_type": "Bool"}, "package name: Bool"),
            ("topics", {"topic": "a b", "msg_type": "std_msgs/Bool"}, "'a b' is not a name of ROS"),
            ("services", {"service": "/look at", **call}, "'/look at' is not a name of ROS"),
        ):
            rospy.set_param(f"/wrong/{key}", {"powered": {"operation": "True", **sensor}})
            command = [node_path("merlin_rosplan", "sensing_interface"), "__name:=wrong"]
            ended = subprocess.run(command, stderr=subprocess.PIPE, text=True, timeout=LONG)
            rospy.delete_param("/wrong")
            self.assertEqual(ended.returncode, 2, ended.stderr)
            self.assertIn(reason, ended.stderr)
            self.assertNotIn("Traceback", ended.stderr)

    def test_other_knowledge_is_left_alone(self):
        self.knowledge.update([Update(ADD, fact("stored", "seat"))])
        self.publishers["/power"].publish(True)
        self.eventually(lambda: self.holds("powered"))
        self.assertTrue(self.holds("stored", "seat"))


if __name__ == "__main__":
    init_node("sensing_test")
    rostest.rosrun("merlin_test", "sensing", "__main__")
