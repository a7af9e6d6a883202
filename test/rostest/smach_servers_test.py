#!/usr/bin/env python3
"""Containers offered to others: introspection (I1 to I4, B12), the action server wrapper (P13, U6, D11)."""

import base64
import pickle
import threading
import unittest

import actionlib
import rosgraph
import rospy
from actionlib.msg import TestAction, TestFeedback, TestGoal, TestResult
from actionlib_msgs.msg import GoalStatus
from smach_msgs.msg import (
    SmachContainerInitialStatusCmd,
    SmachContainerStatus,
    SmachContainerStructure,
)

import rostest
import smach
from smach_ros import ActionServerWrapper, IntrospectionClient, IntrospectionServer, introspection
from smach_ros.userdata_codec import encode

LONG = 30.0


class Done(smach.State):
    def __init__(self, **keys):
        smach.State.__init__(self, outcomes=["done"], **keys)

    def execute(self, ud):
        return "done"


class Calling(smach.State):
    def __init__(self, call, outcomes=("done", "preempted"), **keys):
        smach.State.__init__(self, outcomes=list(outcomes), **keys)
        self.call = call

    def execute(self, ud):
        return self.call(self, ud)


def machine(*states, outcomes=("done", "preempted"), **keys):
    sm = smach.StateMachine(list(outcomes), **keys)
    with sm:
        for i, state in enumerate(states):
            target = "done" if i == len(states) - 1 else f"S{i + 1}"
            smach.StateMachine.add(f"S{i}", state, {"done": target})
    return sm


class Viewer:
    """Collects what a server publishes."""

    def __init__(self, name):
        self.structures, self.statuses = [], []
        self.changed = threading.Condition()
        self.subscribers = [
            rospy.Subscriber(name + topic, kind, self.receive, into)
            for topic, kind, into in (
                (introspection.STRUCTURE_TOPIC, SmachContainerStructure, self.structures),
                (introspection.STATUS_TOPIC, SmachContainerStatus, self.statuses),
            )
        ]

    def receive(self, message, into):
        with self.changed:
            into.append(message)
            self.changed.notify_all()

    def wait(self, predicate):
        with self.changed:
            assert self.changed.wait_for(predicate, LONG), [m.info for m in self.statuses]

    def close(self):
        for subscriber in self.subscribers:
            subscriber.unregister()


def values(status):
    """Userdata of a status, read as smach_viewer does."""
    return pickle.loads(base64.b64decode(status.local_data))


