# SPDX-License-Identifier: Apache-2.0
"""merlin_sm's transport over real connections: actions, services, and servers that die."""

import os
import signal
import threading
import time
import unittest
from unittest import mock

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from merlin_msgs.msg import Lease, SimStatus
from rosplan_dispatch_msgs.msg import NonBlockingDispatchAction as Action
from rosplan_dispatch_msgs.msg import NonBlockingDispatchGoal as Goal
from rosplan_dispatch_msgs.msg import NonBlockingDispatchResult as Result
from transport_victim import start_victim

from merlin_ros import deadline
from merlin_ros.actions import action_client, hang_watch, lease_watch, server_silence
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.action_server import ActionServer
from merlin_ros.actions.lease import LOSE_AFTER, LeaseState
from merlin_ros.actions.ownership import ownership
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_ros.actions.server_silence import SILENCE
from merlin_test import LONG
from merlin_test.knowledge_fixture import Received
from merlin_test.process_signals import hang


class Deadlines(unittest.TestCase):
    @mock.patch.object(deadline, "simulated", return_value=True)
    def test_a_deadline_begins_where_the_simulator_was_heard_before(self, _):
        received = threading.Event()
        publisher = rospy.Publisher(deadline.SIM_STATUS_TOPIC, SimStatus, latch=True, queue_size=1)
        self.addCleanup(publisher.unregister)
        publisher.publish(SimStatus())
        earlier = rospy.Subscriber(deadline.SIM_STATUS_TOPIC, SimStatus, lambda _: received.set())
        self.addCleanup(earlier.unregister)
        self.assertTrue(received.wait(LONG))
        watch = deadline.PauseWatch()  # that of the process has begun long ago
        read = threading.Thread(target=watch.paused_time, daemon=True)
        read.start()
        read.join(LONG)
        self.assertFalse(read.is_alive())


