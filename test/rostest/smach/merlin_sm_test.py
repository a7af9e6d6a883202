# SPDX-License-Identifier: Apache-2.0
"""State machines of MERLIN: what the robot knows, what the ready states do, and how they stop."""

import threading
import unittest

import rospy
from sound_play.msg import SoundRequestActionGoal
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

import smach
from merlin_planning.knowledge_client import KnowledgeError
from merlin_planning.knowledge_text import PDDLSyntaxError
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.merlin_state import MerlinState
from merlin_test import LONG
from merlin_test.held_drives import HeldDrives

OUTCOMES = ["succeeded", "aborted", "preempted"]
create = MerlinStateFactory.create


def machine(state, **userdata):
    sm = MerlinSM(OUTCOMES)
    for key, value in userdata.items():
        sm.userdata[key] = value
    with sm:
        sm.add("ONLY", state)
    return sm


class Knowledge(unittest.TestCase):
    def setUp(self):
        self.sm = MerlinSM(OUTCOMES)
        self.assertTrue(self.sm.knowledge.wait(LONG))
        self.sm.remove_facts(self.sm.facts("checked") or ["(checked kitchen)"])

    def test_facts(self):
        self.sm.add_facts(["(checked kitchen)", "(checked bathroom)"])
        self.assertTrue(self.sm.holds("(and (checked kitchen) (not (checked dorm_room)))"))
        self.sm.change_facts(add="(checked dorm_room)", remove="(checked kitchen)")
        self.assertEqual(sorted(self.sm.facts("checked")), ["(checked bathroom)", "(checked dorm_room)"])
        self.sm.add_facts("(not (checked bathroom))")
        self.assertFalse(self.sm.holds("(checked bathroom)"))

    def test_objects(self):
        self.sm.add_objects("poi", "garage", "attic")
        self.assertLessEqual({"garage", "attic", "kitchen"}, set(self.sm.objects("poi")))
        self.assertIn("anywhere", self.sm.objects("place"))
        self.sm.add_facts("(checked attic)")
        self.sm.remove_objects("poi", "garage", "attic")
        self.assertNotIn("attic", self.sm.objects())
        self.assertNotIn("(checked attic)", self.sm.facts())

    def test_goals(self):
        self.sm.add_goals(["(checked kitchen)", "(not (checked bathroom))"])
        self.assertEqual(self.sm.goals(), ["(checked kitchen)", "(not (checked bathroom))"])
        self.sm.remove_goals(["(checked kitchen)", "(not (checked bathroom))"])
        self.assertEqual(self.sm.goals(), [])

    def test_values(self):
        self.sm.set_value("travel_time", "kitchen", "bathroom", value=12.5)
        self.assertEqual(self.sm.value("travel_time", "kitchen", "bathroom"), 12.5)
        self.assertIsNone(self.sm.value("travel_time", "bathroom", "bathroom"))
        self.assertTrue(self.sm.holds("(> (travel_time kitchen bathroom) 12)"))

    def test_nonsense_is_refused_and_changes_nothing(self):
        before = self.sm.facts()
        for fact in ("(clean kitchen)", "(checked moon)", "(checked kitchen bathroom)"):
            with self.assertRaises(KnowledgeError):
                self.sm.add_facts(["(checked kitchen)", fact])
        with self.assertRaises(PDDLSyntaxError):
            self.sm.add_facts("checked kitchen")
        self.assertEqual(self.sm.facts(), before)


class Stop(MerlinState):
    """Waits for a preempt."""

    def __init__(self):
        super().__init__()
        self.begun = threading.Event()

    def run(self, userdata):
        ended = threading.Event()
        self.interruptible(ended.set)
        self.begun.set()
        ended.wait(LONG)
        return "preempted"