class Introspection:
    number = 0

    def setUp(self):
        heartbeat = introspection.HEARTBEAT
        introspection.HEARTBEAT = 3600.0  # what comes at once must not come by it
        self.addCleanup(setattr, introspection, "HEARTBEAT", heartbeat)

    def serve(self, state, path="/SM_ROOT"):
        Introspection.number += 1
        name = f"server{self.number}"
        server = IntrospectionServer(name, state, path)
        server.start()
        self.addCleanup(server.stop)
        return name, server

    def view(self, name, containers):
        viewer = Viewer(name)
        self.addCleanup(viewer.close)
        viewer.wait(lambda: len(viewer.statuses) >= containers and len(viewer.structures) >= containers)
        return viewer

    def test_i4_late_viewer_sees_all_containers_at_once(self):
        inner, both = (
            machine(Done()),
            smach.Concurrence(["done"], "done", outcome_map={"done": {"A": "done"}}),
        )
        with both:
            smach.Concurrence.add("A", Done())
            smach.Concurrence.add("B", machine(Done()))
        name, _ = self.serve(machine(inner, both, Done()))
        paths = ["/SM_ROOT", "/SM_ROOT/S0", "/SM_ROOT/S1", "/SM_ROOT/S1/B"]
        for _ in range(2):
            viewer = self.view(name, len(paths))
            self.assertEqual(sorted(m.path for m in viewer.structures), paths)
            self.assertEqual(sorted(m.path for m in viewer.statuses), paths)
            self.assertEqual({m.info for m in viewer.statuses}, {"Initial state"})
            viewer.close()  # two subscribers of a process would share a connection
        found = {m.path: m for m in viewer.structures}
        root = found["/SM_ROOT"]
        self.assertEqual(root.children, ["S0", "S1", "S2"])
        edges = list(zip(root.internal_outcomes, root.outcomes_from, root.outcomes_to))
        self.assertEqual(
            edges,
            [
                ("done", "S0", "S1"),
                ("preempted", "S0", "None"),
                ("done", "S1", "S2"),
                ("done", "S2", "done"),
            ],
        )
        self.assertEqual(root.container_outcomes, ["done", "preempted"])
        self.assertEqual(found["/SM_ROOT/S1"].outcomes_to, ["done"])
        states = {m.path: m for m in viewer.statuses}
        self.assertEqual(states["/SM_ROOT"].initial_states, ["S0"])
        self.assertEqual(states["/SM_ROOT"].active_states, ["None"])
        self.assertEqual(states["/SM_ROOT/S1"].active_states, [])
        self.assertEqual(states["/SM_ROOT"].local_data, "gAJ9cQAu")

    def test_i4_start_transitions_and_termination_are_all_shown(self):
        inner = machine(*[Done() for _ in range(10)])
        sm = machine(Done(), inner, Done())
        name, _ = self.serve(sm, "/")
        viewer = self.view(name, 2)
        del viewer.statuses[:]
        sm.execute()
        viewer.wait(lambda: len(viewer.statuses) >= 4 + 11)
        shown = {}
        for status in viewer.statuses:
            shown.setdefault(status.path, []).append(status.active_states)
        self.assertEqual(shown["/"], [["S0"], ["S1"], ["S2"], ["None"]])
        self.assertEqual(shown["/S1"], [[f"S{i}"] for i in range(10)] + [["None"]])

    def test_heartbeats_repeat_structure_and_status(self):
        introspection.HEARTBEAT = 0.1
        name, _ = self.serve(machine(Done()))
        viewer = self.view(name, 1)
        viewer.wait(lambda: [m.info for m in viewer.statuses].count("HEARTBEAT") >= 2)
        viewer.wait(lambda: len(viewer.structures) >= 3)

    def test_i1_value_that_cannot_be_pickled_hides_nothing(self):
        sm = machine(Done(), Done())
        sm.userdata.lock, sm.userdata.number, sm.userdata.goal = threading.Lock(), 5, TestGoal(goal=3)
        sm.userdata.own = Done()
        name, _ = self.serve(sm)
        viewer = self.view(name, 1)
        sm.execute()
        viewer.wait(lambda: viewer.statuses[-1].info.startswith("TERMINATED"))
        seen = values(viewer.statuses[-1])
        self.assertEqual((seen["number"], seen["goal"]), (5, TestGoal(goal=3)))
        self.assertIn("lock", seen["lock"])
        self.assertIn("Done", seen["own"])

    def test_i2_costly_userdata_is_encoded_seldom_and_never_by_the_machine(self):
        calls = []

        class Costly:
            def __reduce__(self):
                return str, ("",)

            def __repr__(self):
                calls.append(threading.current_thread().name)
                threading.Event().wait(0.02)
                return "costly"

        sm = machine(*[Done() for _ in range(100)])
        name, _ = self.serve(sm)
        viewer = self.view(name, 1)
        sm.userdata.x = Costly()
        sm.execute()
        viewer.wait(lambda: viewer.statuses[-1].info.startswith("TERMINATED"))
        self.assertEqual(len(viewer.statuses), 1 + 101)
        self.assertLess(len(calls), 50)
        self.assertNotIn(threading.current_thread().name, calls)

    def test_i3_init_command_runs_no_code_and_changes_nothing(self):
        class Evil:
            def __reduce__(self):
                return rospy.set_param, ("/owned", True)

        sm = machine(Done(), Done())
        name, _ = self.serve(sm)
        command = SmachContainerInitialStatusCmd(path="/SM_ROOT", initial_states=["S1"])
        publisher = rospy.Publisher(name + introspection.INIT_TOPIC, type(command), latch=True, queue_size=1)
        self.addCleanup(publisher.unregister)
        command.local_data = base64.b64encode(pickle.dumps({"x": Evil()}, 2)).decode()
        publisher.publish(command)
        # The next command is read after this one.
        client = IntrospectionClient()
        self.assertTrue(client.set_initial_state(name, "/SM_ROOT", ["S0"], timeout=rospy.Duration(LONG)))
        self.assertFalse(rospy.has_param("/owned"))
        self.assertNotIn("x", sm.userdata)

    def test_init_command_sets_state_and_userdata(self):
        both = smach.Concurrence(["done"], "done")
        with both:
            smach.Concurrence.add("A", Done())
        sm = machine(Done(), both)
        name, _ = self.serve(sm)
        viewer = self.view(name, 2)
        client = IntrospectionClient()
        self.assertIn("/" + name, client.get_servers())
        userdata = smach.UserData()
        userdata.goal, userdata.words = TestGoal(goal=4), ["a", {"b": (1, 2.5, None)}]
        set_initial_state = client.set_initial_state
        self.assertTrue(set_initial_state(name, "/SM_ROOT", ["S1"], userdata, timeout=rospy.Duration(LONG)))
        self.assertEqual((sm.userdata.goal, sm.userdata.words), (userdata.goal, userdata.words))
        self.assertEqual(sm.get_initial_states(), ["S1"])
        viewer.wait(lambda: any(m.info == "REMOTE_INIT" for m in viewer.statuses))
        # D9: this raised TypeError.
        self.assertTrue(set_initial_state(name, "/SM_ROOT/S1", ["A"], userdata, timeout=LONG))
        self.assertEqual(both.userdata.goal, userdata.goal)
        self.assertFalse(set_initial_state(name, "/SM_ROOT", ["NOWHERE"], timeout=rospy.Duration(0.5)))
        self.assertFalse(set_initial_state(name, "/NOWHERE", ["A"], timeout=0.5))
        self.assertEqual(sm.get_initial_states(), ["S1"])

    def test_b12_server_has_one_thread_and_stop_ends_all_it_began(self):
        sm = machine(*[machine(Done()) for _ in range(5)])
        threads = {thread.name for thread in threading.enumerate()}
        name, server = self.serve(sm)
        server.start()
        own = [t.name for t in threading.enumerate() if t.name.startswith("smach")]
        self.assertEqual(len([n for n in own if n not in threads]), 1)
        self.assertEqual(len(sm._transition_cbs), 1)
        self.view(name, 6).close()
        server.stop()
        server.stop()
        self.assertEqual((sm._start_cbs, sm._transition_cbs, sm._termination_cbs), ([], [], []))
        self.assertEqual(
            {t.name for t in threading.enumerate() if t.name == f"smach introspection {name}"}, set()
        )
        publishers, subscribers, _ = rosgraph.Master("/test").getSystemState()
        left = [
            topic for topic, nodes in publishers + subscribers if name in topic and rospy.get_name() in nodes
        ]
        self.assertEqual(left, [])
        server.clear()
        server.start()
        self.view(name, 6)