class Actions(unittest.TestCase):
    def serve(self, name, execute, on_cancel=None):
        server = SerialActionServer(name, Action, execute, on_cancel)
        server.start()
        self.addCleanup(server.shutdown)
        client = ActionClient(name, Action)
        self.addCleanup(client.shutdown)
        self.assertTrue(client.wait_for_server(LONG))
        return client

    def test_a_very_fast_result_is_not_missed(self):
        client = self.serve("fast", lambda goal: goal.succeed(Result(success=True), "done"))
        for _ in range(200):
            sent = client.send(Goal())
            self.assertTrue(sent.wait(LONG))
            self.assertEqual((sent.status, sent.text), (GoalStatus.SUCCEEDED, "done"))
            self.assertTrue(sent.result.success)

    def test_no_time_to_wait_is_one_look(self):
        client = ActionClient("never_there", Action)
        self.addCleanup(client.shutdown)
        self.assertFalse(client.wait_for_server(0.0))
        self.assertFalse(client.send(Goal()).wait(0.0))

    @mock.patch.object(action_client, "SPEAKING", LONG)
    @mock.patch.object(action_client, "CONNECTING", LONG)
    def test_a_server_that_speaks_is_waited_for_beyond_the_time_out(self):
        """Its link for results comes late, as when rospy had to try a connection again."""
        parts = Action()
        subscribers = [
            rospy.Subscriber("late/goal", type(parts.action_goal)),
            rospy.Subscriber("late/cancel", GoalID),
        ]
        status = rospy.Publisher("late/status", GoalStatusArray, latch=True, queue_size=1)
        feedback = rospy.Publisher("late/feedback", type(parts.action_feedback), queue_size=1)
        client = ActionClient("late", Action)
        self.addCleanup(client.shutdown)
        for part in (*subscribers, status, feedback):
            self.addCleanup(part.unregister)
        looks = []

        def speak():
            status.publish(GoalStatusArray())
            looks.append(client.missing)
            return False

        while not client.heard:
            status.publish(GoalStatusArray())
            rospy.rostime.wallsleep(0.01)
        timeout = 0.5
        found = []
        wait = threading.Thread(target=lambda: found.append(client.wait_for_server(timeout, speak)))
        begun = time.monotonic()
        wait.start()
        while time.monotonic() - begun < 2.0 * timeout or "it speaks" not in "".join(looks[-1:]):
            wait.join(0.05)
            self.assertEqual(found, [])
        result = rospy.Publisher("late/result", type(parts.action_result), queue_size=1)
        self.addCleanup(result.unregister)
        wait.join(LONG)
        self.assertEqual(found, [True])

    def test_a_cancel_in_the_same_instant_as_its_goal_is_not_lost(self):
        def execute(goal):
            goal.cancel_event.wait(LONG)
            goal.cancelled()

        client = self.serve("instant", execute)
        for _ in range(100):
            sent = client.send(Goal())
            sent.cancel()
            self.assertTrue(sent.wait(LONG))
            self.assertIn(sent.status, (GoalStatus.PREEMPTED, GoalStatus.RECALLED))

    def test_a_cancel_that_overtakes_its_goal_recalls_it(self):
        begun = []
        server = ActionServer(
            "overtaken",
            Action,
            begun.append,
            lambda goal: None,
            own_result=lambda status: Result(success=status.status == GoalStatus.RECALLED),
        )
        server.start()
        self.addCleanup(server.shutdown)
        client = ActionClient("overtaken", Action)
        self.addCleanup(client.shutdown)
        self.assertTrue(client.wait_for_server(LONG))
        results = Received("overtaken/result", type(Action().action_result))
        self.addCleanup(results.close)
        cancels = Received("overtaken/cancel", GoalID)  # behind the server, which hears it over the same link
        self.addCleanup(cancels.close)
        goal = type(Action().action_goal)(goal_id=GoalID(id="early"))
        for topic, message in (("cancel", goal.goal_id), ("goal", goal)):
            publisher = rospy.Publisher(f"overtaken/{topic}", type(message), queue_size=1)
            self.addCleanup(publisher.unregister)
            publisher.publish(message)
            cancels.wait(lambda cancel: cancel.id == "early")
        # An observer reads the result alone, of which an empty one may say that all went well.
        self.assertTrue(results.wait(lambda ended: ended.status.goal_id.id == "early").result.success)
        self.assertEqual(begun, [])

    def test_a_newer_goal_preempts_the_older_at_once(self):
        begun, stopped, reported = [], [], threading.Event()

        def execute(goal):
            begun.append(goal.id)
            if len(begun) == 1:
                # Not for the event alone: the callback follows it, and is left out for a goal that has ended.
                self.assertTrue(goal.cancel_event.wait(LONG) and reported.wait(LONG))
                goal.cancelled()
            else:
                goal.succeed()

        def stop(goal):
            stopped.append(goal.id)
            reported.set()

        client = self.serve("newer", execute, stop)
        first = client.send(Goal())
        while first.status != GoalStatus.ACTIVE:
            self.assertFalse(first.wait(0.01))
        second = client.send(Goal())
        self.assertTrue(first.wait(LONG) and second.wait(LONG))
        self.assertEqual((first.status, second.status), (GoalStatus.PREEMPTED, GoalStatus.SUCCEEDED))
        self.assertEqual(stopped, [first.id])

    def test_an_exception_in_the_server_ends_the_goal_aborted(self):
        def execute(goal):
            raise RuntimeError("broken on purpose")

        client = self.serve("broken", execute)
        sent = client.send(Goal())
        self.assertTrue(sent.wait(LONG))
        self.assertEqual(sent.status, GoalStatus.ABORTED)
        self.assertIn("broken on purpose", sent.text)

    def test_whatever_a_server_raises_its_client_gets_an_answer(self):
        for error in (SystemExit(3), RecursionError("too deep"), MemoryError()):

            def fail(goal, error=error):
                raise error

            name = f"raises_{type(error).__name__}"
            client = self.serve(name, fail)
            server = ActionServer(f"{name}_at_once", Action, fail, fail)
            server.start()
            self.addCleanup(server.shutdown)
            at_once = ActionClient(f"{name}_at_once", Action)
            self.addCleanup(at_once.shutdown)
            self.assertTrue(at_once.wait_for_server(LONG))
            for each in (client, at_once):
                for _ in range(2):  # and the server goes on
                    sent = each.send(Goal())
                    self.assertTrue(sent.wait(LONG))
                    self.assertEqual(sent.status, GoalStatus.ABORTED)
                    self.assertIn(type(error).__name__, sent.text)

    def wait_for_the_victim(self):
        """A client, and a goal that the victim works on."""
        client = ActionClient("victim/wait", Action)
        self.addCleanup(client.shutdown)
        self.assertTrue(client.wait_for_server(LONG))
        sent = client.send(Goal())
        while sent.status != GoalStatus.ACTIVE:
            self.assertFalse(sent.wait(0.01))
        return client, sent

    def test_a_killed_server_ends_its_goals_as_lost(self):
        victim = start_victim()
        _, sent = self.wait_for_the_victim()
        os.kill(victim.pid, signal.SIGKILL)
        victim.wait()
        self.assertTrue(sent.wait(LONG))
        self.assertEqual(sent.status, GoalStatus.LOST)
        self.assertIn("/victim/wait is gone", sent.text)

    @mock.patch.object(server_silence, "CONNECTED_SILENCE", LONG)  # the test may be without one, too
    @mock.patch.object(action_client, "CONNECTED_SILENCE", LONG)
    def test_a_server_without_a_processor_for_a_while_is_not_given_up(self):
        victim = start_victim()
        self.addCleanup(victim.wait)
        self.addCleanup(victim.kill)
        client, sent = self.wait_for_the_victim()
        hang(victim.pid)
        self.assertFalse(sent.wait(SILENCE + 1.5), sent.text)
        self.assertTrue(client.alive)
        victim.send_signal(signal.SIGCONT)
        sent.cancel()
        self.assertTrue(sent.wait(LONG))
        self.assertEqual(sent.status, GoalStatus.PREEMPTED)


