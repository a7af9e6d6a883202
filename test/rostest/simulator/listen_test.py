# SPDX-License-Identifier: Apache-2.0
"""listen as its clients use it."""

import os
import signal
import threading
import unittest
from pathlib import Path
from xmlrpc.client import ServerProxy

import numpy as np
import rosgraph
import rospy
from actionlib_msgs.msg import GoalStatus
from audio_common_msgs.msg import AudioData
from merlin_msgs.msg import ListenAction, ListenGoal
from merlin_msgs.srv import SetAnswers
from sound_play.msg import SoundRequest, SoundRequestAction, SoundRequestGoal

from merlin_reactive.speech.speech_synthesizer import RATE, SpeechSynthesizer
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.publishing import OnSubscriber
from merlin_test import LONG
from merlin_test.conversation import wait_for_conversation
from merlin_test.process_signals import hang
from merlin_test.topic_links import patient_service

ORDERS = "#JSGF V1.0; grammar order; public <order> = [please] bring me (a | the) (coffee | tea) [please];"
ANSWERS = "#JSGF V1.0; grammar answer; public <answer> = (seven | eleven) of them;"


def recognizers():
    """The process ids of the speech recogniser: a process of its own below the node."""
    node = rosgraph.Master(rospy.get_name()).lookupNode("/listen")
    _, _, parent = ServerProxy(node).getPid(rospy.get_name())
    children = Path("/proc").glob(f"{parent}/task/*/children")
    return {int(pid) for listed in children for pid in listed.read_text().split()}


class Listen(unittest.TestCase):
    def setUp(self):
        self.listen = ActionClient("listen", ListenAction)
        self.speak = ActionClient("sound_play", SoundRequestAction)
        self.assertTrue(self.listen.wait_for_server(LONG))
        self.assertTrue(self.speak.wait_for_server(LONG))
        wait_for_conversation()
        tell = patient_service("person_voice/set_answers", SetAnswers)
        self.assertTrue(tell.wait(LONG))
        self.assertTrue(tell(person="guest_2", otherwise=["bring me a coffee please"]).success)

    def ask(self):
        request = SoundRequest(
            sound=SoundRequest.SAY, command=SoundRequest.PLAY_ONCE, volume=1.0, arg="What can I do?"
        )
        self.speak.send(SoundRequestGoal(sound_request=request), lasting=True)

    def listen_for(self, goal, **options):
        """Not leased: a busy machine may let a client stand still for longer than its lease lasts."""
        return self.listen.send(goal, lasting=True, **options)

    def hear(self, grammar, timeout=100.0):
        return self.listen_for(ListenGoal(grammar=grammar, timeout=rospy.Duration(timeout)))

    def hear_answer(self, grammar):
        """Asks aloud when the robot listens already; returns its goal."""
        listening = threading.Event()
        goal = self.listen_for(
            ListenGoal(grammar=grammar, timeout=rospy.Duration(100.0)),
            on_feedback=lambda *_: listening.set(),
        )
        self.assertTrue(listening.wait(LONG))
        self.ask()
        return goal

    def test_an_answer_is_understood(self):
        goal = self.hear_answer(ORDERS)
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.SUCCEEDED)
        self.assertEqual(goal.result.text, "bring me a coffee please")
        self.assertTrue(goal.result.heard)
        self.assertGreater(goal.result.confidence, 0.5)

    def test_sound_with_a_byte_too_many_is_understood(self):
        self.assertEqual(self.understood("bring me the tea", extra=b"?"), "bring me the tea")

    def test_a_cancel_while_it_thinks_about_what_was_said_ends_it(self):
        thinking = threading.Event()
        (recognizer,) = recognizers()
        self.addCleanup(os.kill, recognizer, signal.SIGCONT)
        goal = self.say(
            "bring me the tea",
            on_speech=lambda: hang(recognizer),  # so that it thinks for long enough
            on_silence=thinking.set,
        )
        self.assertTrue(thinking.wait(LONG))
        goal.cancel()
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.PREEMPTED)
        self.assertEqual((goal.result.text, goal.result.heard), ("", True))

    def understood(self, text, **how):
        """What the robot understands when it hears this."""
        goal = self.say(text, **how)
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.SUCCEEDED)
        return goal.result.text

    def say(self, text, extra=b"", on_speech=lambda: None, on_silence=lambda: None):
        """Lets the robot listen, and says something to it; returns its goal.

        :param extra: bytes after each part of the sound.
        :param on_speech: called when the robot has noticed that a person speaks.
        :param on_silence: called when the robot has noticed that the sentence is over.
        """
        subscribed = threading.Event()
        notice = OnSubscriber(lambda _: subscribed.set())
        microphone = rospy.Publisher("audio/microphone", AudioData, notice, queue_size=50)
        self.addCleanup(microphone.unregister)
        quiet = np.zeros(RATE, dtype=np.int16)
        said = SpeechSynthesizer().say(text, "").samples
        noise = np.random.default_rng(1).normal(0.0, 30.0, len(said) + 2 * len(quiet))
        sound = (np.concatenate([quiet, said, quiet]) + noise).astype("<i2")
        self.assertTrue(subscribed.wait(LONG))
        listening, speaking = threading.Event(), threading.Event()

        def note(_, feedback):
            if feedback.speech:
                speaking.set()
            elif speaking.is_set():
                on_silence()
            else:
                listening.set()

        timeout = rospy.Duration(1000.0)
        goal = self.listen_for(ListenGoal(grammar=ORDERS, timeout=timeout), on_feedback=note)
        self.assertTrue(listening.wait(LONG))
        parts = np.array_split(sound, 20)
        for part in parts[:10]:
            microphone.publish(AudioData(data=part.tobytes() + extra))
        self.assertTrue(speaking.wait(LONG))
        on_speech()
        for part in parts[10:]:
            microphone.publish(AudioData(data=part.tobytes() + extra))
        return goal

    def test_what_the_grammar_does_not_allow_is_not_understood(self):
        goal = self.hear_answer(ANSWERS)
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.SUCCEEDED)
        self.assertEqual((goal.result.text, goal.result.heard), ("", True))

    def test_silence_times_out_and_a_cancel_ends_it(self):
        goal = self.hear(ORDERS, timeout=2.0)
        self.assertTrue(goal.wait(LONG))
        self.assertEqual((goal.result.text, goal.result.heard), ("", False))
        self.assertIn("no speech", goal.text)
        goal = self.hear(ORDERS, timeout=1000.0)
        goal.cancel()
        self.assertTrue(goal.wait(LONG))
        self.assertIn(goal.status, (GoalStatus.PREEMPTED, GoalStatus.RECALLED))

    def test_a_bad_grammar_is_refused(self):
        for grammar in ("", "this is not a grammar", "#JSGF V1.0; grammar g; public <g> = qwrtzp;"):
            goal = self.hear(grammar)
            self.assertTrue(goal.wait(LONG))
            self.assertEqual(goal.status, GoalStatus.ABORTED, grammar)
            self.assertIn("grammar", goal.text)

    def test_a_negative_time_out_is_refused(self):
        goal = self.hear(ORDERS, timeout=-1.0)
        self.assertTrue(goal.wait(LONG))
        self.assertEqual((goal.status, "negative" in goal.text), (GoalStatus.ABORTED, True), goal.text)
