# SPDX-License-Identifier: Apache-2.0
"""States of smach_ros but SimpleActionState: P11, P12, B7 to B11, D10, D12 and U7."""

import io
import os
import signal
import socket
import subprocess
import threading
import unittest

import rosgraph
import rospy
from rosgraph.network import read_ros_handshake_header, write_ros_handshake_header
from smach_fixture import Run
from std_msgs.msg import Int32
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse, Trigger, TriggerResponse

import smach
import smach_ros
from merlin_test import LONG
from merlin_test.node_path import lean_script
from smach_ros import ConditionState, MonitorState, ServiceState

HERE = os.path.dirname(os.path.abspath(__file__))


class Services:
    def service(self, name, handler, kind=Trigger):
        service = rospy.Service(name, kind, handler)
        self.addCleanup(service.shutdown)
        return service

    def test_request_and_response(self):
        self.service("set", lambda request: SetBoolResponse(request.data, "said"), SetBool)
        state = ServiceState("set", SetBool, request_slots=["data"], response_slots=["success", "message"])
        run = Run(state, data=True)
        self.assertEqual(run.end(), "succeeded")
        self.assertEqual((run.ud.success, run.ud.message), (True, "said"))
        self.assertEqual(Run(state).end(), "aborted")
        state = ServiceState(
            "set",
            SetBool,
            request=SetBoolRequest(data=False),
            request_cb=lambda ud, request, flag: setattr(request, "data", flag),
            request_cb_args=[True],
            response_cb=lambda ud, response, word: word if response.success else None,
            response_cb_args=["yes"],
            outcomes=["yes"],
        )
        self.assertEqual(Run(state).end(), "yes")

    def test_u7_request_edited_in_place_is_a_fresh_one_each_time(self):
        self.service("set", lambda request: SetBoolResponse(request.data, ""), SetBool)
        request = SetBoolRequest(data=False)

        def toggle(ud, request):
            request.data = not request.data

        state = ServiceState("set", SetBool, request, request_cb=toggle, response_slots=["success"])
        runs = [Run(state), Run(state)]
        self.assertEqual([(run.end(), run.ud.success) for run in runs], [("succeeded", True)] * 2)

    def test_p11_request_during_the_call_ends_the_state_and_not_its_next_run(self):
        called, release = threading.Event(), threading.Event()
        self.addCleanup(release.set)
        self.service("slow", lambda request: called.set() or release.wait(LONG) and TriggerResponse(True, ""))
        state = ServiceState("slow", Trigger)
        run = Run(state)
        self.assertTrue(called.wait(LONG))
        state.request_preempt()
        self.assertEqual(run.end(), "preempted")
        release.set()
        self.assertEqual(Run(state).end(), "succeeded")

    def test_b9_time_limits_and_failures_end_with_aborted(self):
        release = threading.Event()
        self.addCleanup(release.set)
        self.service("slow", lambda request: release.wait(LONG) and TriggerResponse(True, ""))
        self.assertEqual(Run(ServiceState("slow", Trigger, call_timeout=0.2)).end(), "aborted")
        self.assertEqual(Run(ServiceState("nowhere", Trigger, server_wait_timeout=0.2)).end(), "aborted")
        failing = self.service("fails", lambda request: 1 / 0)
        self.assertEqual(Run(ServiceState("fails", Trigger)).end(), "aborted")
        self.service("set", lambda request: SetBoolResponse(True, ""), SetBool)
        wrong_type = ServiceState("set", SetBool, request_slots=["data"])
        self.assertEqual(Run(wrong_type, data="no bool").end(), "aborted")
        # The service is waited for in every execution, not in the first only.
        state = ServiceState("fails", Trigger)
        self.assertEqual(Run(state).end(), "aborted")
        failing.shutdown()
        run = Run(state)
        self.service("fails", lambda request: TriggerResponse(True, ""))
        self.assertEqual(run.end(), "succeeded")

    def test_a_call_that_is_given_up_leaves_no_thread_while_its_server_works(self):
        release = threading.Event()
        self.addCleanup(release.set)
        self.service("slow", lambda request: release.wait(LONG) and TriggerResponse(True, ""))
        before = set(threading.enumerate())
        self.assertEqual(Run(ServiceState("slow", Trigger, call_timeout=0.2)).end(), "aborted")
        for thread in set(threading.enumerate()) - before:
            if thread.name == "call of slow":
                thread.join(LONG)
                self.assertFalse(thread.is_alive())

    def test_a_call_that_is_given_up_is_not_carried_out_when_its_server_goes_on(self):
        with socket.create_server(("127.0.0.1", 0)) as server:
            uri = f"rosrpc://127.0.0.1:{server.getsockname()[1]}"
            name = rospy.resolve_name("hangs")
            rosgraph.Master(rospy.get_name()).registerService(name, uri, rospy.get_node_uri())
            self.assertEqual(Run(ServiceState("hangs", Trigger, call_timeout=0.2)).end(), "aborted")
            asked = {"probe": "1"}
            while "probe" in asked:
                connection, _ = server.accept()
                connection.settimeout(LONG)
                asked = read_ros_handshake_header(connection, io.BytesIO(), 4096)
            with connection:
                answer = {"callerid": "/hangs", "md5sum": Trigger._md5sum, "type": Trigger._type}
                write_ros_handshake_header(connection, answer)
                self.assertEqual(connection.recv(1), b"")  # it is closed, and no request comes

    def test_preempt_while_the_service_is_missing(self):
        state = ServiceState("nowhere", Trigger)
        run = Run(state)
        while run.is_alive():
            state.request_preempt()
            run.join(0.05)
        self.assertEqual(run.end(), "preempted")


