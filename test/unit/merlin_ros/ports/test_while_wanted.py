# SPDX-License-Identifier: Apache-2.0
"""Long work for a client ends when the client is gone: it died, or its call was ended."""

from typing import Any

import pytest

pytestmark = pytest.mark.processes

SERVER = """
import sys, threading, rospy
from std_srvs.srv import SetBool, SetBoolResponse
from merlin_ros.node import run_node
from merlin_ros.ports.service_server import while_wanted

def work(request):
    gone = threading.Event()
    with while_wanted(gone.set):
        print("works", flush=True)
        wanted = not (request.data and gone.wait(100.0))
    print("wanted" if wanted else "given up", flush=True)
    return SetBoolResponse(True, "done")

def start():
    start.service = rospy.Service("ask", SetBool, work)
    print("started", flush=True)
sys.exit(run_node("server", start))
"""

CLIENT = """
import sys
from std_srvs.srv import SetBool
from merlin_ros.call_scope import CallScope
from merlin_ros.node import run_node
from merlin_ros.service_proxy import ServiceError, ServiceProxy

ask = ServiceProxy("ask", SetBool, timeout=100.0)

def start():
    def run():
        print("ANSWER", ask(False).message, flush=True)
        sys.stdin.readline()
        with CallScope() as scope:
            if sys.argv[1] == "end":
                scope.end(after=1.0)
            try:
                ask(True)
            except ServiceError:
                print("ended", flush=True)
        print("ANSWER", ask(False).message, flush=True)
    return run
sys.exit(run_node("client", start))
"""


def test_the_work_for_a_client_that_dies_ends(master: Any) -> None:
    server = master.node(SERVER)
    server.expect("started")
    client = master.node(CLIENT, "die")
    client.expect("ANSWER done")
    server.expect("wanted")
    client.say("go on")
    server.expect("works")
    client.process.kill()
    server.expect("given up")


def test_a_call_that_is_ended_ends_its_work_and_the_next_one_is_answered(master: Any) -> None:
    server = master.node(SERVER)
    server.expect("started")
    client = master.node(CLIENT, "end")
    client.expect("ANSWER done")
    server.expect("wanted")
    client.say("go on")
    client.expect("ended")
    server.expect("given up")
    client.expect("ANSWER done")
