"""A service proxy after a request that cannot be written, and while it is closed."""

import threading
from typing import Any, Optional

import pytest
from std_srvs.srv import SetBool

from merlin_ros.call_scope import CallScope
from merlin_ros.service_proxy import ServiceProxy

pytestmark = pytest.mark.processes

LONG = 60.0

SERVER = """
import sys, rospy
from std_srvs.srv import SetBool, SetBoolResponse
from merlin_ros.node import run_node

def start():
    start.service = rospy.Service("ask", SetBool, lambda request: SetBoolResponse(True, "told"))
    print("started", flush=True)
sys.exit(run_node("server", start))
"""

CLIENT = """
import sys
from std_srvs.srv import SetBool
from merlin_ros.node import run_node
from merlin_ros.service_proxy import ServiceProxy

ask = ServiceProxy("ask", SetBool, timeout=100.0)

def start():
    def run():
        for request in (True, "no truth", True):
            try:
                print("ANSWER", ask(request).message, flush=True)
            except Exception as error:
                print("ANSWER", type(error).__name__, flush=True)
    return run
sys.exit(run_node("client", start))
"""


def test_a_request_that_cannot_be_written_does_not_spoil_the_next_one(master: Any) -> None:
    master.node(SERVER).expect("started")
    client = master.node(CLIENT)
    answers = [client.expect("ANSWER") for _ in range(3)]
    assert answers == ["ANSWER told", "ANSWER SerializationError", "ANSWER told"]


class Condition(threading.Condition):
    """Says that a thread waits."""

    def __init__(self) -> None:
        super().__init__()
        self.waits = threading.Event()

    def wait(self, timeout: Optional[float] = None) -> bool:
        self.waits.set()
        return super().wait(timeout)


def test_a_proxy_is_closed_between_two_calls_also_in_a_scope_that_has_ended() -> None:
    proxy, caller = ServiceProxy("ask", SetBool), CallScope()
    proxy._free = free = Condition()
    assert proxy._occupy(caller)

    def close() -> None:
        with CallScope() as scope:
            scope.ended = True
            proxy.close()

    thread = threading.Thread(target=close, daemon=True)
    thread.start()
    while thread.is_alive() and not free.waits.wait(0.01):
        pass
    assert proxy._user is caller, "closed under a call"
    proxy._leave()
    thread.join(LONG)
    assert proxy._user is None
