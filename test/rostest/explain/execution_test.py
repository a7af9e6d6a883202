#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""What a robot says of what it does, waits for and failed at, and why facts are as they are."""

import re
import subprocess
import threading
import time
import unittest

import numpy as np
import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from audio_common_msgs.msg import AudioData
from merlin_msgs.srv import Explain, ExplainRequest
from sound_play.msg import SoundRequest

import rostest
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_executor.mission.goal_state import ACHIEVED
from merlin_reactive.speech.speech_synthesizer import RATE, SpeechSynthesizer
from merlin_ros.master.master_link import bounded_master
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.held_drives import HeldDrives
from merlin_test.node_path import node_path
from merlin_test.topic_links import init_node, patient_service, sends

HOST = "/merlin_fsm_host"
DORM_ROOM = "world/points_of_interest/dorm_room"


class Ears:
    """A person that asks aloud, and hears what the robot is to say; and the application's own listener."""

    def __init__(self):
        self.changed = threading.Condition()
        self.said, self.active = [], False
        self.microphone = rospy.Publisher("audio/microphone", AudioData, queue_size=50)
        self.status = rospy.Publisher("listen/status", GoalStatusArray, queue_size=5)
        self.links = [
            rospy.Subscriber("robotsound", SoundRequest, self.hear),
            rospy.Subscriber("questions/listen/status", GoalStatusArray, self.see),
            self.microphone,
            self.status,
        ]

    def close(self):
        for link in self.links:
            link.unregister()

    def hear(self, message):
        with self.changed:
            if message.command == SoundRequest.PLAY_ONCE:
                self.said.append(message.arg)
            self.changed.notify_all()

    def see(self, message):
        with self.changed:
            self.active = any(each.status == GoalStatus.ACTIVE for each in message.status_list)
            self.changed.notify_all()

    def listening(self, wanted):
        """Waits until the listener for questions listens, or does not."""
        with self.changed:
            assert self.changed.wait_for(lambda: self.active is wanted, LONG), wanted

    def applications_listener(self, active):
        goals = [GoalStatus(status=GoalStatus.ACTIVE)] if active else []
        self.status.publish(GoalStatusArray(status_list=goals))

    def ask(self, phrase, wanted):
        """Says it until the answer is as wanted: a busy robot may have had no time to find it out."""
        quiet = np.zeros(RATE, dtype=np.int16)
        said = SpeechSynthesizer().say(phrase, "").samples
        noise = np.random.default_rng(1).normal(0.0, 30.0, len(said) + 2 * len(quiet))
        sound = (np.concatenate([quiet, said, quiet]) + noise).astype("<i2")
        end = time.monotonic() + LONG
        while time.monotonic() < end:
            self.listening(True)
            count = len(self.said)
            for part in np.array_split(sound, 20):
                self.microphone.publish(AudioData(data=part.tobytes()))
            with self.changed:
                answered = self.changed.wait_for(lambda: len(self.said) > count, LONG / 4)  # noqa: B023
                if answered and re.search(wanted, self.said[-1]):
                    return
        raise AssertionError(f"“{phrase}” is not answered so: {self.said}")


