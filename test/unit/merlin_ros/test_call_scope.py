# SPDX-License-Identifier: Apache-2.0
"""Service calls that a cancel ends, in the thread that is cancelled and in no other one, or another type."""

import signal
import threading
from typing import Any, List

import pytest

from merlin_ros.call_scope import CallScope, current_scope
from merlin_ros.service_proxy import ServiceProxy
from merlin_test import LONG

pytestmark = pytest.mark.processes


SERVER = """
import sys, threading, rospy
from std_srvs.srv import SetBool, SetBoolResponse
from merlin_ros.node import run_node

def start():
    go_on = threading.Event()
    def answer(request):
        print("ASKED", request.data, flush=True)
        if request.data:
            go_on.wait(600)
        return SetBoolResponse(True, "told")
    start.service = rospy.Service("ask", SetBool, answer)
    print("started", flush=True)
    def run():
        sys.stdin.readline()
        go_on.set()
        rospy.spin()
    return run
sys.exit(run_node("server", start))
"""

# Calls through one proxy, in a scope and in none; each line of its input begins a call or ends the scope.
CLIENT = """
import sys, threading
from std_srvs.srv import SetBool
from merlin_ros.call_scope import CallScope
from merlin_ros.node import run_node
from merlin_ros.service_proxy import ServiceError, ServiceProxy

ask = ServiceProxy("ask", SetBool, timeout=600.0)
scope, words = CallScope(), threading.Lock()

def say(*text):
    with words:  # else lines of two threads mix
        print(*text, flush=True)

def call(name, argument):
    try:
        say(name, ask(argument).message)
    except ServiceError as error:
        say(name, type(error).__name__, error)

def scoped(argument):
    with scope:
        call("SCOPED", argument)
        say("GAVE UP", scope.gave_up)

def start():
    if "connected" in sys.argv:
        call("FIRST", False)
    print("started", flush=True)
    def run():
        for line in sys.stdin:
            word, _, argument = line.strip().partition(" ")
            target = {"scoped": scoped, "free": lambda hang: call("FREE", hang), "end": lambda _: scope.end()}
            threading.Thread(target=target[word], args=(argument == "hang",), daemon=True).start()
    return run
sys.exit(run_node("client", start))
"""


OTHER_TYPE = """
import sys
from std_srvs.srv import Trigger
from merlin_ros.node import run_node
from merlin_ros.service_proxy import ServiceError, ServiceProxy

def run():
    try:
        ServiceProxy("ask", Trigger, timeout=600.0)()
    except ServiceError as error:
        print("FAILED", error, flush=True)
sys.exit(run_node("client", lambda: run))
"""


def test_a_service_of_another_type_is_named_with_the_type_that_was_expected(master: Any) -> None:
    master.node(SERVER).expect("started")
    client = master.node(OTHER_TYPE)
    assert client.expect("FAILED").endswith("it is of another type than std_srvs/Trigger")


@pytest.mark.parametrize("connected", ["connected", "new"])
def test_a_call_without_an_answer_is_given_up(master: Any, connected: str) -> None:
    server = master.node(SERVER)
    server.expect("started")
    client = master.node(CLIENT, connected)
    client.expect("started")
    client.say("scoped hang")
    server.expect("ASKED True")
    client.say("end")
    assert "ServiceUnavailable service /ask does not answer: given up after" in client.expect("SCOPED")
    assert "True" in client.expect("GAVE UP")
    server.say("go on")
    client.say("free")  # with a connection of its own
    assert "FREE told" in client.expect("FREE")


@pytest.mark.parametrize("connected", ["connected", "new"])
def test_a_call_to_a_process_that_hangs_is_given_up(master: Any, connected: str) -> None:
    server = master.node(SERVER)
    server.expect("started")
    client = master.node(CLIENT, connected)
    client.expect("started")
    server.send(signal.SIGSTOP)
    client.say("scoped")
    client.say("end")
    assert "ServiceUnavailable service /ask does not answer" in client.expect("SCOPED")
    server.send(signal.SIGCONT)


def test_the_call_of_another_thread_goes_on(master: Any) -> None:
    server, client = master.node(SERVER), None
    server.expect("started")
    client = master.node(CLIENT, "connected")
    client.expect("started")
    client.say("free hang")
    server.expect("ASKED True")
    client.say("scoped")  # has to wait for the proxy
    client.say("end")
    assert "service /ask does not answer" in client.expect("SCOPED")
    server.say("go on")
    assert "FREE told" in client.expect("FREE")


def test_a_scope_ends_what_is_under_way_and_what_comes() -> None:
    woken: List[str] = []
    with CallScope() as scope:
        assert current_scope() is scope
        with CallScope() as inner:
            assert current_scope() is inner
        ended = threading.Event()
        with scope.calling(ended.set):
            scope.end()
            assert ended.wait(LONG)
        assert scope.ended
        assert not scope.gave_up  # it was answered in time
        with pytest.raises(KeyError), scope.calling(lambda: woken.append("late")):
            raise KeyError
        assert scope.gave_up
    assert current_scope() is not scope
    assert woken == []


def test_a_scope_that_was_left_ends_nothing() -> None:
    with CallScope(limit=LONG) as scope:
        pass
    scope.end()
    assert not scope.ended


class Connection:
    """A proxy whose connection is made between two looks at it."""

    def __init__(self) -> None:
        self.socket = self
        self.looks = self.ends = 0

    def shutdown(self, how: int) -> None:
        self.ends += 1

    def _look(self, connecting: bool) -> Any:
        self.looks += 1
        return self if connecting == (self.looks == 1) else None

    @property
    def connecting(self) -> Any:
        return self._look(True)

    @property
    def transport(self) -> Any:
        return self._look(False)


def test_a_call_that_connects_while_its_scope_ends_is_woken() -> None:
    connection: Any = Connection()
    ServiceProxy._give_up(connection)
    assert connection.ends == 1


def test_threads_without_a_scope_are_never_ended() -> None:
    with current_scope().calling(lambda: None):
        assert not current_scope().ended
