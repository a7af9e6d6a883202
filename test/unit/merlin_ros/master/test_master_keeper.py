# SPDX-License-Identifier: Apache-2.0
"""A master that is slow, one that hangs, and one that hangs again while a node registers."""

import queue
import threading
import time
from socketserver import ThreadingMixIn
from typing import Any, Iterator, List
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import pytest

from merlin_ros.actions import hang_watch
from merlin_ros.actions.ownership import ownership
from merlin_ros.master import master_keeper, master_link, master_watch
from merlin_ros.master.foreign_nodes import ForeignNodes
from merlin_ros.master.master_keeper import MasterKeeper
from merlin_ros.master.master_link import MasterSilent
from merlin_ros.master.registration import KeptParameters, RegistrationError
from merlin_test import LONG

ME = "http://me:1"


@pytest.fixture
def keeper(monkeypatch: pytest.MonkeyPatch) -> Iterator[MasterKeeper]:
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")
    for name in ("logerr", "logwarn"):
        monkeypatch.setattr(master_keeper.rospy, name, lambda text: None)
    master_link.missed.clear()  # a test before this one may have been held up
    yield MasterKeeper("/node", ME)
    master_link.lost.clear()


class Server(ThreadingMixIn, SimpleXMLRPCServer):
    """Serves each connection in a thread of its own."""

    daemon_threads = True


