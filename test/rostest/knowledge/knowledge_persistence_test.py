# SPDX-License-Identifier: Apache-2.0
"""A knowledge base that is killed, and one that is sent nonsense."""

import contextlib
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import tempfile
import time
import unittest
import xmlrpc.client
from pathlib import Path

import rospkg
import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.srv import ApplyEffects, ApplyEffectsRequest, ListExecutions
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

from merlin_test import LONG
from merlin_test.node_path import node_path

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


def state_file():
    return Path(rospkg.get_log_dir()) / rospy.get_param("/run_id") / "rosplan_knowledge_base.sqlite"


def effects(phase, token, *more):
    parameters = [KeyValue("from", "anywhere"), KeyValue("to", "kitchen")]
    return call(f"{KB}/apply_effects", ApplyEffects, "navigate", parameters, phase, token, *more)


def texts(service):
    found = call(f"{KB}/state/{service}", GetAttributeService, "").attributes
    return [(item.attribute_name, *[value.value for value in item.values]) for item in found]


class KnowledgePersistenceTest(unittest.TestCase):
    def restart(self, how):
        """Ends the node; roslaunch starts it again."""
        old = pid()
        start = time.monotonic()
        os.kill(old, how)
        while True:
            with contextlib.suppress(OSError, rospy.ROSException, rospy.ServiceException):
                if pid() != old:
                    call(f"{KB}/state/goals", GetAttributeService, "")
                    return
            self.assertLess(time.monotonic() - start, LONG)
            time.sleep(0.05)

    def test_killed_while_clients_write(self):
        update = rospy.ServiceProxy(f"{KB}/update", KnowledgeUpdateService, persistent=True)
        rospy.wait_for_service(f"{KB}/apply_effects", LONG)
        self.assertTrue(effects(ApplyEffectsRequest.START, "run 1", "", [], []).success)
        self.assertTrue(update(1, fact("checked", "kitchen")).success)
        for number in range(100):
            poi = KnowledgeItem(instance_type="poi", instance_name=f"spot{number}")
            self.assertTrue(update(0, poi).success)
            self.assertTrue(update(0, fact("checked", f"spot{number}")).success)
        update.close()
        expected = [("in_service",), *(("checked", f"spot{number}") for number in range(100))]
        self.restart(signal.SIGKILL)
        self.assertEqual(texts("propositions"), expected)
        self.assertEqual(texts("goals"), [("in_service",), ("checked", "kitchen")])
        self.assertEqual(len(texts("functions")), 16)
        # the action that was under way is undone by its interface
        self.assertTrue(effects(ApplyEffectsRequest.ROLLBACK, "run 1", "", [], []).success)
        self.assertIn(("robot_at", "anywhere"), texts("propositions"))

    def test_killed_at_a_master_that_was_started_anew(self):
        """Such a master has another run, or none; the node brings its own parameters back."""
        self.assertTrue(call(f"{KB}/update", KnowledgeUpdateService, 0, fact("checked", "kitchen")).success)
        run = rospy.get_param("/run_id")
        rospy.delete_param("/run_id")
        self.addCleanup(rospy.set_param, "/run_id", run)
        self.restart(signal.SIGKILL)
        self.assertIn(("checked", "kitchen"), texts("propositions"))
        self.assertTrue(call(f"{KB}/update", KnowledgeUpdateService, 2, fact("checked", "kitchen")).success)

    def robot_at(self):
        return [words[1:] for words in texts("propositions") if words[0] == "robot_at"]

    def executions(self, owner=""):
        return call(f"{KB}/executions", ListExecutions, owner).executions

    def test_killed_while_an_action_runs(self):
        """What began is known to its owner, and closed as if nothing had happened in between."""
        call(f"{KB}/state/goals", GetAttributeService, "")
        self.assertEqual(self.robot_at(), [("anywhere",)])
        for token, phase, expected in (
            ("1/1/life/1", ApplyEffectsRequest.INTERRUPT, [("anywhere",)]),
            ("1/2/life/2", ApplyEffectsRequest.ROLLBACK, [("anywhere",)]),
            ("1/3/life/3", ApplyEffectsRequest.END, [("kitchen",)]),
        ):
            meanwhile, interrupted = ["(checked kitchen)"], ["(robot_at anywhere)"]
            opened = effects(ApplyEffectsRequest.START, token, "/a_bridge", meanwhile, interrupted)
            self.assertTrue(opened.success, opened.message)
            self.assertEqual(self.robot_at(), [])
            self.restart(signal.SIGKILL)
            self.assertIn(("checked", "kitchen"), texts("propositions"))
            (found,) = self.executions("a_bridge")
            self.assertEqual(
                (found.token, found.operator_name, found.owner), (token, "navigate", "/a_bridge")
            )
            self.assertEqual([pair.value for pair in found.parameters], ["anywhere", "kitchen"])
            for _ in range(2):  # the second finds nothing to do
                self.assertTrue(effects(phase, token, "", [], []).success)
            self.assertEqual(self.robot_at(), expected)
            self.assertNotIn(("checked", "kitchen"), texts("propositions"))
            self.assertEqual(self.executions(), [])
        self.assertTrue(effects(ApplyEffectsRequest.INTERRUPT, "never seen", "", [], []).success)
        for kind, place in ((2, "kitchen"), (0, "anywhere")):
            self.assertTrue(
                call(f"{KB}/update", KnowledgeUpdateService, kind, fact("robot_at", place)).success
            )

    def test_a_signal_ends_the_node(self):
        call(f"{KB}/state/goals", GetAttributeService, "")
        self.restart(signal.SIGTERM)

    def second(self, path, *words):
        """A knowledge base of another name; it has to end. Returns what it says."""
        domain = rospy.get_param(f"{KB}/domain_path")
        command = [node_path("merlin_rosplan", "knowledge_base"), "__name:=second", *words]
        command += [f"_state_file:={path}", f"_domain_path:={domain}"]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=LONG, check=False)
        self.assertEqual(ended.returncode, 2)
        self.assertNotIn("Traceback", ended.stderr)
        return ended.stderr + ended.stdout

    def test_second_knowledge_base_on_the_file_says_so_and_ends(self):
        call(f"{KB}/state/goals", GetAttributeService, "")
        for words in ((), ("_reset_state:=true",)):
            said = self.second(state_file(), *words)
            self.assertIn(f"process {pid()} has it open; is another knowledge base using it?", said)
        self.assertTrue(call(f"{KB}/update", KnowledgeUpdateService, 1, fact("robot_at", "anywhere")).success)
        self.restart(signal.SIGKILL)
        self.assertIn(("robot_at", "anywhere"), texts("goals"))
        self.assertTrue(call(f"{KB}/update", KnowledgeUpdateService, 3, fact("robot_at", "anywhere")).success)

    def test_damaged_file_is_named_with_its_row(self):
        call(f"{KB}/state/goals", GetAttributeService, "")
        with tempfile.TemporaryDirectory() as folder:
            damaged = Path(folder) / "damaged.sqlite"
            for suffix in ("", "-wal"):
                shutil.copy(f"{state_file()}{suffix}", f"{damaged}{suffix}")
            with contextlib.closing(sqlite3.connect(damaged)) as database:
                database.execute("UPDATE row SET place = 'first' WHERE kind = 'fact'")
                database.commit()
            said = self.second(damaged)
        self.assertIn(f"the state file {damaged} is damaged: the row 'fact'", said)

    def test_reset_is_done_once(self):
        call(f"{KB}/state/goals", GetAttributeService, "")
        self.assertIs(rospy.get_param(f"{KB}/reset_state"), False)

    def test_nonsense_to_every_service(self):
        call(f"{KB}/state/goals", GetAttributeService, "")
        before = pid()
        chance = random.Random(1)
        words = ["", "navigate", "checked", "travel_time", "(", "é\x00", "/", "kitchen", "poi", "x" * 10_000]

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
                lambda: (
                    word(),
                    [KeyValue(word(), word())],
                    chance.randint(0, 9),
                    *(word() for _ in "to"),
                    [word()],
                    [word()],
                ),
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