class Owners(unittest.TestCase):
    """A server whose client dies, hangs, comes back, or forgets."""

    def setUp(self):
        self.changed = threading.Condition()
        self.seen = []  # (goal, state)
        self.goals = []
        self.stopped, self.was_suspended = [], False
        self.held = set()  # ids of goals that a lease has named

    def serve_owned(self, note=None, lose_after=LOSE_AFTER, name="owned"):
        """:param lose_after: LONG for a test whose client must not be lost: a machine may be busy."""
        server = ActionServer(
            name, Action, self.begin, self.stop, note or self.note, lose_owner_after=lose_after
        )
        server.start()
        self.addCleanup(server.shutdown)
        # Behind the server, which hears a lease over the same link.
        leases = rospy.Subscriber(f"{name}/lease", Lease, self.note_lease)
        self.addCleanup(leases.unregister)
        ownership.listen(self.note_ownership)  # it changes behind what the server is asked and told
        self.addCleanup(ownership.ignore, self.note_ownership)

    def note_ownership(self):
        with self.changed:
            self.was_suspended |= ownership.suspended()
            self.changed.notify_all()

    def note_lease(self, lease):
        with self.changed:
            self.held.update(lease.held)
            self.changed.notify_all()

    def begin(self, goal):
        goal.accept()
        with self.changed:
            self.goals.append(goal)
            self.changed.notify_all()

    def stop(self, goal):
        with self.changed:
            self.stopped.append(goal)
            self.changed.notify_all()
        goal.cancelled(text=goal.cancel_reason)

    def note(self, goal, state, reason):
        with self.changed:
            self.seen.append(state)
            self.changed.notify_all()

    def wait_for(self, predicate):
        with self.changed:
            self.assertTrue(self.changed.wait_for(predicate, LONG), self.seen)

    def start_client(self, *arguments):
        client = start_victim("victim_client", *arguments)
        self.addCleanup(client.wait)
        self.addCleanup(client.kill)
        return client

    def owned_goal(self, lose_after=LOSE_AFTER):
        """A client, when its goal is held."""
        self.serve_owned(lose_after=lose_after)
        client = self.start_client()
        self.wait_for(lambda: self.goals and self.goals[0].id in self.held)
        return client

    def test_the_goal_of_a_killed_client_is_cancelled(self):
        self.owned_goal().kill()
        self.wait_for(lambda: self.stopped)
        self.assertIn("its client /victim_client is gone", self.goals[0].cancel_reason)
        self.wait_for(lambda: not ownership.suspended())

    def test_the_goal_of_a_client_that_hangs_is_suspended_and_then_cancelled(self):
        client = self.owned_goal()
        hang(client.pid)
        self.wait_for(lambda: self.was_suspended)
        self.assertIn(LeaseState.SUSPENDED, self.seen)
        self.wait_for(lambda: self.stopped)
        self.assertIn("has been silent", self.goals[0].cancel_reason)

    def test_a_client_that_hangs_for_a_moment_loses_nothing(self):
        client = self.owned_goal(lose_after=LONG)
        hang(client.pid)
        self.wait_for(lambda: LeaseState.SUSPENDED in self.seen)
        client.send_signal(signal.SIGCONT)
        self.wait_for(lambda: self.seen[-1] is LeaseState.HELD and not ownership.suspended())
        self.assertEqual(self.stopped, [])

    def test_a_restarted_client_cancels_the_goals_of_its_former_life(self):
        self.serve_owned(lambda *_: False)  # what is made of leases is left to its owner, which does nothing
        client = self.start_client()
        self.wait_for(lambda: self.goals)
        client.kill()
        client.wait()
        self.start_client("--idle")
        self.wait_for(lambda: self.stopped)
        self.assertIs(self.stopped[0], self.goals[0])

    def test_a_goal_that_is_given_up_is_cancelled(self):
        self.serve_owned()
        client = ActionClient("owned", Action)
        self.assertTrue(client.wait_for_server(LONG))
        client.send(Goal())
        self.wait_for(lambda: self.goals)
        client.shutdown()
        self.wait_for(lambda: self.stopped)

    def test_two_clients_of_one_process_do_not_release_each_others_goals(self):
        self.serve_owned(lose_after=LONG)
        clients = [ActionClient("owned", Action) for _ in range(2)]
        for client in clients:
            self.addCleanup(client.shutdown)
            self.assertTrue(client.wait_for_server(LONG))
        sent = [client.send(Goal()) for client in clients]
        self.wait_for(lambda: len(self.goals) == 2 and self.held.issuperset(goal.id for goal in sent))
        sent[0].cancel()
        self.assertTrue(sent[0].wait(LONG))
        self.assertFalse(sent[1].wait(1.0), "the other client's goal is not wanted any more")
        self.assertEqual(len(self.stopped), 1)

    @mock.patch.object(hang_watch, "HUNG", LONG)  # a hang of this process suspends all that it has sent
    def test_a_suspension_travels_down_the_chain(self):
        self.below = []
        # The client below is this process, which may be without a processor.
        with mock.patch.object(lease_watch, "LIMITS", lease_watch.LIMITS._replace(silent=LONG)):
            self.serve_owned(self.note_below, LONG, "below")
        onward = ActionClient("below", Action)
        self.addCleanup(onward.shutdown)
        self.assertTrue(onward.wait_for_server(LONG))
        client = self.owned_goal(LONG)
        sent = [onward.send(Goal(), owner=owner) for owner in (self.goals[0].id, "another goal")]
        self.wait_for(lambda: self.held.issuperset(goal.id for goal in sent))
        hang(client.pid)
        self.wait_for(lambda: (sent[0].id, LeaseState.SUSPENDED) in self.below)
        client.send_signal(signal.SIGCONT)
        # More than once where the client has no processor for a while.
        self.wait_for(lambda: self.below[-1] == (sent[0].id, LeaseState.HELD))
        self.assertEqual({goal for goal, _ in self.below}, {sent[0].id})

    def note_below(self, goal, state, reason):
        with self.changed:
            self.below.append((goal.id, state))
            self.changed.notify_all()
