# SPDX-License-Identifier: Apache-2.0
"""Missions as a plain node and as a state machine, over the Executor."""

import threading
import unittest

import rospy
from actionlib_msgs.msg import GoalID
from merlin_msgs.msg import ExecutorStatus, MachineHolds, MissionStatus, StateOutcome
from merlin_msgs.srv import BreakpointsRequest
from smach_msgs.msg import SmachContainerStructure
from std_msgs.msg import String
from std_srvs.srv import Trigger

import smach
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.mission.goal_dispatcher import GoalDispatcher, MissionFailed, MissionSM
from merlin_pddl.breakpoints import BreakpointError
from merlin_sm.breakpoint_client import MachineNodes
from merlin_sm.holding.node_holds import CONSOLES_TOPIC, node_holds
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.held_drives import HeldDrives
from merlin_test.topic_links import wait_for_publishers

POIS = ("kitchen", "bathroom", "dorm_room", "main_door")


class Round(GoalDispatcher):
    def run(self):
        for poi in POIS[:2]:
            self.achieve(f"(checked {poi})")


class Sender(GoalDispatcher):
    def run(self):
        self.client.send("(checked kitchen)").wait(LONG)


class Impossible(GoalDispatcher):
    def run(self):
        self.achieve("(checked moon)")


class Broken(GoalDispatcher):
    def run(self):
        raise KeyError("hallway")


class BrokenMachine(MissionSM):
    def build(self):
        self.add_goal_state("KITCHEN", lambda userdata: {}["hallway"], {"nothing": "succeeded"})


class Evening(MissionSM):
    def build(self):
        self.add_goal_state("KITCHEN", "(checked kitchen)", {"succeeded": "DOOR"})
        goals = ["(checked main_door)", "(checked bathroom)"]
        self.add_goal_state("DOOR", goals, autonomy={"succeeded": "high"})