class States(unittest.TestCase):
    def run_and_preempt(self, sm, ready):
        outcomes = []
        thread = threading.Thread(target=lambda: outcomes.append(sm.execute()))
        thread.start()
        ready()
        sm.request_preempt()
        thread.join(LONG)
        self.assertEqual(outcomes, ["preempted"])

    def test_navigation(self):
        sm = machine(create("navigation"), target="kitchen")
        self.assertEqual(sm.execute(), "succeeded")

    def test_navigation_says_what_is_wrong_with_a_place(self):
        for place, reason in (("moon", "kitchen"), ("broken", "numbers"), ("nowhere", "numbers")):
            sm = machine(create("navigation", place))
            self.assertEqual(sm.execute(), "aborted")
            self.assertIn(reason, sm.reason)

    def test_a_preempt_stops_navigation_and_the_machine_runs_again(self):
        drives = HeldDrives()
        drives.hold()
        self.addCleanup(drives.end)
        sm = machine(create("navigation", "kitchen"))
        self.run_and_preempt(sm, drives.wait_driving)
        drives.wait_stopped()
        self.assertEqual(sm.execute(), "succeeded")

    def test_speaking_fills_in_userdata(self):
        said = []
        heard = threading.Event()

        def hear(message):
            said.append(message.goal.sound_request)
            heard.set()

        sm = machine(create("speak", "I am in the {room}.", keys=("room",)), room="kitchen")
        subscriber = rospy.Subscriber("sound_play/goal", SoundRequestActionGoal, hear)
        self.addCleanup(subscriber.unregister)
        while not heard.wait(0.1):  # the first goals may be sent before this subscriber is connected
            self.assertEqual(sm.execute(), "succeeded")
        self.assertEqual((said[-1].arg, said[-1].volume), ("I am in the kitchen.", 1.0))

    def test_nothing_to_say_is_refused(self):
        sm = machine(create("speak"), text="  ")
        self.assertEqual(sm.execute(), "aborted")
        self.assertIn("no text", sm.reason)

    def test_a_missing_server_is_named(self):
        sm = machine(create("navigation", "kitchen", action="nowhere", server_wait=0.2))
        self.assertEqual(sm.execute(), "aborted")
        self.assertIn("/nowhere", sm.reason)

    def test_a_service(self):
        service = rospy.Service("ask_me", Trigger, lambda request: TriggerResponse(True, "yes"))
        self.addCleanup(service.shutdown)
        answers = []
        state = create("service", "ask_me", Trigger, on_response=lambda ud, r: answers.append(r.message))
        self.assertEqual(machine(state).execute(), "succeeded")
        self.assertEqual(answers, ["yes"])

    def test_a_preempt_ends_the_wait_for_a_service(self):
        sm = machine(create("service", "never_there", Trigger, wait=LONG))
        begun = threading.Event()
        sm.register_start_cb(lambda *_: begun.set())  # a request that comes before is not for this run
        self.run_and_preempt(sm, begun.wait)

    def test_a_topic(self):
        publisher = rospy.Publisher("news", String, latch=True, queue_size=1)
        publisher.publish("good")
        state = create("topic", "news", String, lambda ud, message: message.data == "good", timeout=LONG)
        self.assertEqual(machine(state).execute(), "succeeded")
        state = create("topic", "news", String, lambda ud, message: False, timeout=0.2)
        sm = machine(state)
        self.assertEqual(sm.execute(), "aborted")
        self.assertIn("/news", sm.reason)

    def test_code_of_users_that_fails_ends_the_state(self):
        publisher = rospy.Publisher("words", String, latch=True, queue_size=1)
        publisher.publish("one")
        with self.assertRaisesRegex(smach.InvalidUserCodeError, "can only concatenate str"):
            machine(create("topic", "words", String, lambda ud, message: message.data + 1)).execute()
        service = rospy.Service("ask_me", Trigger, lambda request: TriggerResponse(True, "yes"))
        self.addCleanup(service.shutdown)
        sm = machine(create("service", "ask_me", Trigger, lambda ud: String("of another type")))
        self.assertEqual(sm.execute(), "aborted")
        self.assertIn("it has to be a TriggerRequest", sm.reason)

    def test_knowledge(self):
        sm = machine(create("knowledge", add=["(checked {room})"], keys=["room"]), room="kitchen")
        self.assertEqual(sm.execute(), "succeeded")
        self.assertTrue(sm.holds("(checked kitchen)"))
        sm = machine(create("knowledge", add=["(checked {room})"], keys=["room"]), room="moon")
        self.assertEqual(sm.execute(), "aborted")
        self.assertTrue(sm.reason)

    def test_a_cancel_before_the_run_is_not_lost(self):
        sm = machine(Stop())
        sm.prepare()
        sm.cancel()
        self.assertEqual(sm.execute(), "preempted")
        sm.prepare()
        self.run_and_preempt(sm, sm["ONLY"].begun.wait)

    def test_users_register_their_states(self):
        MerlinStateFactory.register("stop", Stop)
        self.assertIsInstance(create("stop"), Stop)
        with self.assertRaises(ValueError):
            MerlinStateFactory.register("stop", MerlinState)
        with self.assertRaises(KeyError) as caught:
            create("fly")
        self.assertIn("navigation", str(caught.exception))


class MerlinSMSuite(Knowledge, States):
    pass
