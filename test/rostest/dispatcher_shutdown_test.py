#!/usr/bin/env python3
"""A plan dispatcher that is told to end stops what runs first."""

import contextlib
import tempfile
import threading
import unittest

import rosnode
import rospy
from dispatch_fixture import LONG, Interfaces, named
from rosplan_dispatch_msgs.srv import DispatchService, ParsingService

import rostest
from merlin_ros.service_proxy import ServiceError, ServiceProxy


class Shutdown(unittest.TestCase):
    def test_a_dispatcher_that_is_told_to_end_cancels_what_runs_and_is_gone(self):
        dispatcher = "/ending_dispatcher"
        dispatch = ServiceProxy(f"{dispatcher}/dispatch_plan", DispatchService)
        self.assertTrue(dispatch.wait(LONG))
        interfaces = Interfaces(dispatcher)
        self.addCleanup(interfaces.close)
        interfaces.answers.update({"paint": [(1,)], "on_cancel": (10, "cancelled")})
        parse = ServiceProxy("/simple_parser/parse_plan_from_file", ParsingService)
        self.assertTrue(parse.wait(LONG))
        with tempfile.NamedTemporaryFile("w", suffix=".plan") as file:
            file.write("0.0: (paint ann leg) [5.0]\n")
            file.flush()
            self.assertTrue(parse(plan_path=file.name).plan_parsed)
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
        self.assertFalse(dispatch.available())


if __name__ == "__main__":
    rospy.init_node("dispatcher_shutdown_test")
    rostest.rosrun("merlin_test", "dispatcher_shutdown", Shutdown)
