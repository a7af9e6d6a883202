# SPDX-License-Identifier: Apache-2.0
"""sound_play as its clients hear it: true lengths, cut-offs, errors."""

import threading
import unittest

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from audio_common_msgs.msg import AudioData, AudioInfo
from sound_play.msg import SoundRequest, SoundRequestAction, SoundRequestActionResult, SoundRequestGoal
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from merlin_reactive.speech.speech_synthesizer import SpeechSynthesizer
from merlin_ros.actions.action_client import ActionClient
from merlin_test import LONG
from merlin_test.topic_links import patient_service, wait_for_connections, wait_for_publishers

SENTENCE = "Good morning. Do you need anything from the kitchen or from anywhere else?"
STORY = " ".join([SENTENCE] * 20)  # is not over when a test without a processor comes to its cancel


class Speech(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.changed = threading.Condition()
        cls.bytes = 0
        cls.speaking = None
        cls.begun = 0  # how often it has begun to speak: a short sound may be over before a test looks
        cls.info = None
        cls.active = set()  # goals that were accepted
        cls.node_time = rospy.Time()  # by the clock of the node, as it has said last
        cls.ended = {}  # goal -> when it ended, by the clock of the node
        cls.subscribers = [
            rospy.Subscriber("alone/audio/speaker", AudioData, cls.hear, queue_size=100),
            rospy.Subscriber("alone/audio/speaker_info", AudioInfo, lambda m: setattr(cls, "info", m)),
            rospy.Subscriber("alone/sound_play/is_speaking", Bool, cls.see),
            rospy.Subscriber("alone/sound_play/status", GoalStatusArray, cls.see_goals),
            rospy.Subscriber("alone/sound_play/result", SoundRequestActionResult, cls.see_end),
        ]
        assert patient_service("/merlin_sim/pause", Trigger).wait(LONG), "the simulator has started"
        cls.client = ActionClient("alone/sound_play", SoundRequestAction)
        assert cls.client.wait_for_server(LONG)
        wait_for_publishers(*cls.subscribers)

    @classmethod
    def tearDownClass(cls):
        for subscriber in cls.subscribers:
            subscriber.unregister()

    @classmethod
    def hear(cls, message):
        with cls.changed:
            cls.bytes += len(message.data)
            cls.changed.notify_all()

    @classmethod
    def see(cls, message):
        with cls.changed:
            cls.speaking = message.data
            cls.begun += message.data
            cls.changed.notify_all()

    @classmethod
    def see_goals(cls, message):
        with cls.changed:
            cls.node_time = message.header.stamp
            cls.active |= {s.goal_id.id for s in message.status_list if s.status == GoalStatus.ACTIVE}
            cls.changed.notify_all()

    @classmethod
    def see_end(cls, message):
        with cls.changed:
            cls.ended[message.status.goal_id.id] = message.header.stamp
            cls.changed.notify_all()

    def wait(self, predicate):
        with self.changed:
            self.assertTrue(self.changed.wait_for(predicate, timeout=LONG), "did not come true")

    def send(self, sound=SoundRequest.SAY, arg=SENTENCE, arg2="", command=SoundRequest.PLAY_ONCE, volume=1.0):
        request = SoundRequest(sound=sound, command=command, volume=volume, arg=arg, arg2=arg2)
        # Not leased: a busy machine may let a client stand still for longer than its lease lasts.
        return self.client.send(SoundRequestGoal(sound_request=request), lasting=True)

    def test_a_sentence_lasts_as_long_as_its_sound(self):
        length = SpeechSynthesizer().say(SENTENCE).duration
        self.wait(lambda: self.speaking is False)
        heard, begun, before = self.bytes, self.begun, self.node_time
        self.wait(lambda: self.node_time > before)
        began = self.node_time  # its clock may be behind that of this process
        goal = self.send()
        self.wait(lambda: self.begun > begun)
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.SUCCEEDED)
        self.assertAlmostEqual(goal.result.stamp.to_sec(), length, delta=0.01)
        self.wait(lambda: goal.id in self.ended)
        self.assertGreaterEqual((self.ended[goal.id] - began).to_sec(), length)
        self.wait(lambda: self.info and self.bytes - heard >= 2 * round(length * self.info.sample_rate))
        self.wait(lambda: self.speaking is False)

    def test_a_cancel_cuts_it_off(self):
        goal = self.send(arg=STORY)
        self.wait(lambda: self.speaking and goal.feedback is not None)
        goal.cancel()
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.PREEMPTED)
        self.assertLess(goal.result.stamp.to_sec(), SpeechSynthesizer().say(STORY).duration)
        self.wait(lambda: self.speaking is False)

    def test_a_cancel_does_not_wait_for_a_long_text_to_be_synthesised(self):
        goal = self.send(arg="word " * 50000)  # takes longer than a client waits for a voice
        self.wait(lambda: goal.id in self.active)
        goal.cancel()
        self.assertTrue(goal.wait(LONG))
        self.assertIn(goal.status, (GoalStatus.PREEMPTED, GoalStatus.RECALLED), goal.text)

    def test_a_cancel_works_while_time_stands_still(self):
        pause, resume = (patient_service(f"/merlin_sim/{verb}", Trigger) for verb in ("pause", "resume"))
        self.assertTrue(pause.wait(LONG) and resume.wait(LONG))
        goal = self.send(arg=STORY)
        self.wait(lambda: self.speaking and goal.feedback is not None)
        pause()
        try:
            goal.cancel()
            self.assertTrue(goal.wait(LONG))
        finally:
            resume()
        self.assertEqual(goal.status, GoalStatus.PREEMPTED)

    def test_what_cannot_be_said_is_refused_with_a_reason(self):
        for fields, word in (
            ({"arg": "  "}, "no text"),
            ({"arg2": "xx-none"}, "voice"),
            ({"arg2": "en\0"}, "voice"),
            ({"sound": 77}, "built-in sound"),
            ({"sound": SoundRequest.PLAY_FILE, "arg": "/nowhere.wav"}, "/nowhere.wav"),
            ({"command": 9}, "command"),
            ({"volume": float("nan")}, "volume"),
        ):
            goal = self.send(**fields)
            self.assertTrue(goal.wait(LONG))
            self.assertEqual(goal.status, GoalStatus.ABORTED, fields)
            self.assertIn(word, goal.text)

    def publisher(self):
        publisher = rospy.Publisher("alone/robotsound", SoundRequest, queue_size=5)
        wait_for_connections(publisher)
        return publisher

    def test_the_topic_speaks_and_stops(self):
        publisher = self.publisher()
        publisher.publish(
            SoundRequest(sound=SoundRequest.SAY, command=SoundRequest.PLAY_START, volume=1.0, arg="again")
        )
        self.wait(lambda: self.speaking)
        publisher.publish(SoundRequest(sound=SoundRequest.ALL, command=SoundRequest.PLAY_STOP))
        self.wait(lambda: self.speaking is False)

    def test_a_sound_that_waits_for_its_turn_can_be_stopped(self):
        publisher = self.publisher()
        pause, resume = (patient_service(f"/merlin_sim/{verb}", Trigger) for verb in ("pause", "resume"))
        self.assertTrue(pause.wait(LONG) and resume.wait(LONG))
        publisher.publish(
            SoundRequest(sound=SoundRequest.SAY, command=SoundRequest.PLAY_START, volume=1.0, arg="again")
        )
        self.wait(lambda: self.speaking)
        pause()  # the sound of the topic does not end meanwhile
        try:
            goal = self.send()
            self.wait(lambda: goal.id in self.active)
            publisher.publish(
                SoundRequest(sound=SoundRequest.SAY, command=SoundRequest.PLAY_ONCE, volume=1.0, arg="later")
            )
            goal.cancel()
            self.assertTrue(goal.wait(LONG))
            self.assertIn(goal.status, (GoalStatus.PREEMPTED, GoalStatus.RECALLED))
        finally:
            resume()
            publisher.publish(SoundRequest(sound=SoundRequest.ALL, command=SoundRequest.PLAY_STOP))
        self.wait(lambda: self.speaking is False)