class ExecutionQuestions(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.client = MerlinExecutorClient()
        cls.knowledge = MerlinROSPlanAssistant()
        cls.held = HeldDrives()
        cls.explain = patient_service("merlin/explain", Explain, timeout=LONG)
        assert cls.client.wait_for_executor(LONG) and cls.explain.wait(LONG)

    def setUp(self):
        for poi in ("kitchen", "bathroom", "dorm_room", "main_door"):
            self.knowledge.remove_facts(f"(checked {poi})")

    def tearDown(self):
        self.held.end()

    def ask(self, question, about="", at=0.0, goals=()):
        at = rospy.Time.from_sec(at)
        return self.explain(ExplainRequest(question=question, about=about, at=at, goals=goals))

    def told(self, question, words, about="", moment=float, ok=True, kinds=(), goals=()):
        """The answer, when the monitor has recorded what it is about: words, and claims of these kinds.

        What plans for it yields to all else, and may have had no time on a busy machine.
        """
        end = time.monotonic() + LONG
        while True:
            answer = self.ask(question, about, moment(), goals)
            known = {claim.kind for claim in answer.claims}.issuperset(kinds)
            if answer.ok == ok and words in answer.sentence and known:
                return answer
            self.assertLess(time.monotonic(), end, answer)
            rospy.rostime.wallsleep(0.1)  # questions without a pause would starve the recording

    def kinds(self, answer):
        self.assertTrue(all(claim.evidence for claim in answer.claims), answer)
        return [claim.kind for claim in answer.claims]

    def test_what_it_does_and_what_waits_meanwhile(self):
        self.held.hold()
        first = self.client.send("(checked kitchen)", priority=1)
        self.held.wait_driving()
        second = self.client.send("(checked bathroom)")
        doing = self.told(ExplainRequest.DOING, "expected to end", kinds=("running",))
        self.assertEqual(self.kinds(doing)[:2], ["doing", "running"])
        self.assertIn("estimate", self.kinds(doing))
        request = self.told(ExplainRequest.WAITING, "has to end first", "(checked bathroom)")
        self.assertIn("request", self.kinds(request))
        self.told(ExplainRequest.WAITING, "has to end first", "(checked bathroom)", moment=rospy.get_time)
        then = rospy.get_time()  # what comes next is a while later: the recording has its own moments
        step = self.told(ExplainRequest.WAITING, "has to end first")
        self.assertEqual(self.kinds(step), ["order", "condition", "bringer"])
        self.held.end()
        for sent in (first, second):
            self.assertTrue(sent.wait(LONG))
            self.assertIn(sent.result.outcome, ACHIEVED, sent.result.reason)
        self.told(ExplainRequest.WAITING, "Nothing waits")
        past = self.ask(ExplainRequest.WAITING, "(checked bathroom)", then)
        self.assertTrue(past.ok, past.sentence)
        self.assertIn("has to end first", past.sentence)
        goal = self.ask(ExplainRequest.WHY, "(checked kitchen)", then)
        self.assertTrue(goal.ok, goal.sentence)
        self.assertEqual(self.kinds(goal), ["request", "achieved"])
        self.told(
            ExplainRequest.WHAT_IF,
            "the plan would have 2 steps",
            moment=lambda: then,
            goals=["(checked bathroom)"],
        )

    def test_why_a_fact_is_so(self):
        self.assertIn(self.client.execute("(checked kitchen)", LONG).outcome, ACHIEVED)
        answer = self.told(ExplainRequest.SO, "holds: ", "(checked kitchen)", kinds=("action",))
        self.assertEqual(self.kinds(answer), ["action"], answer)
        fact, step = answer.claims[0].evidence
        self.assertGreater(fact.version, 0)
        self.assertEqual(step.text, "(ask kitchen)")
        self.knowledge.remove_facts("(checked kitchen)")
        gone = self.told(ExplainRequest.SO, "does not hold", "(checked kitchen)")
        self.assertIn(rospy.get_name(), gone.sentence)

    def test_who_cancelled(self):
        self.held.hold()
        request = self.client.send("(checked kitchen)")
        self.held.wait_driving()
        request.cancel()
        self.assertTrue(request.wait(LONG))
        # The recording hears of the cancel on a topic of its own.
        answer = self.told(ExplainRequest.FAILED, f"{rospy.get_name()} cancels")
        self.assertEqual(answer.claims[0].kind, "client")

    def wait_until_states_are_heard(self):
        """Waits until the monitor hears of the machines' states: what comes before is not recorded."""
        end = time.monotonic() + LONG
        while True:
            published = bounded_master(LONG).getSystemState()[0]
            topics = [
                name for name, nodes in published if name.endswith("container_status") and HOST in nodes
            ]
            if topics and all(sends(HOST, topic, "/merlin_monitor") for topic in topics):
                return
            self.assertLess(time.monotonic(), end, topics)
            rospy.rostime.wallsleep(0.05)

    def test_a_state_that_could_not_do_its_work(self):
        self.wait_until_states_are_heard()
        self.assertIn(self.client.execute("(robot_at kitchen)", LONG).outcome, ACHIEVED)
        place = rospy.get_param(DORM_ROOM)
        rospy.set_param(DORM_ROOM, {"x": "nowhere"})
        self.addCleanup(rospy.set_param, DORM_ROOM, place)
        result = self.client.execute("(checked dorm_room)", LONG)
        self.assertEqual(outcome_name(result.outcome), "ACTION_FAILED")
        # The recording hears of a machine's states on a topic of their own.
        answer = self.told(ExplainRequest.FAILED, "dorm_room", kinds=("state", "goal"))
        self.assertIn("needs numbers x, y", answer.sentence)
        kinds = self.kinds(answer)
        self.assertEqual([kinds[0], kinds[-1]], ["machine", "goal"])
        self.assertIn("action", kinds)
        self.assertIn("replan", kinds)
        printed = subprocess.run(
            [node_path("merlin", "why"), "--failed", "(checked dorm_room)", "--evidence"],
            capture_output=True,
            text=True,
            timeout=LONG,
            check=True,
        )
        self.assertIn(answer.sentence, printed.stdout)

    def test_questions_that_are_asked_aloud(self):
        ears = Ears()
        self.addCleanup(ears.close)
        self.held.hold()
        request = self.client.send("(checked kitchen)")
        self.held.wait_driving()
        ears.ask("what are you doing", "avigating")
        ears.ask("why", r"^Step 1, .*kitchen[^.]*\.$")
        # The held drive outlasts its time when the other questions took long.
        ears.ask("when do you come", r"^I (will be ready in about \d+ \w+|wanted to be ready \d+ \w+ ago)\.$")
        ears.listening(True)
        ears.applications_listener(True)  # another one of the robot begins to listen
        ears.listening(False)
        ears.applications_listener(False)
        ears.listening(True)
        request.cancel()
        self.assertTrue(request.wait(LONG))

    def test_what_cannot_be_answered_says_why(self):
        for question, about, moment, words in (
            (ExplainRequest.SO, "(chekced kitchen)", float, "chekced"),
            (ExplainRequest.SO, "", float, "say which fact"),
            (ExplainRequest.WAITING, "(ask moon)", float, "is neither in the plan nor in the queue"),
            (ExplainRequest.FAILED, "kitchen", float, "is not PDDL"),
            (ExplainRequest.DOING, "", lambda: 5.0, "the recording is of"),
        ):
            self.told(question, words, about, moment, ok=False)


if __name__ == "__main__":
    init_node("execution_test")
    rostest.rosrun("merlin_test", "execution", ExecutionQuestions)