class Topics:
    def publisher(self, name):
        publisher = rospy.Publisher(name, Int32, latch=True, queue_size=10)
        self.addCleanup(publisher.unregister)
        return publisher

    def test_monitor_state(self):
        publisher = self.publisher("numbers")
        publisher.publish(3)
        state = MonitorState("numbers", Int32, lambda ud, message: message.data != ud.bad, input_keys=["bad"])
        self.assertEqual(Run(state, bad=3).end(), "invalid")
        counted = MonitorState("numbers", Int32, lambda ud, message: True, max_checks=1)
        self.assertEqual(Run(counted).end(), "valid")

        def broken(ud, message):
            raise ValueError

        self.assertEqual(Run(MonitorState("numbers", Int32, broken)).end(), "invalid")

    def test_p12_request_at_any_moment_ends_a_monitor(self):
        state = MonitorState("silence", Int32, lambda ud, message: True)
        sm = smach.StateMachine(["valid", "invalid", "preempted"])
        with sm:
            smach.StateMachine.add("M", state)
        sm.register_start_cb(lambda *args: sm.request_preempt())
        self.assertEqual(Run(sm).end(), "preempted")
        sm._start_cbs.clear()
        for i in range(20):
            sm.prepare_run()
            run = Run(sm)
            run.join(0.0005 * i)
            sm.request_preempt()
            self.assertEqual(run.end(), "preempted")

    def test_p12_request_from_the_condition_wins(self):
        self.publisher("numbers").publish(3)
        state = MonitorState("numbers", Int32, lambda ud, message: state.request_preempt())
        self.assertEqual(Run(state).end(), "preempted")

    def test_b8_monitor_ends_by_timeout(self):
        state = MonitorState("silence", Int32, lambda ud, message: True, timeout=rospy.Duration(0.2))
        self.assertEqual(Run(state).end(), "invalid")
        self.publisher("numbers").publish(3)
        # rospy hands a further subscriber at once what this process has received.
        received = threading.Event()
        first = rospy.Subscriber("numbers", Int32, lambda message: received.set())
        self.addCleanup(first.unregister)
        self.assertTrue(received.wait(LONG))
        state = MonitorState("numbers", Int32, lambda ud, message: True, timeout=0.2)
        self.assertEqual(Run(state).end(), "valid")

    def test_d12_monitor_takes_the_interface_of_its_callback_and_can_end_as_valid(self):
        @smach.cb_interface(input_keys=["wanted"], output_keys=["got"], outcomes=["odd"])
        def condition(ud, message):
            ud.got = message.data
            return "valid" if message.data == ud.wanted else "odd"

        self.publisher("numbers").publish(3)
        state = MonitorState("numbers", Int32, condition)
        self.assertEqual(state.get_registered_input_keys(), ("wanted",))
        run = Run(state, wanted=3)
        self.assertEqual((run.end(), run.ud.got), ("valid", 3))
        self.assertEqual(Run(state, wanted=4).end(), "odd")


