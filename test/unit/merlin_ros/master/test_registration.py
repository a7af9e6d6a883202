# SPDX-License-Identifier: Apache-2.0
"""What a new master gets back, though a part of it cannot be sent or a node does not answer."""

import xmlrpc.client
from types import SimpleNamespace
from typing import Any, Dict, List, Tuple
from xml.parsers.expat import ExpatError

import pytest
import rospy

from merlin_ros.master import foreign_nodes, master_keeper, master_link, registration
from merlin_ros.master.foreign_nodes import ForeignNodes
from merlin_ros.master.registration import KeptParameters, RegistrationError


class Master:
    """A new master; XML-RPC between it and the test is real as far as values are concerned."""

    def __init__(self) -> None:
        self.parameters: Dict[str, Any] = {}
        self.registered: List[Tuple[str, str]] = []
        self.handle = self
        self.silent_after = -1  # registrations; then it does not answer

    def hasParam(self, name: str) -> bool:
        return name in self.parameters

    def setParam(self, name: str, value: Any) -> None:
        text = xmlrpc.client.dumps((name, value)).encode("utf-8", "xmlcharrefreplace")
        try:
            (_, self.parameters[name]), _ = xmlrpc.client.loads(text)
        except ExpatError as error:
            raise xmlrpc.client.Fault(1, str(error)) from error

    def _register(self, name: str, thing: str, *_: str) -> Tuple[int, str, List[str]]:
        self.silent_after -= 1
        if self.silent_after == -1:
            raise OSError("the master does not answer")
        self.registered.append((name, thing))
        return 1, "", ["http://publisher"]

    registerPublisher = registerSubscriber = registerService = _register

    def getSystemState(self) -> List[List[Tuple[str, List[str]]]]:
        return [[(thing, [name]) for name, thing in self.registered], [], []]


@pytest.fixture
def errors(monkeypatch: pytest.MonkeyPatch) -> List[str]:
    """What is logged."""
    logged: List[str] = []
    for module in (registration, master_keeper):
        monkeypatch.setattr(module.rospy, "logerr", logged.append)
        monkeypatch.setattr(module.rospy, "logwarn", lambda text: None)
    return logged


@pytest.mark.parametrize("value", [2**31, None, "caf\udce9", "a\x00b", object()])
def test_a_value_that_cannot_be_sent_keeps_no_other_parameter(
    monkeypatch: pytest.MonkeyPatch, errors: List[str], value: Any
) -> None:
    known = {"/a": 1, "/bad": {"part": value, "good": 2}, "/z": 3}
    monkeypatch.setattr(master_link, "known_params", lambda: known)
    master = Master()
    KeptParameters().restore(master)  # type: ignore[arg-type]
    assert master.parameters == {"/a": 1, "/bad/good": 2, "/z": 3}
    assert len(errors) == 1 and "/bad/part" in errors[0]


class Nodes:
    """Nodes of others."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
        self.names = names
        self.hanging: List[str] = []  # in the next calls that say which publishers there are
        self.odd: List[str] = []  # that answer something else
        self.gone: List[str] = []
        self.silent: List[str] = []  # in the next calls that ask what they have
        self.faulty: List[str] = []  # whose code raises when it gets publishers
        self.known: Dict[str, str] = {}
        monkeypatch.setattr(rospy, "get_name", lambda: "/me")
        monkeypatch.setattr(foreign_nodes.master_link, "ask_each", lambda master, call, names: self.known)
        for module in (foreign_nodes, registration):
            monkeypatch.setattr(module.master_link, "bounded_proxy", lambda uri, limit: self._node(uri))
        self.foreign = ForeignNodes()
        self.known = {name: name for name in names}
        self.foreign.look(SimpleNamespace(getSystemState=lambda: [[], [], []]))  # type: ignore[arg-type]
        self.known = {}

    def _node(self, name: str) -> Any:
        def topics(_: str) -> Tuple[int, str, Any]:
            if name in self.gone:
                raise ConnectionRefusedError("it has ended")
            if name in self.silent:
                self.silent.remove(name)
                raise master_link.MasterSilent("it did not answer within 2 s")
            return (1, "", "none") if name in self.odd else (1, "", [[f"{name}/a", "T"], [f"{name}/b", "T"]])

        def update(*_: Any) -> None:
            if name in self.faulty:
                raise xmlrpc.client.Fault(1, "no such method")
            if name in self.hanging:
                self.hanging.remove(name)
                raise OSError("it hangs")

        return SimpleNamespace(getPublications=topics, getSubscriptions=topics, publisherUpdate=update)

    def restore(self, master: Master) -> List[str]:
        return self.foreign.restore(master, lambda: True)  # type: ignore[arg-type]


def topics(master: Master, name: str) -> List[str]:
    return [thing for node, thing in master.registered if node == name]


def test_a_node_that_has_only_asked_the_new_master_for_a_parameter_is_registered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nodes, master = Nodes(monkeypatch, "/logs"), Master()
    nodes.known = {"/logs": "/logs"}  # rospy asks with each line that it logs
    assert nodes.restore(master) == ["/logs"]
    assert nodes.restore(master) == []


def test_a_node_that_is_registered_in_part_is_registered_again_and_keeps_no_other_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nodes, master = Nodes(monkeypatch, "/one", "/two"), Master()
    nodes.hanging = ["/one"]
    with pytest.raises(RegistrationError, match="/one does not take the publishers of /one/a"):
        nodes.restore(master)
    assert len(topics(master, "/one")) == 3 and len(topics(master, "/two")) == 4
    assert nodes.restore(master) == ["/one"]
    assert len(topics(master, "/one")) == 7 and len(topics(master, "/two")) == 4
    assert nodes.restore(master) == []


def test_a_node_is_registered_again_when_the_master_fell_silent_within(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nodes, master = Nodes(monkeypatch, "/one", "/two"), Master()
    master.silent_after = 2
    with pytest.raises(OSError, match="does not answer"):
        nodes.restore(master)
    assert nodes.restore(master) == ["/one", "/two"]
    assert set(topics(master, "/one")) == {"/one/a", "/one/b"}


def test_a_node_that_has_ended_meanwhile_is_not_tried_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    nodes, master = Nodes(monkeypatch, "/one"), Master()
    nodes.hanging = ["/one"]
    with pytest.raises(RegistrationError):
        nodes.restore(master)
    nodes.gone = ["/one"]
    assert nodes.restore(master) == []


def test_a_node_that_did_not_answer_in_time_is_asked_once_more_and_keeps_no_other_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The whole machine may have stalled, or the node may have waited for its processor."""
    nodes, master = Nodes(monkeypatch, "/hung", "/slow", "/two"), Master()
    nodes.silent = ["/hung", "/slow", "/hung"]
    with pytest.raises(RegistrationError, match="/slow does not answer"):
        nodes.restore(master)
    assert topics(master, "/two")
    assert nodes.restore(master) == ["/slow"]


def test_a_node_that_answers_something_else_keeps_no_other_one(monkeypatch: pytest.MonkeyPatch) -> None:
    nodes, master = Nodes(monkeypatch, "/odd", "/two"), Master()
    nodes.odd = ["/odd"]
    assert nodes.restore(master) == ["/two"]


def test_a_node_that_answers_publishers_with_a_fault_keeps_no_other_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nodes, master = Nodes(monkeypatch, "/faulty", "/two"), Master()
    nodes.faulty = ["/faulty"]
    with pytest.raises(RegistrationError, match="/faulty does not take the publishers of /faulty/a"):
        nodes.restore(master)
    assert len(topics(master, "/two")) == 4
