# SPDX-License-Identifier: Apache-2.0
"""Services over real connections: servers that die, hang, refuse, and come back."""

import os
import signal
import threading
import unittest
from unittest import mock

import rospy
from std_srvs.srv import Trigger, TriggerResponse
from transport_victim import start_victim

from merlin_ros import service_proxy
from merlin_ros.master.master_link import MasterSilent
from merlin_ros.service_proxy import ServiceError, ServiceProxy, when_back
from merlin_test import LONG
from merlin_test.topic_links import patient_service


class Services(unittest.TestCase):
    def test_a_restarted_server_is_found_again(self):
        ask = patient_service("victim/ask", Trigger)
        for _ in range(2):
            victim = start_victim()
            try:
                self.assertTrue(ask.wait(LONG))
                # Until the master has the new address, another process may listen at the old one.
                self.assertEqual(when_back(ask, LONG).message, "/victim")
            finally:
                os.kill(victim.pid, signal.SIGKILL)
                victim.wait()
        with self.assertRaises(ServiceError) as caught:
            ask()
        self.assertIn("/victim/ask", str(caught.exception))

    def test_threads_share_a_proxy(self):
        service = rospy.Service("shared", Trigger, lambda request: TriggerResponse(True, "yes"))
        self.addCleanup(service.shutdown)
        proxy = patient_service("shared", Trigger)
        answers = []
        threads = [
            threading.Thread(target=lambda: answers.extend(proxy().message for _ in range(50)))
            for _ in range(8)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(answers, ["yes"] * 400)

    def test_a_server_that_hangs_is_given_up(self):
        release = threading.Event()
        self.addCleanup(release.set)
        service = rospy.Service("hangs", Trigger, lambda request: release.wait() and TriggerResponse())
        self.addCleanup(service.shutdown)
        with self.assertRaises(ServiceError):
            ServiceProxy("hangs", Trigger, timeout=0.2)()

    def test_a_time_limit_that_passes_while_the_server_is_looked_up_ends_the_call(self):
        service = rospy.Service("looked_up", Trigger, lambda request: TriggerResponse(True, "too late"))
        self.addCleanup(service.shutdown)
        passed, give_up = threading.Event(), ServiceProxy._give_up

        def note(proxy):
            give_up(proxy)
            passed.set()

        def look_slowly(name):
            assert passed.wait(LONG)
            return rospy.get_master().lookupService(name)[2]

        with mock.patch.object(ServiceProxy, "_give_up", staticmethod(note)), mock.patch.object(
            service_proxy, "lookup_service", look_slowly
        ), self.assertRaisesRegex(ServiceError, "no answer within 0.2 s"):
            ServiceProxy("looked_up", Trigger, timeout=0.2)()

    def test_the_first_call_waits_for_a_server_that_is_being_started(self):
        offered, look = [], service_proxy.lookup_service

        def start_after_the_first_look(name):
            if not offered:
                offered.append(rospy.Service("comes_late", Trigger, lambda _: TriggerResponse(True, "here")))
                self.addCleanup(offered[0].shutdown)
                raise MasterSilent("it did not answer")
            return look(name)

        with mock.patch.object(service_proxy, "lookup_service", start_after_the_first_look):
            self.assertEqual(ServiceProxy("comes_late", Trigger, patience=LONG)().message, "here")

    def test_a_patient_call_asks_a_slow_master_until_it_answers_and_then_no_more(self):
        service = rospy.Service("found_late", Trigger, lambda _: TriggerResponse(True, "here"))
        self.addCleanup(service.shutdown)
        answers, look = iter([MasterSilent("it did not answer")] * 3 + [None]), service_proxy.lookup_service

        def answer(name):
            silent = next(answers)
            if silent:
                raise silent
            return look(name)

        with mock.patch.object(service_proxy, "lookup_service", answer):
            self.assertEqual(ServiceProxy("found_late", Trigger, patience=LONG)().message, "here")
            self.assertRaises(StopIteration, next, answers)

    def test_a_refusal_is_told_in_the_words_of_the_server(self):
        def refuse(_):
            raise rospy.ServiceException("battery of 'anna' is \"flat\", naïve")

        service = rospy.Service("refuses", Trigger, refuse)
        self.addCleanup(service.shutdown)
        with self.assertRaises(ServiceError) as caught:
            patient_service("refuses", Trigger)()
        self.assertEqual(
            str(caught.exception), "service /refuses failed: battery of 'anna' is \"flat\", naïve"
        )

    def test_a_missing_service_is_named(self):
        with self.assertRaises(ServiceError) as caught:
            ServiceProxy("nowhere", Trigger)()
        self.assertIn("/nowhere", str(caught.exception))
