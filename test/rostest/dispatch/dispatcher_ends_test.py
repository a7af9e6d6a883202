# SPDX-License-Identifier: Apache-2.0
"""A plan dispatcher that ends, by a signal or killed: its actions stop, and its client gets the reason."""

import contextlib
import os
import queue
import signal
import tempfile
import threading
import unittest
from unittest import mock
from xmlrpc.client import ServerProxy

import rosgraph
import rosnode
import rospy
from dispatch_fixture import Interfaces, named, publisher
from merlin_msgs.msg import DispatchStatus
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback, NonBlockingDispatchActionFeedback
from rosplan_dispatch_msgs.srv import DispatchService, DispatchServiceResponse, ParsingService
from std_srvs.srv import Empty, EmptyResponse

from merlin_planning import dispatch_client
from merlin_planning.action_messages import OWN_MARK
from merlin_planning.dispatch_client import DispatchClient
from merlin_ros.service_proxy import ServiceError
from merlin_test import LONG
from merlin_test.process_signals import strike
from merlin_test.topic_links import patient_service, wait_for_connections, wait_for_publishers


class DispatcherEnds(unittest.TestCase):
    def begin(self, dispatcher, **answers):
        """Gives it a plan of one action; returns what answers for the action."""
        interfaces = Interfaces(dispatcher)
        self.addCleanup(interfaces.close)
        interfaces.answers.update({"paint": [(1,)], **answers})
        parse = patient_service("/ends_parser/parse_plan_from_file", ParsingService)
        self.assertTrue(parse.wait(LONG))
        with tempfile.NamedTemporaryFile("w", suffix=".plan") as file:
            file.write("0.0: (paint ann leg) [5.0]\n")
            file.flush()
            self.assertTrue(parse(plan_path=file.name).plan_parsed)
        return interfaces

    def test_one_that_is_told_to_end_cancels_what_runs_and_is_gone(self):
        dispatcher = "/ending_dispatcher"
        dispatch = patient_service(f"{dispatcher}/dispatch_plan", DispatchService)
        self.assertTrue(dispatch.wait(LONG))
        interfaces = self.begin(dispatcher, on_cancel=(10, "cancelled"))
        ended = threading.Event()

        def call():
            with contextlib.suppress(ServiceError):
                dispatch()
            ended.set()

        threading.Thread(target=call, daemon=True).start()
        interfaces.wait(named("paint"))
        rosnode.kill_nodes([dispatcher])
        interfaces.wait(named("cancel_action"))
        self.assertTrue(ended.wait(LONG))
        while dispatch.available():  # its connections are closed before its services are
            rospy.rostime.wallsleep(0.05)

    def test_an_interface_that_has_never_announced_itself_and_dies_is_named(self):
        dispatcher, answers, statuses = "/deaf_dispatcher", queue.Queue(), queue.Queue()
        client = DispatchClient(dispatcher, cancel_deadline=LONG)
        self.assertTrue(client.wait_status(LONG))
        topic = f"{dispatcher}/dispatch_plan_action/feedback"
        heard = rospy.Subscriber(topic, NonBlockingDispatchActionFeedback, answers.put)
        status = rospy.Subscriber(f"{dispatcher}/dispatch_status", DispatchStatus, statuses.put)
        for subscriber in (heard, status):
            self.addCleanup(subscriber.unregister)
            wait_for_publishers(subscriber)
        interfaces = self.begin(dispatcher)
        threading.Thread(target=client.dispatch, args=(lambda interrupt: None,), daemon=True).start()
        taken = False
        while not taken:  # by the interface: the dispatcher says so, too
            said = answers.get(timeout=LONG).feedback.feedback
            own = any(entry.key == OWN_MARK for entry in said.information)
            taken = said.status == ActionFeedback.ACTION_ENABLED and not own
        interfaces.feedback.unregister()  # its connection closes, as that of a node that dies
        while statuses.get(timeout=LONG).reason != "the action interface of paint is gone, silent for 0.5 s":
            pass

    def dispatched_and_killed(self, dispatcher, deadline, sent=signal.SIGKILL, **answers):
        """A client whose dispatcher is killed under it, its interfaces, and what gives the result.

        :param sent: what it gets instead.
        """
        changes = queue.Queue()
        client = DispatchClient(dispatcher, cancel_deadline=deadline, on_change=lambda: changes.put(None))
        self.assertTrue(client.wait_status(LONG))
        interfaces = self.begin(dispatcher, paint=[], **answers)
        wait_for_publishers(interfaces.subscriber, count=2)  # the dispatcher, and the client
        results = []
        thread = threading.Thread(target=lambda: results.append(client.dispatch(lambda interrupt: None)))
        thread.start()

        def result():
            thread.join(LONG)
            return results[0]

        interfaces.answer(interfaces.wait(named("paint")), 1, interruptible="no")
        while not any(action.uninterruptible for action in client.running):  # it has seen the answer
            changes.get(timeout=LONG)
        uri = rosnode.get_api_uri(rosgraph.Master(rospy.get_name()), dispatcher)
        _, _, pid = ServerProxy(uri).getPid("/test")
        strike(pid, sent)
        if sent == signal.SIGSTOP:
            self.addCleanup(os.kill, pid, signal.SIGCONT)
        return client, interfaces, result

    def test_the_actions_of_one_that_is_killed_are_cancelled_by_its_client(self):
        _, interfaces, result = self.dispatched_and_killed(
            "/killed_dispatcher", LONG, on_cancel=(10, "cancelled")
        )
        interfaces.wait(named("cancel_action"))
        ended = result()
        self.assertTrue(ended.gone)
        self.assertEqual((ended.cancelled, ended.action, ended.unstopped), (False, "", ()))

    @mock.patch.object(dispatch_client, "ORPHAN_GRACE", LONG)
    def test_a_cancel_after_it_was_killed_is_complete_when_the_action_has_ended(self):
        client, interfaces, result = self.dispatched_and_killed("/dead_dispatcher", LONG)
        action = interfaces.wait(named("cancel_action"))
        client.cancel()
        interfaces.answer(action, 10, "cancelled")
        ended = result()
        self.assertTrue(ended.gone and ended.cancelled)
        self.assertEqual(ended.unstopped, ())

    @mock.patch.object(dispatch_client, "ORPHAN_GRACE", 10.0)  # s in which this test has to cancel
    def test_a_cancel_after_it_was_killed_names_the_action_that_does_not_answer(self):
        client, interfaces, result = self.dispatched_and_killed("/lost_dispatcher", 0.2)
        interfaces.wait(named("cancel_action"))
        client.cancel()
        self.assertEqual(result().unstopped, ("(paint ann leg)",))

    def test_one_that_hangs_is_given_up_also_when_no_action_answers(self):
        _, _, result = self.dispatched_and_killed("/hanging_dispatcher", 0.5, signal.SIGSTOP)
        ended = result()
        self.assertTrue(ended.timed_out)
        self.assertEqual((ended.cancelled, ended.unstopped), (False, ("(paint ann leg)",)))

    def test_one_as_rosplans_that_loses_an_action_is_cancelled_and_says_so(self):
        result = self.dispatched_and_lost("/forgetful_dispatcher", seen=True)
        self.assertFalse(result.cancelled)
        self.assertIn("has sent nothing for 10 s, and nothing takes (paint)", result.reason)

    def test_one_as_rosplans_that_loses_an_action_also_for_its_client_is_cancelled(self):
        result = self.dispatched_and_lost("/absent_dispatcher", seen=False)
        self.assertFalse(result.cancelled)
        self.assertTrue(result.reason.endswith("has sent nothing for 10 s"), result.reason)

    def test_a_cancel_reaches_one_as_rosplans_whose_client_has_missed_its_action(self):
        result = self.dispatched_and_lost("/unseen_dispatcher", seen=False, stuck_after=LONG, cancelled=True)
        self.assertEqual((result.cancelled, result.timed_out, result.unstopped), (True, False, ()))

    def dispatched_and_lost(self, name, seen, stuck_after=10.0, cancelled=False):
        """The esterel dispatcher waits for ever for an action that its queue of one has dropped.

        :param seen: the client receives it; no interface does.
        :param cancelled: the client cancels it then.
        """
        lost = threading.Event()
        actions = publisher(f"{name}/action_dispatch", ActionDispatch, queue_size=10)
        answers = publisher(f"{name}/action_feedback", ActionFeedback, queue_size=10)

        def dispatch(_request):
            actions.publish(ActionDispatch(action_id=1, name="paint"))
            for status in (ActionFeedback.ACTION_ENABLED, ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE):
                answers.publish(ActionFeedback(action_id=1, status=status))
            if seen:
                actions.publish(ActionDispatch(action_id=2, name="paint"))
            lost.wait(LONG)
            return DispatchServiceResponse(success=True, goal_achieved=False)

        def cancel(_request):
            lost.set()
            return EmptyResponse()

        for service in (
            rospy.Service(f"{name}/dispatch_plan", DispatchService, dispatch),
            rospy.Service(f"{name}/cancel_dispatch", Empty, cancel),
        ):
            self.addCleanup(service.shutdown)

        def changed():
            if cancelled and client.steps_done:
                client.cancel()

        client = DispatchClient(name, cancel_deadline=LONG, stuck_after=stuck_after, on_change=changed)
        wait_for_connections(actions, answers)  # from its call on, it counts how long it hears nothing
        result = client.dispatch(lambda interrupt: None)
        self.assertEqual((result.goal_achieved, result.gone, client.steps_done), (False, False, 1))
        self.assertTrue(lost.is_set())
        return result