class SlowMaster:
    """A master that answers only while `answers` is set.

    :param protocol: by ``HTTP/1.1`` it keeps the connections of its clients, by ``HTTP/1.0`` it does not.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, protocol: str) -> None:
        self._monkeypatch = monkeypatch
        self.answers = threading.Event()
        self.answers.set()
        self.process, self.node = 1, ME
        self.questions: queue.Queue[str] = queue.Queue()
        handler = type("Handler", (SimpleXMLRPCRequestHandler,), {"protocol_version": protocol})
        self._server = Server(("localhost", 0), handler, logRequests=False)
        self._server.register_multicall_functions()
        self._server.register_function(self._get_pid, "getPid")
        self._server.register_function(lambda *_: [1, "", self.node], "lookupNode")
        self.uri = f"http://localhost:{self._server.server_address[1]}"
        threading.Thread(target=self._server.serve_forever, name="slow master", daemon=True).start()

    def _get_pid(self, node: str) -> list:
        self.questions.put(node)
        assert self.answers.wait(LONG)
        return [1, "", self.process]

    def hang(self, hung: float = LONG) -> None:
        """It answers no more, and soon counts as silent; as hung after some time, s."""
        self.answers.clear()
        self._limits(0.3, hung)

    def go_on(self) -> None:
        """It answers again, and as late as a busy machine makes it."""
        self._limits(LONG, LONG)
        self.answers.set()

    def _limits(self, silent: float, hung: float) -> None:
        self._monkeypatch.setattr(master_watch, "SILENT", silent)
        self._monkeypatch.setattr(master_watch, "HUNG", hung)

    def close(self) -> None:
        self.answers.set()
        self._server.shutdown()
        self._server.server_close()


@pytest.fixture(params=["HTTP/1.0", "HTTP/1.1"])
def slow(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[SlowMaster]:
    master = SlowMaster(monkeypatch, request.param)
    monkeypatch.setenv("ROS_MASTER_URI", master.uri)
    master_link.missed.clear()  # a test before this one may have been held up
    yield master
    master.close()
    master_link.silent.clear()
    master_link.lost.clear()


@pytest.fixture
def asking(slow: SlowMaster, monkeypatch: pytest.MonkeyPatch) -> Iterator[MasterKeeper]:
    """A keeper that asks the slow master."""
    monkeypatch.setattr(hang_watch, "HUNG", LONG)  # this process may hang, and suspends all then
    monkeypatch.setattr(KeptParameters, "look", lambda *_: {})
    monkeypatch.setattr(master_keeper, "register_again", lambda *_: None)
    monkeypatch.setattr(master_keeper, "PERIOD", 0.05)
    keeper = MasterKeeper("/node", ME)
    yield keeper
    keeper.stop()


@pytest.fixture
def said(asking: MasterKeeper, monkeypatch: pytest.MonkeyPatch) -> "queue.Queue[str]":
    """What it says."""
    lines: queue.Queue[str] = queue.Queue()
    for name in ("logerr", "logwarn"):
        monkeypatch.setattr(master_keeper.rospy, name, lines.put)
    asking.start()
    return lines


def test_a_slow_master_pauses_what_runs_until_it_answers(slow: SlowMaster, said: "queue.Queue[str]") -> None:
    for _ in range(2):
        slow.hang()
        assert "is silent, it is slow or hangs; what runs pauses" in said.get(timeout=LONG)
        assert ownership.suspended("a goal") and not master_link.lost.is_set()
        slow.go_on()
        assert "answers again" in said.get(timeout=LONG)
        assert not ownership.suspended("a goal")


def test_a_master_that_hangs_is_lost_in_the_end_and_what_runs_stays_paused_until_it_is_back(
    slow: SlowMaster, said: "queue.Queue[str]"
) -> None:
    slow.hang(1.0)
    assert "is silent" in said.get(timeout=LONG)
    assert "does not answer; waiting for its return" in said.get(timeout=LONG)
    assert master_link.lost.is_set() and ownership.suspended("a goal")
    slow.go_on()
    assert "is back; this node is registered again" in said.get(timeout=LONG)
    assert not master_link.lost.is_set() and not ownership.suspended("a goal")


def test_an_answer_that_is_another_one_after_many_that_were_alike_is_noticed(
    slow: SlowMaster, said: "queue.Queue[str]"
) -> None:
    for _ in range(4):
        slow.questions.get(timeout=LONG)
    slow.node = "http://another:1"
    assert "the master has another node of this name" in said.get(timeout=LONG)
    slow.node = ME
    slow.process = 2
    while "was started anew; this node is registered again" not in said.get(timeout=LONG):
        pass


def test_other_nodes_are_looked_for_at_once(keeper: MasterKeeper, monkeypatch: pytest.MonkeyPatch) -> None:
    """A master may be lost before the first regular look, and then nothing else knows of them."""
    looks: List[Any] = []
    monkeypatch.setattr(ForeignNodes, "look", lambda self, master: looks.append(master))
    keeper.keep_foreign_nodes()
    assert len(looks) == 1


def test_nodes_of_others_are_tried_again_for_a_while_though_the_first_look_at_them_failed(
    slow: SlowMaster, asking: MasterKeeper, said: "queue.Queue[str]", monkeypatch: pytest.MonkeyPatch
) -> None:
    def look(*_: Any) -> None:
        raise MasterSilent("the master hangs")

    now, tries = [time.monotonic()], [0]  # not one of before: a wait that has begun would be longer

    def in_part(*_: Any) -> List[str]:
        tries[0] += 1
        now[0] += 3600.0  # this process stands still: that uses up no try
        raise RegistrationError("/one hangs")

    monkeypatch.setattr(ForeignNodes, "look", look)
    monkeypatch.setattr(ForeignNodes, "restore", in_part)
    monkeypatch.setattr(master_keeper, "FOREIGN_TRIES", 3)
    monkeypatch.setattr(KeptParameters, "restore", lambda *_: None)
    monkeypatch.setattr(master_keeper.time, "monotonic", lambda: now[0])
    asking.keep_foreign_nodes()
    for _ in range(2):  # with the second question the first answer is known
        slow.questions.get(timeout=LONG)
    slow.process = 2
    assert "was started anew; this node is registered again" in said.get(timeout=LONG)
    assert not tries[0], "they may do that themselves"
    now[0] += master_keeper.FOREIGN_GRACE
    assert "only in part: /one hangs" in said.get(timeout=LONG)
    assert tries == [3]


def test_a_master_that_does_not_let_a_node_register_stays_lost(
    slow: SlowMaster, said: "queue.Queue[str]", monkeypatch: pytest.MonkeyPatch
) -> None:
    attempts: List[bool] = []

    def register(*_: Any) -> None:
        attempts.append(master_link.lost.is_set())
        if len(attempts) == 1:
            raise MasterSilent("the master hangs again")

    lost: queue.Queue[bool] = queue.Queue()

    def warn(text: str) -> None:
        if "cannot register again" in text:
            lost.put(master_link.lost.is_set())
        said.put(text)

    monkeypatch.setattr(master_keeper.rospy, "logwarn", warn)
    monkeypatch.setattr(master_keeper, "register_again", register)
    slow.hang(1.0)
    assert "is silent" in said.get(timeout=LONG)
    assert "does not answer; waiting for its return" in said.get(timeout=LONG)
    slow.go_on()
    assert lost.get(timeout=LONG)
    assert "cannot register again, keeps trying" in said.get(timeout=LONG)
    assert "is back; this node is registered again" in said.get(timeout=LONG)
    assert attempts == [False, False]  # its own calls are made
    assert not master_link.lost.is_set()


def test_what_was_read_counts_until_the_parameters_are_restored(
    slow: SlowMaster, said: "queue.Queue[str]", monkeypatch: pytest.MonkeyPatch
) -> None:
    lost: List[bool] = []
    monkeypatch.setattr(KeptParameters, "restore", lambda *_: lost.append(master_link.lost.is_set()))
    monkeypatch.setattr(master_keeper, "register_again", lambda *_: lost.append(master_link.lost.is_set()))
    for _ in range(2):  # with the second question the first answer is known
        slow.questions.get(timeout=LONG)
    slow.hang(1.0)
    assert "is silent" in said.get(timeout=LONG)
    assert "does not answer; waiting for its return" in said.get(timeout=LONG)
    slow.process = 2
    slow.go_on()
    assert "was started anew; this node is registered again" in said.get(timeout=LONG)
    assert lost == [True, False]
