#!/usr/bin/env python3
"""A knowledge base that is killed, and one that is sent nonsense."""

import contextlib
import os
import random
import signal
import subprocess
import time
import unittest
import xmlrpc.client

import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.srv import ApplyEffects, ApplyEffectsRequest
from rosplan_dispatch_msgs.srv import ProblemService
from rosplan_knowledge_msgs.msg import KnowledgeItem
from rosplan_knowledge_msgs.srv import (
    GetAttributeService,
    GetDomainOperatorDetailsService,
    GetDomainPredicateDetailsService,
    GetInstanceService,
    KnowledgeQueryService,
    KnowledgeUpdateService,
    KnowledgeUpdateServiceArray,
    SetNamedBool,
)
from std_srvs.srv import Empty

import rostest

LONG = 60.0
KB = "/rosplan_knowledge_base"


def call(name, service_class, *args):
    rospy.wait_for_service(name, LONG)
    return rospy.ServiceProxy(name, service_class)(*args)


def fact(name, *args):
    values = [KeyValue("", arg) for arg in args]
    return KnowledgeItem(knowledge_type=KnowledgeItem.FACT, attribute_name=name, values=values)


def pid():
    uri = rospy.get_master().lookupNode(KB)[2]
    return xmlrpc.client.ServerProxy(uri).getPid("/test")[2]


def texts(service):
    found = call(f"{KB}/state/{service}", GetAttributeService, "").attributes
    return [(item.attribute_name, *[value.value for value in item.values]) for item in found]


class KnowledgePersistenceTest(unittest.TestCase):
    def restart(self, how):
        """Ends the node; roslaunch starts it again. Returns how long the old one took to be gone, s."""
        old = pid()
        start = time.monotonic()
        os.kill(old, how)
        while os.path.exists(f"/proc/{old}"):
            self.assertLess(time.monotonic() - start, LONG)
            time.sleep(0.01)
        gone = time.monotonic() - start
        while True:
            with contextlib.suppress(OSError, rospy.ROSException, rospy.ServiceException):
                if pid() != old:
                    call(f"{KB}/state/goals", GetAttributeService, "")
                    return gone
            self.assertLess(time.monotonic() - start, LONG)
            time.sleep(0.05)

    def test_killed_while_clients_write(self):
        update = rospy.ServiceProxy(f"{KB}/update", KnowledgeUpdateService, persistent=True)
        rospy.wait_for_service(f"{KB}/apply_effects", LONG)
        parameters = [KeyValue("from", "anywhere"), KeyValue("to", "kitchen")]
        started = call(
            f"{KB}/apply_effects", ApplyEffects, "navigate", parameters, ApplyEffectsRequest.START, "run 1"
        )
        self.assertTrue(started.success)
        self.assertTrue(update(1, fact("checked", "kitchen")).success)
        for number in range(100):
            poi = KnowledgeItem(instance_type="poi", instance_name=f"spot{number}")
            self.assertTrue(update(0, poi).success)
            self.assertTrue(update(0, fact("checked", f"spot{number}")).success)
        update.close()
        expected = [("checked", f"spot{number}") for number in range(100)]
        self.restart(signal.SIGKILL)
        self.assertEqual(texts("propositions"), expected)
        self.assertEqual(texts("goals"), [("checked", "kitchen")])
        self.assertEqual(len(texts("functions")), 16)
        # the action that was under way is undone by who ran it
        undone = call(
            f"{KB}/apply_effects", ApplyEffects, "navigate", parameters, ApplyEffectsRequest.ROLLBACK, "run 1"
        )
        self.assertTrue(undone.success)
        self.assertIn(("robot_at", "anywhere"), texts("propositions"))

    def test_interrupt_ends_the_node(self):
        call(f"{KB}/state/goals", GetAttributeService, "")
        self.assertLess(self.restart(signal.SIGINT), 2.0 + 8.0)  # 2 s on a machine that does nothing else

    def test_second_knowledge_base_on_the_file_says_so_and_ends(self):
        call(f"{KB}/state/goals", GetAttributeService, "")
        path = rospy.get_param(f"{KB}/state_file")
        domain = rospy.get_param(f"{KB}/domain_path")
        command = ["rosrun", "merlin_rosplan", "knowledge_base", "__name:=second"]
        command += [f"_state_file:={path}", f"_domain_path:={domain}"]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=LONG, check=False)
        self.assertEqual(ended.returncode, 1)
        self.assertIn("is another knowledge base using it?", ended.stderr + ended.stdout)
        self.assertNotIn("Traceback", ended.stderr)

    def test_nonsense_to_every_service(self):
        call(f"{KB}/state/goals", GetAttributeService, "")
        before = pid()
        chance = random.Random(1)
        words = ["", "navigate", "checked", "duration", "(", "é\x00", "/", "kitchen", "poi", "x" * 10_000]

        def word():
            return chance.choice(words)

        def item():
            values = [KeyValue(word(), word()) for _ in range(chance.randint(0, 3))]
            return KnowledgeItem(
                knowledge_type=chance.randint(0, 255),
                instance_type=word(),
                attribute_name=word(),
                values=values,
                function_value=float("nan"),
                assign_op=chance.randint(0, 255),
            )

        requests = [
            ("update", KnowledgeUpdateService, lambda: (chance.randint(0, 255), item())),
            (
                "update_array",
                KnowledgeUpdateServiceArray,
                lambda: ([0, 1, 2], [item() for _ in range(chance.randint(0, 5))]),
            ),
            ("update_constraints_oneof", KnowledgeUpdateServiceArray, lambda: ([], [item()])),
            ("update_sensed_predicates", SetNamedBool, lambda: (word(), True)),
            ("query_state", KnowledgeQueryService, lambda: ([item(), item()],)),
            ("domain/operator_details", GetDomainOperatorDetailsService, lambda: (word(),)),
            ("domain/predicate_details", GetDomainPredicateDetailsService, lambda: (word(),)),
            ("state/instances", GetInstanceService, lambda: (word(), True, True)),
            ("state/propositions", GetAttributeService, lambda: (word(),)),
            ("state/functions", GetAttributeService, lambda: (word(),)),
            ("state/timed_knowledge", GetAttributeService, lambda: (word(),)),
            ("state/goals", GetAttributeService, lambda: (word(),)),
            (
                "apply_effects",
                ApplyEffects,
                lambda: (word(), [KeyValue(word(), word())], chance.randint(0, 9), word()),
            ),
        ]
        for name, service_class, make in requests:
            service = rospy.ServiceProxy(f"{KB}/{name}", service_class)
            for _ in range(60):
                with contextlib.suppress(rospy.ServiceException):
                    service(*make())
        problem = rospy.ServiceProxy(
            "/rosplan_problem_interface/problem_generation_server_params", ProblemService
        )
        for path in ("\x00", "/", "/dev/null/x", "é" * 300):
            self.assertFalse(problem(path, True).problem_generated, path)
        self.assertEqual(pid(), before)
        call(f"{KB}/clear", Empty)
        self.assertEqual(texts("propositions"), [])
        self.restart(signal.SIGKILL)
        self.assertEqual(texts("propositions"), [])


if __name__ == "__main__":
    rospy.init_node("knowledge_persistence_test")
    rostest.rosrun("merlin_test", "knowledge_persistence", KnowledgePersistenceTest)