class Conditions:
    def test_d10_condition_is_checked_as_often_as_max_checks_says(self):
        for max_checks in (1, 3):
            calls = []
            state = ConditionState(lambda ud, c=calls: c.append(1), poll_rate=0.01, max_checks=max_checks)
            self.assertEqual(Run(state).end(), "false")
            self.assertEqual(len(calls), max_checks)

    def test_d10_no_pause_follows_the_last_check(self):
        # A pause of an hour would be noticed.
        state = ConditionState(lambda ud: False, poll_rate=rospy.Duration(3600))
        self.assertEqual(Run(state).end(), "false")

    def test_condition_becomes_true_times_out_or_is_preempted(self):
        calls = []
        state = ConditionState(
            lambda ud: calls.append(1) or len(calls) == ud.n, input_keys=["n"], poll_rate=0.01, max_checks=-1
        )
        self.assertEqual(Run(state, n=4).end(), "true")
        state = ConditionState(lambda ud: False, poll_rate=0.01, timeout=rospy.Duration(0.1), max_checks=-1)
        self.assertEqual(Run(state).end(), "false")
        asked = threading.Event()
        state = ConditionState(lambda ud: asked.set(), poll_rate=rospy.Duration(3600), max_checks=-1)
        run = Run(state)
        self.assertTrue(asked.wait(LONG))
        state.request_preempt()
        self.assertEqual(run.end(), "preempted")


class Shutdown:
    """Processes that are interrupted while a state runs."""

    def interrupt(self, **expected):
        """Interrupts one process per scenario when it runs; all at once, for their start takes long."""
        processes = {
            scenario: subprocess.Popen(
                lean_script(os.path.join(HERE, "smach_victim.py"), scenario),
                stdout=subprocess.PIPE,
                text=True,
            )
            for scenario in expected
        }
        for process in processes.values():
            self.addCleanup(process.stdout.close)
            self.addCleanup(process.kill)
        for process in processes.values():
            for line in process.stdout:
                if line.startswith("running"):
                    break
            process.send_signal(signal.SIGINT)
        for scenario, process in processes.items():
            output, _ = process.communicate(timeout=LONG)
            self.assertEqual((scenario, process.returncode), (scenario, 0))
            self.assertIn(f"outcome {expected[scenario]}", output, scenario)

    def test_b8_b10_waiting_states_end_at_a_shutdown(self):
        self.interrupt(
            monitor="preempted",
            condition="preempted",
            service="preempted",
            action="preempted",
            wait_for_action="preempted",
            merlin_wait_for_action="preempted",
        )

    def test_b7_b11_preempt_handler_ends_every_kind_of_container(self):
        self.interrupt(
            machine="preempted",
            concurrence="preempted",
            iterator="preempted",
            main_thread="preempted",
            # This one has no handler, and a child that never ends.
            stubborn_concurrence="None",
        )


class States(Services, Topics, Conditions, Shutdown, unittest.TestCase):
    def test_imports(self):
        from smach_ros.introspection import INIT_TOPIC, STATUS_TOPIC, STRUCTURE_TOPIC

        self.assertEqual(
            (STATUS_TOPIC, INIT_TOPIC, STRUCTURE_TOPIC),
            ("/smach/container_status", "/smach/container_init", "/smach/container_structure"),
        )
        self.assertIs(smach.logwarn, rospy.logwarn)
        self.assertTrue(callable(smach_ros.set_preempt_handler))