class Wrapper:
    def wrap(self, state, **how):
        Introspection.number += 1
        name = f"wrapped{Introspection.number}"
        container = machine(
            state,
            input_keys=["action_goal", "goal", "number"],
            output_keys=["action_result", "result", "answer"],
            outcomes=["done", "preempted", "failed"],
        )
        wrapper = ActionServerWrapper(name, TestAction, container, ["done"], ["failed"], ["preempted"], **how)
        wrapper.run_server()
        self.addCleanup(wrapper._action_server.stop)
        client = actionlib.SimpleActionClient(name, TestAction)
        self.assertTrue(client.wait_for_server(rospy.Duration(LONG)))
        return client, container, wrapper

    def run_goal(self, client, goal=0):
        client.send_goal(TestGoal(goal=goal))
        self.assertTrue(client.wait_for_result(rospy.Duration(LONG)))
        return client.get_state(), client.get_result().result

    def test_goal_result_and_outcomes(self):
        def work(state, ud):
            if ud.action_goal.goal == 2:
                return "failed"
            if ud.action_goal.goal == 3:
                raise ValueError("broken")
            ud.action_result = TestResult(result=ud.action_goal.goal + 10)
            return "done"

        keys = {"input_keys": ["action_goal"], "output_keys": ["action_result"]}
        client, _, _ = self.wrap(Calling(work, ["done", "failed", "preempted"], **keys))
        self.assertEqual(self.run_goal(client, 1), (GoalStatus.SUCCEEDED, 11))
        self.assertEqual(
            self.run_goal(client, 2), (GoalStatus.ABORTED, 0), "U6: not the result of the goal before"
        )
        self.assertEqual(self.run_goal(client, 3), (GoalStatus.ABORTED, 0))
        self.assertEqual(self.run_goal(client, 4), (GoalStatus.SUCCEEDED, 14))

    def test_slots(self):
        def work(state, ud):
            ud.answer = ud.goal + ud.number
            return "done"

        keys = {"input_keys": ["goal", "number"], "output_keys": ["answer"]}
        client, _, wrapper = self.wrap(
            Calling(work, **keys),
            expand_goal_slots=True,
            goal_slots_map={"goal": "number"},
            result_slots_map={"result": "answer"},
        )
        wrapper.userdata.preset = 1
        self.assertEqual(self.run_goal(client, 4), (GoalStatus.SUCCEEDED, 8))
        self.assertEqual(wrapper.userdata.preset, 1)

    def test_pack_result_slots(self):
        def work(state, ud):
            ud.result = 6
            return "done"

        client, _, _ = self.wrap(Calling(work, output_keys=["result"]), pack_result_slots=True)
        self.assertEqual(self.run_goal(client), (GoalStatus.SUCCEEDED, 6))

    def test_d11_feedback_slots_map_and_feedback_key(self):
        name = f"feedback{Introspection.number}"
        progress = Calling(
            lambda state, ud: setattr(ud, "progress", 5) or "done", ["done"], output_keys=["progress"]
        )
        whole = Calling(
            lambda state, ud: setattr(ud, "action_feedback", TestFeedback(feedback=6)) or "done",
            ["done"],
            output_keys=["action_feedback"],
        )
        for state, how, expected in (
            (progress, {"feedback_slots_map": {"feedback": "progress"}}, 5),
            (whole, {}, 6),
        ):
            seen, came = [], threading.Event()
            # Feedback travels beside the result; a client drops what comes behind it.
            last = Calling(lambda state, ud, c=came: "done" if c.wait(LONG) else "late", ["done"])
            container = machine(state, last, outcomes=["done"])
            wrapper = ActionServerWrapper(f"{name}_{expected}", TestAction, container, ["done"], **how)
            wrapper.run_server()
            self.addCleanup(wrapper._action_server.stop)
            client = actionlib.SimpleActionClient(f"{name}_{expected}", TestAction)
            self.assertTrue(client.wait_for_server(rospy.Duration(LONG)))
            while not wrapper._action_server.feedback_pub.get_num_connections():
                rospy.rostime.wallsleep(0.01)
            client.send_goal(
                TestGoal(), feedback_cb=lambda m, s=seen, c=came: s.append(m.feedback) or c.set()
            )
            self.assertTrue(client.wait_for_result(rospy.Duration(LONG)))
            self.assertEqual(seen, [expected])

    def waiting(self):
        class Waiting(smach.State):
            def __init__(self):
                smach.State.__init__(self, ["done", "preempted"], input_keys=["action_goal"])
                self.started, self.asked = threading.Semaphore(0), threading.Event()

            def request_preempt(self):
                smach.State.request_preempt(self)
                self.asked.set()

            def execute(self, ud):
                if ud.action_goal.goal == 0:
                    return "done"
                self.asked.clear()
                self.started.release()
                if not self.preempt_requested():
                    assert self.asked.wait(LONG)
                self.service_preempt()
                return "preempted"

        return Waiting()

    def test_cancel_and_newer_goal_preempt(self):
        state = self.waiting()
        client, _, _ = self.wrap(state)
        client.send_goal(TestGoal(goal=1))
        self.assertTrue(state.started.acquire(timeout=LONG))
        client.cancel_goal()
        self.assertTrue(client.wait_for_result(rospy.Duration(LONG)))
        self.assertEqual(client.get_state(), GoalStatus.PREEMPTED)
        raw = actionlib.ActionClient(client.action_client.ns, TestAction)
        self.assertTrue(raw.wait_for_server(rospy.Duration(LONG)))
        ended = threading.Semaphore(0)

        def moved(goal):
            if goal.get_comm_state() == actionlib.CommState.DONE:
                ended.release()

        first = raw.send_goal(TestGoal(goal=1), moved)
        self.assertTrue(state.started.acquire(timeout=LONG))
        second = raw.send_goal(TestGoal(goal=0), moved)
        for _ in range(2):
            self.assertTrue(ended.acquire(timeout=LONG))
        self.assertEqual(first.get_terminal_state(), GoalStatus.PREEMPTED)
        self.assertEqual(second.get_terminal_state(), GoalStatus.SUCCEEDED)

    def test_p13_cancel_that_comes_as_the_container_ends_is_not_for_the_next_goal(self):
        state = self.waiting()
        client, container, wrapper = self.wrap(state)
        ends, cancelled = threading.Event(), threading.Event()
        receive = wrapper._action_server.cancel_callback

        def receive_cancel(goal):
            receive(goal)
            cancelled.set()

        wrapper._action_server.register_cancel_callback(receive_cancel)

        def terminated(*args):
            ends.set()
            assert cancelled.wait(LONG)

        container.register_termination_cb(terminated)
        client.send_goal(TestGoal(goal=0))
        self.assertTrue(ends.wait(LONG))
        client.cancel_goal()
        self.assertTrue(client.wait_for_result(rospy.Duration(LONG)))
        self.assertEqual(client.get_state(), GoalStatus.SUCCEEDED)
        self.assertEqual(self.run_goal(client, 0)[0], GoalStatus.SUCCEEDED)
        client.send_goal(TestGoal(goal=1))
        self.assertTrue(state.started.acquire(timeout=LONG))
        self.assertTrue(container.is_running(), "preempted by a cancel of another goal")
        client.cancel_goal()
        self.assertTrue(client.wait_for_result(rospy.Duration(LONG)))

    def test_broken_definitions_raise(self):
        container = machine(Done())
        for how in (
            {"succeeded_outcomes": ["unheard"]},
            {"succeeded_outcomes": ["done"], "aborted_outcomes": ["done"]},
        ):
            with self.assertRaises(smach.InvalidStateError):
                ActionServerWrapper("never", TestAction, container, **how)
        with self.assertRaises(smach.InvalidConstructionError):
            ActionServerWrapper("never", TestAction, container, ["done"], goal_slots_map={"speed": "x"})


class Servers(Introspection, Wrapper, unittest.TestCase):
    def test_empty_userdata_has_the_known_encoding(self):
        self.assertEqual(encode({}), "gAJ9cQAu")


if __name__ == "__main__":
    rospy.init_node("smach_servers_test")
    rostest.rosrun("merlin_test", "smach_servers", Servers)
