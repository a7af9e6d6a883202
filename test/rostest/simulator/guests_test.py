# SPDX-License-Identifier: Apache-2.0
"""Guests of a restaurant: the nearest answers, with the answers that the application set."""

import threading
import unittest

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from merlin_msgs.msg import ListenAction, ListenGoal, PersonHeard, SimPeople, SimPerson
from merlin_msgs.srv import PlaceThing, SetAnswers
from sound_play.msg import SoundRequest, SoundRequestAction, SoundRequestGoal

from merlin_ros.actions.action_client import ActionClient
from merlin_test import LONG
from merlin_test.conversation import wait_for_conversation
from merlin_test.topic_links import patient_service, wait_for_publishers

ORDERS = "#JSGF V1.0; grammar order; public <order> = [please] bring me (a | the) (coffee | tea) [please];"


class Guests(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.listen = ActionClient("listen", ListenAction)
        cls.speak = ActionClient("sound_play", SoundRequestAction)
        cls.tell = patient_service("person_voice/set_answers", SetAnswers)
        cls.place = patient_service("/merlin_sim/place", PlaceThing)
        for server in (cls.listen, cls.speak):
            assert server.wait_for_server(LONG), "speech and hearing have started"
        for service in (cls.tell, cls.place):
            assert service.wait(LONG), "the simulator and the guests have started"
        cls.changed = threading.Condition()
        cls.heard, cls.health, cls.absent = [], {}, set()
        cls.subscribers = [
            rospy.Subscriber("person_voice/heard", PersonHeard, cls.note, tcp_nodelay=True),
            rospy.Subscriber("/diagnostics", DiagnosticArray, cls.diagnose),
            rospy.Subscriber("/merlin_sim/people", SimPeople, cls.see),
        ]
        wait_for_publishers(*cls.subscribers)
        wait_for_conversation()
        # Guests hear the robot once they have the positions of all people.
        cls.wait(lambda: cls.health.get("person_voice: people") == "ready to answer")

    @classmethod
    def tearDownClass(cls):
        for subscriber in cls.subscribers:
            subscriber.unregister()

    @classmethod
    def note(cls, message):
        with cls.changed:
            cls.heard.append(message)
            cls.changed.notify_all()

    @classmethod
    def see(cls, message):
        with cls.changed:
            cls.absent = {person.name for person in message.people if person.state == SimPerson.ABSENT}
            cls.changed.notify_all()

    @classmethod
    def diagnose(cls, message):
        with cls.changed:
            cls.health.update({status.name: status.message for status in message.status})
            cls.changed.notify_all()

    @classmethod
    def wait(cls, predicate):
        with cls.changed:
            assert cls.changed.wait_for(predicate, timeout=LONG), f"not within {LONG} s: {cls.health}"

    def say(self, text):
        request = SoundRequest(sound=SoundRequest.SAY, command=SoundRequest.PLAY_ONCE, volume=1.0, arg=text)
        return self.speak.send(SoundRequestGoal(sound_request=request), lasting=True)

    def ask(self, text):
        """Asks aloud; returns what was understood of the answer, and which guest heard what."""
        self.heard.clear()
        listening = threading.Event()
        hearing = self.listen.send(
            ListenGoal(grammar=ORDERS, timeout=rospy.Duration(100.0)),
            on_feedback=lambda *_: listening.set(),
            lasting=True,  # not leased: a busy machine may let a client stand still for longer
        )
        self.assertTrue(listening.wait(LONG))
        self.say(text)
        self.assertTrue(hearing.wait(LONG))
        self.wait(lambda: self.heard)
        return hearing.result.text, [(m.person, m.question, m.answer) for m in self.heard]

    def test_the_nearest_guest_answers_what_it_was_told(self):
        told = self.tell(person="guest_2", patterns=["would you like"], answers=["bring me a coffee please"])
        self.assertTrue(told.success, told.message)
        question = "What would you like?"
        text, heard = self.ask(question)
        self.assertEqual(heard, [("guest_2", question, "bring me a coffee please")])
        self.assertEqual(text, "bring me a coffee please")

    def test_who_is_absent_hears_nothing_and_the_next_one_does(self):
        self.assertTrue(self.place(name="guest_2", absent=True).success)
        self.addCleanup(self.wait, lambda: "guest_2" not in self.absent)
        self.addCleanup(self.place, name="guest_2", x=0.75, y=4.2)
        self.wait(lambda: "guest_2" in self.absent)
        self.assertTrue(self.tell(person="guest_1", next=["bring me the tea"]).success)
        text, heard = self.ask("Hello?")
        self.assertEqual(heard, [("guest_1", "Hello?", "bring me the tea")])
        self.assertEqual(text, "bring me the tea")

    def test_what_is_said_while_somebody_answers_is_heard_too(self):
        answer = "bring me a coffee and a tea and a coffee and a tea please"
        self.assertTrue(self.tell(person="guest_2", patterns=["would you like"], answers=[answer]).success)
        self.heard.clear()
        sentences = ["What would you like?", "One.", "Two.", "Three."]
        for sentence in sentences:
            self.assertTrue(self.say(sentence).wait(LONG))
        self.wait(lambda: len(self.heard) == len(sentences))
        self.assertEqual([(m.person, m.question) for m in self.heard], [("guest_2", s) for s in sentences])

    def test_nonsense_is_refused_with_a_sentence(self):
        for answer, words in (
            (self.tell(person="nobody"), "there is no person 'nobody'"),
            (self.tell(person=""), "there is no person ''"),
            (self.tell(person="guest_1", patterns=["(a"], answers=["b"]), "not a regular expression"),
        ):
            self.assertFalse(answer.success)
            self.assertIn(words, answer.message)

    def test_every_part_tells_how_it_does(self):
        parts = ("soundplay_node: speech", "listen: listen", "person_voice: people", "merlin_sim: world")
        self.wait(lambda: all(part in self.health for part in parts))
