# SPDX-License-Identifier: Apache-2.0
"""Services and topics of one part of a node are announced together, by whatever master there is."""

import logging
import socketserver
import threading
from types import SimpleNamespace
from typing import Any, Callable, Iterator, List
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from rospy.impl.registration import Registration, RegManager

from merlin_ros.master.announcing import announced_together

pytestmark = pytest.mark.everywhere

Kind = Callable[..., "Master"]


class Master(socketserver.ThreadingMixIn, SimpleXMLRPCServer):
    """Notes what is registered, and which calls it got for that."""

    daemon_threads = True

    def __init__(self, together: bool, refused: str = "") -> None:
        super().__init__(("127.0.0.1", 0), logRequests=False)
        self.uri = f"http://127.0.0.1:{self.server_address[1]}"
        self.services: List[str] = []
        self.calls = 0
        self._refused = refused
        self.topics: List[str] = []
        self.register_function(self._register, "registerService")
        self.register_function(self._register_topic, "registerPublisher")
        self.register_function(self._register_topic, "registerSubscriber")
        if together:
            self.register_multicall_functions()

    def _marshaled_dispatch(self, *args: Any, **options: Any) -> Any:
        self.calls += 1
        return super()._marshaled_dispatch(*args, **options)

    def _register(self, _caller: str, name: str, _address: str, _uri: str) -> List[Any]:
        if name == self._refused:
            self._refused = ""  # once
            return [-1, "not now", 0]
        self.services.append(name)
        return [1, "", 0]

    def _register_topic(self, _caller: str, name: str, kind: str, _uri: str) -> List[Any]:
        if name == self._refused:
            self._refused = ""
            return [-1, "not now", 0]
        self.topics.append(f"{name} {kind}")
        return [1, "", ["http://publisher"]]


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Iterator[Kind]:
    running: List[Master] = []

    def make(**options: Any) -> Master:
        master = Master(**options)
        threading.Thread(target=master.serve_forever, name="master", daemon=True).start()
        running.append(master)
        monkeypatch.setenv("ROS_MASTER_URI", master.uri)
        return master

    yield make
    for master in running:
        master.shutdown()
        master.server_close()


def serve(master: Master, *names: str) -> None:
    """What rospy does when services are made."""
    for name in names:
        RegManager.reg_added(manager(master, []), name, "rosrpc://me", Registration.SRV)


def manager(master: Master, updates: List[Any]) -> Any:
    """rospy's manager of registrations.

    :param updates: gets (topic, publishers) of each subscription.
    """
    return SimpleNamespace(
        master_uri=master.uri,
        uri="http://me",
        logger=logging.getLogger("test"),
        publisher_update=lambda *update: updates.append(update),
    )


def test_services_are_announced_with_one_call_when_all_are_there(start: Kind) -> None:
    master = start(together=True)
    with announced_together():
        serve(master, "/a")
        with announced_together():
            serve(master, "/b", "/c")
        assert not master.services
    assert (master.services, master.calls) == (["/a", "/b", "/c"], 1)
    serve(master, "/d")
    assert (master.services[3:], master.calls) == (["/d"], 2)


def test_a_master_that_takes_single_calls_only_gets_these(start: Kind) -> None:
    master = start(together=False)
    with announced_together():
        serve(master, "/a", "/b")
    assert master.services == ["/a", "/b"]


def test_a_service_that_was_refused_is_announced_again(start: Kind) -> None:
    master = start(together=True, refused="/a")
    with announced_together():
        serve(master, "/a", "/b")
    assert sorted(master.services) == ["/a", "/b"]


def test_what_could_not_be_made_is_not_announced(start: Kind) -> None:
    master = start(together=True)
    with pytest.raises(ValueError, match="wrong"), announced_together():
        serve(master, "/a", "/b")
        raise ValueError("wrong")
    assert not master.services
    serve(master, "/c")
    assert master.services == ["/c"]


def test_services_of_other_threads_do_not_wait(start: Kind) -> None:
    master = start(together=True)
    with announced_together():
        serve(master, "/a")
        other = threading.Thread(target=serve, args=(master, "/b"))
        other.start()
        other.join()
        assert master.services == ["/b"]
    assert master.services == ["/b", "/a"]


@pytest.mark.parametrize("refused, calls", [("", 1), ("/heard", 2)])
def test_topics_are_announced_with_them_and_subscriptions_hear_who_publishes(
    start: Kind, refused: str, calls: int
) -> None:
    master, updates = start(together=True, refused=refused), []  # type: ignore[var-annotated]
    with announced_together():
        for name, kind in (("/said", Registration.PUB), ("/heard", Registration.SUB)):
            RegManager.reg_added(manager(master, updates), name, "std_msgs/String", kind)
        serve(master, "/a")
        assert not master.topics
    assert (master.topics, master.calls) == (["/said std_msgs/String", "/heard std_msgs/String"], calls)
    assert (master.services, updates) == (["/a"], [("/heard", ["http://publisher"])])


def test_a_master_that_takes_single_calls_only_gets_topics_too(start: Kind) -> None:
    master, updates = start(together=False), []  # type: ignore[var-annotated]
    with announced_together():
        RegManager.reg_added(manager(master, updates), "/heard", "std_msgs/String", Registration.SUB)
        serve(master, "/a")
    assert updates == [("/heard", ["http://publisher"])] and master.services == ["/a"]