class GoalDispatchers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        # The nodes begin together with this test.
        for service in ("update_array", "query_state", "state/goals"):
            rospy.wait_for_service(f"rosplan_knowledge_base/{service}", LONG)
        cls.given = MerlinROSPlanAssistant().goals()
        cls.client = MerlinExecutorClient()
        assert cls.client.wait_for_executor(LONG)
        cls.drives = HeldDrives()
        cls.client_of_an_operator = rospy.Publisher("merlin/execute/cancel", GoalID, queue_size=1)

    def setUp(self):
        self.knowledge = MerlinROSPlanAssistant()
        for poi in POIS:
            self.knowledge.remove_facts(f"(checked {poi})")
        self.changed = threading.Condition()
        self.missions = []
        self.running = []  # goals of which an action runs
        self.idle = False
        self.waits = ""
        self.subscribers = [
            rospy.Subscriber("merlin/mission", MissionStatus, self.receive),
            rospy.Subscriber("merlin/status", ExecutorStatus, self.receive_executor),
        ]

        self.wait(lambda: self.idle)

    def followed(self, mission):
        """A mission whose words come here from now on."""
        wait_for_publishers(self.subscribers[0])
        return mission

    def driving(self, mission, run):
        """Begins a mission; returns its thread and its end when the robot drives, until `drives` ends it."""
        elsewhere = "(robot_at dorm_room)"  # no mission here begins there
        self.client.execute(elsewhere, LONG)
        self.drives.hold()
        ended = []
        thread = threading.Thread(target=lambda: ended.append(run()))
        thread.start()
        self.drives.wait_driving()
        self.wait(lambda: self.running and elsewhere not in self.running)
        return thread, ended

    def tearDown(self):
        self.drives.end()
        for subscriber in self.subscribers:
            subscriber.unregister()
        self.assertEqual(self.knowledge.goals(), self.given)  # those of the problem, and no more

    def receive(self, status):
        with self.changed:
            self.missions.append((status.mission, status.state, status.task, status.description))
            self.changed.notify_all()

    def receive_executor(self, status):
        with self.changed:
            self.running = list(status.goals) if status.running else []
            self.idle = status.state == ExecutorStatus.IDLE
            self.waits = status.waits
            self.changed.notify_all()

    def wait(self, holds):
        with self.changed:
            self.assertTrue(self.changed.wait_for(holds, LONG), self.missions)

    def test_a_plain_mission_sends_one_goal_after_the_other(self):
        self.assertTrue(self.followed(Round(tasks=2)).execute())
        self.assertTrue(self.knowledge.holds("(and (checked kitchen) (checked bathroom))"))
        self.wait(lambda: ("Round", MissionStatus.SUCCEEDED, 2, "done") in self.missions)

    def test_a_mission_that_sends_by_itself_is_shown_as_running(self):
        self.assertTrue(self.followed(Sender()).execute())
        self.wait(lambda: ("Sender", MissionStatus.RUNNING, 1, "(checked kitchen)") in self.missions)

    def test_a_mission_that_cannot_be_says_why(self):
        self.assertFalse(self.followed(Impossible()).execute())
        self.wait_failed("Impossible")
        self.assertIn("moon", self.missions[-1][3])

    def wait_failed(self, mission):
        self.wait(lambda: self.missions and self.missions[-1][:2] == (mission, MissionStatus.FAILED))

    def test_a_mission_whose_own_code_fails_is_told_of_before_it_ends(self):
        for mission, error in ((Broken, KeyError), (BrokenMachine, smach.InvalidUserCodeError)):
            made = self.followed(mission())
            with self.assertRaises(error):
                made.run() if mission is BrokenMachine else made.execute()
            self.wait_failed(mission.__name__)
            self.assertIn("hallway", self.missions[-1][3])

    def test_a_cancelled_mission_stops_and_sends_nothing_more(self):
        mission = self.followed(Round())
        thread, ended = self.driving(mission, mission.execute)
        mission.cancel()
        thread.join(LONG)
        self.assertEqual(ended, [False])
        self.wait(lambda: self.missions and self.missions[-1][1] == MissionStatus.CANCELLED)
        self.assertFalse(self.knowledge.holds("(checked bathroom)"))

    def test_a_mission_whose_robot_is_stopped_goes_on_after_the_release(self):
        mission = self.followed(Round())
        thread, ended = self.driving(mission, mission.execute)
        self.assertTrue(rospy.ServiceProxy("merlin/stop", Trigger)().success)
        self.addCleanup(rospy.ServiceProxy("merlin/release", Trigger))
        self.wait(lambda: "the base is held by" in self.waits)  # its drive fails, and no other one begins
        self.client_of_an_operator.publish(GoalID())  # that cancels all requests, as the page does
        self.wait(lambda: self.missions[-1][1] == MissionStatus.PAUSED and self.idle)
        self.assertEqual(ended, [])
        self.drives.end()
        self.assertTrue(rospy.ServiceProxy("merlin/release", Trigger)().success)
        thread.join(LONG)
        self.assertEqual(ended, [True])
        self.assertTrue(self.knowledge.holds("(and (checked kitchen) (checked bathroom))"))

    def test_a_paused_mission_ends_its_goal_and_goes_on_when_resumed(self):
        mission = self.followed(Round())
        thread, ended = self.driving(mission, mission.execute)
        self.assertTrue(self.call("pause").success)
        again = self.call("pause")
        self.assertFalse(again.success)
        self.assertIn("already", again.message)
        self.drives.end()
        self.wait(lambda: self.missions[-1][1] == MissionStatus.PAUSED and self.idle)
        # Paused at its first goal, which it still reaches; the second is not sent before it is resumed.
        self.assertTrue(self.knowledge.holds("(checked kitchen)"))
        self.assertFalse(self.knowledge.holds("(checked bathroom)"))
        self.assertTrue(self.call("resume").success)
        thread.join(LONG)
        self.assertEqual(ended, [True])
        self.assertTrue(self.knowledge.holds("(checked bathroom)"))
        with self.assertRaises(rospy.ServiceException):
            self.call("pause")

    def test_a_paused_machine_can_be_preempted(self):
        mission = Evening()
        thread, outcomes = self.driving(mission, mission.run)
        self.assertTrue(self.call("pause").success)
        self.drives.end()
        self.wait(lambda: self.idle)
        mission.request_preempt()
        thread.join(LONG)
        self.assertEqual(outcomes, ["preempted"])
        self.assertFalse(self.knowledge.holds("(checked main_door)"))

    def call(self, name):
        return rospy.ServiceProxy(f"merlin/mission/{name}", Trigger)()

    def test_a_goal_that_takes_too_long_is_cancelled(self):
        mission = Round()
        self.assertTrue(mission.client.wait_for_executor(LONG))
        self.client.execute("(robot_at kitchen)", LONG)
        self.drives.hold()
        with self.assertRaises(MissionFailed) as caught:
            mission.achieve("(checked dorm_room)", timeout=0.2)
        self.assertIn("cancelled", str(caught.exception))

    def test_a_mission_as_a_machine(self):
        shown = []
        topic = "mission_evening/smach/container_structure"
        viewer = rospy.Subscriber(
            topic, SmachContainerStructure, lambda message: self.note(shown, message.path)
        )
        self.addCleanup(viewer.unregister)
        mission = self.followed(Evening())
        thread, outcomes = self.driving(mission, mission.run)
        self.wait(lambda: "/MISSION_EVENING" in shown)
        self.drives.end()
        thread.join(LONG)
        self.assertEqual(outcomes, ["succeeded"])
        self.assertTrue(self.knowledge.holds("(and (checked kitchen) (checked main_door))"))
        self.wait(lambda: any(entry[:2] == ("Evening", MissionStatus.SUCCEEDED) for entry in self.missions))

    def test_a_machine_that_is_held_before_a_state_is_preempted(self):
        mission = Evening()
        outcomes, said = [], []
        holds = rospy.Subscriber(
            "merlin/machine_holds", MachineHolds, lambda message: self.note(said, message)
        )
        node_holds.offer()
        states = MachineNodes()
        self.addCleanup(states.release, BreakpointsRequest.CLEAR)
        states.set(["MISSION_EVENING/KITCHEN"])
        thread = threading.Thread(target=lambda: outcomes.append(mission.run()))
        thread.start()
        self.wait(lambda: said and said[-1].held == ["MISSION_EVENING/KITCHEN"])
        self.assertFalse(self.running)
        mission.request_preempt()
        thread.join(LONG)
        self.assertEqual(outcomes, ["preempted"])
        self.wait(lambda: said[-1].held == [])
        holds.unregister()

    def test_outcomes_are_forced_and_wait_for_an_operator(self):
        mission = Evening()
        said, left = [], []
        for topic, kind, seen in (
            ("merlin/machine_holds", MachineHolds, said),
            ("merlin/state_outcomes", StateOutcome, left),
        ):
            follower = rospy.Subscriber(topic, kind, lambda message, seen=seen: self.note(seen, message))
            self.addCleanup(follower.unregister)
        node_holds.offer()
        console = rospy.Publisher(CONSOLES_TOPIC, String, queue_size=1)
        follows = rospy.Timer(rospy.Duration(1.0), lambda _: console.publish(rospy.get_name()))
        self.addCleanup(follows.shutdown)
        states = MachineNodes()
        self.addCleanup(states.set_autonomy, "full")
        states.set_autonomy("low")
        self.wait(lambda: said and said[-1].autonomy == "low")
        wait_for_publishers(follower)
        thread, outcomes = self.driving(mission, mission.run)
        with self.assertRaisesRegex(BreakpointError, "has no outcome 'done'"):
            states.leave("MISSION_EVENING/KITCHEN", "done", "Ana")
        with self.assertRaisesRegex(BreakpointError, "no machine has a state MISSION_EVENING/HALL"):
            states.leave("MISSION_EVENING/HALL", "succeeded", "Ana")
        self.assertIn("is preempted", states.leave("MISSION_EVENING/KITCHEN", "succeeded", "Ana"))
        self.wait(lambda: said[-1].confirm == ["MISSION_EVENING/DOOR"])
        self.assertEqual(said[-1].confirm_outcomes, ["succeeded"])
        self.assertFalse(self.knowledge.holds("(checked kitchen)"))  # its goal was cancelled
        self.assertTrue(self.knowledge.holds("(checked main_door)"))
        self.assertEqual(outcomes, [])
        states.leave("MISSION_EVENING/DOOR", "", "Ben")
        thread.join(LONG)
        self.assertEqual(outcomes, ["succeeded"])
        self.wait(lambda: len(left) == 2 and said[-1].confirm == [])
        self.assertEqual(
            [(each.state, each.operator, each.outcome, each.ended) for each in left],
            [
                ("MISSION_EVENING/KITCHEN", "Ana", "succeeded", "preempted"),
                ("MISSION_EVENING/DOOR", "Ben", "succeeded", "succeeded"),
            ],
        )

    def note(self, said, message):
        with self.changed:
            said.append(message)
            self.changed.notify_all()

    def test_a_preempted_machine_stops_the_robot(self):
        mission = Evening()
        thread, outcomes = self.driving(mission, mission.run)
        mission.request_preempt()
        thread.join(LONG)
        self.assertEqual(outcomes, ["preempted"])
        self.wait(lambda: not self.running)
