# SPDX-License-Identifier: Apache-2.0
"""Containers shown to viewers: I1 to I4 and B12."""

import base64
import pickle
import threading
import unittest

import rosgraph
import rospy
from actionlib.msg import TestGoal
from smach_fixture import Done, machine
from smach_msgs.msg import (
    SmachContainerInitialStatusCmd,
    SmachContainerStatus,
    SmachContainerStructure,
)

import smach
from merlin_test import LONG
from merlin_test.topic_links import wait_for_connections
from smach_ros import IntrospectionClient, IntrospectionServer, introspection
from smach_ros.userdata_codec import encode


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


class Introspection(unittest.TestCase):
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

    def view(self, name, containers, kind=Viewer):
        viewer = kind(name)
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

    def test_the_end_is_shown_also_when_the_server_stops_at_once(self):
        sm = machine(Done())
        name, server = self.serve(sm, "/")
        viewer = self.view(name, 1)
        sm.execute()
        server.stop()
        viewer.wait(lambda: any(status.info.startswith("TERMINATED") for status in viewer.statuses))

    def test_the_end_is_shown_also_to_a_viewer_that_reads_late(self):
        sm = machine(*[Done() for _ in range(8)])
        sm.userdata.picture = "x" * 1_000_000  # more than the kernel takes at once
        name, server = self.serve(sm, "/")
        reads = threading.Event()

        class Late(Viewer):
            def receive(self, message, into):
                if into is self.statuses and into:
                    reads.wait(LONG)
                super().receive(message, into)

        last_words, introspection.LAST_WORDS = introspection.LAST_WORDS, LONG
        self.addCleanup(setattr, introspection, "LAST_WORDS", last_words)
        viewer = self.view(name, 1, Late)
        sm.execute()
        stops = threading.Thread(target=server.stop, name="stop")
        stops.start()
        stops.join(0.5)  # it waits for the viewer
        reads.set()
        stops.join()
        viewer.wait(lambda: any(status.info.startswith("TERMINATED") for status in viewer.statuses))

    def test_a_viewer_is_told_once_even_when_the_worker_begins_after_it(self):
        class Late(IntrospectionServer):
            go = threading.Event()

            def _work(self):
                self.go.wait(LONG)
                super()._work()

        sm = machine(Done())
        server = Late("late", sm, "/SM_ROOT")
        server.start()
        self.addCleanup(server.stop)
        viewer = Viewer("late")
        self.addCleanup(viewer.close)
        wait_for_connections(server._structure_publisher, server._status_publisher)
        Late.go.set()
        viewer.wait(lambda: viewer.structures and viewer.statuses)
        sm.execute()
        viewer.wait(lambda: viewer.statuses[-1].info.startswith("TERMINATED"))
        self.assertNotIn("HEARTBEAT", [status.info for status in viewer.statuses])

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

    def test_empty_userdata_has_the_known_encoding(self):
        self.assertEqual(encode({}), "gAJ9cQAu")
