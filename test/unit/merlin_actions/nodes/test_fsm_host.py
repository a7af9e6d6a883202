# SPDX-License-Identifier: Apache-2.0
"""The host refuses machines that do not fit the domain before any of them serves."""

from pathlib import Path
from typing import List
from unittest import mock

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions.core.application_check import ApplicationWorld
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_actions.nodes import fsm_host
from merlin_planning import knowledge_client
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states import action_state
from merlin_sm.states.function_state import FunctionState


class CheckTable(MerlinActionSM):
    parameters = ["t"]

    def build(self) -> None:
        self.add("LOOK", FunctionState(lambda userdata: None))


class Look(CheckTable):
    operator = "check-table"


class Server:
    """What would serve a machine."""

    def __init__(self, machine: MerlinActionSM, cancel_limit: float) -> None:
        self.machine, self.cancel_limit = machine, cancel_limit
        self.operator = machine.operator_name()
        self.running = False

    def renew(self, machine: MerlinActionSM) -> bool:
        self.machine = machine
        return self.running


@pytest.fixture(autouse=True)
def without_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fsm_host, "MerlinActionServer", Server)
    monkeypatch.setattr(fsm_host, "number", lambda name, default, least: default)


def test_each_machine_gets_a_server() -> None:
    machine = CheckTable()
    (server,) = fsm_host.make_servers([machine])
    assert server.machine is machine


def test_two_operators_with_one_ros_name_are_refused() -> None:
    with pytest.raises(ValueError, match="both map to actions/check_table"):
        fsm_host.make_servers([CheckTable(), Look()])


def test_machines_that_do_not_fit_the_domain_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    operators = {
        "check_table": DomainFormula(typed_parameters=[KeyValue("t", "table"), KeyValue("c", "cup")])
    }
    fields = {
        "operators": lambda self: operators,
        "instances": lambda self, kind: [],
        "types": lambda self: {},
        "predicates": lambda self: {},
        "function_signatures": lambda self: {},
        "name": "/kb",
    }
    monkeypatch.setattr(fsm_host, "knowledge_client", lambda name: type("Knowledge", (), fields)())
    for module in (fsm_host, knowledge_client):
        monkeypatch.setattr(module, "get_param", lambda name, default: default)
    world = fsm_host.read_world("rosplan_knowledge_base")
    with pytest.raises(ValueError, match="CheckTable"):
        fsm_host.check_machines([CheckTable()], world, complete=False)


class Greet(CheckTable):
    parameters = ["p"]
    if_interrupted = ["(robot_at anywere)"]


def test_declared_effects_are_compared_with_the_file_of_the_domain(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    domain = tmp_path / "domain.pddl"
    domain.write_text(
        "(define (domain d) (:constants anywhere) (:predicates (robot_at ?p))"
        " (:action greet :parameters (?p) :effect (robot_at ?p)))"
    )
    fields = {
        "operators": lambda self: {"greet": DomainFormula(typed_parameters=[KeyValue("p", "object")])},
        "instances": lambda self, kind, **options: [],
        "types": lambda self: {},
        "predicates": lambda self: {},
        "function_signatures": lambda self: {},
        "name": "/kb",
    }
    monkeypatch.setattr(fsm_host, "knowledge_client", lambda name: type("Knowledge", (), fields)())
    params = {"/kb/domain_path": str(domain)}
    for module in (fsm_host, knowledge_client):
        monkeypatch.setattr(module, "get_param", lambda name, default: params.get(name, default))
    with pytest.raises(ValueError, match=r"Greet declares '\(robot_at anywere\)': unknown object"):
        fsm_host.check_machines([Greet()], fsm_host.read_world("kb"), complete=False)


WORLD = ApplicationWorld(
    {"check_table": [("r", "robot"), ("t", "table")]}, lambda kind: [], [], parents={"robot": "object"}
)


@pytest.fixture
def host(monkeypatch: pytest.MonkeyPatch) -> fsm_host.MachineHost:
    monkeypatch.setattr(fsm_host.rospy, "get_param", lambda name, default: default)
    monkeypatch.setattr(fsm_host, "read_machines", lambda: [CheckTable()])
    monkeypatch.setattr(fsm_host, "wait_for_knowledge_base", lambda name, timeout: None)
    monkeypatch.setattr(fsm_host, "read_world", lambda name: WORLD)
    monkeypatch.setattr(fsm_host, "check_machines", lambda *_: {})
    return fsm_host.MachineHost()


def test_a_class_for_one_robot_serves_an_operator_of_several(host: fsm_host.MachineHost) -> None:
    (server,) = host.servers
    assert list(server.machine.parameters) == ["r", "t"]
    host.reload()
    assert list(server.machine.parameters) == ["r", "t"] and server.operator == "check_table"


def test_a_reload_gives_each_server_a_new_machine(host: fsm_host.MachineHost) -> None:
    (server,) = host.servers
    old = server.machine
    assert host.reload() == "reloaded check_table; edited: nothing"
    assert server.machine is not old
    server.running = True
    assert "check_table runs, and is the edited one from its next run on" in host.reload()


def test_a_reload_of_wrong_classes_changes_nothing(
    host: fsm_host.MachineHost, monkeypatch: pytest.MonkeyPatch
) -> None:
    (server,) = host.servers
    old = server.machine

    def refuse(*_: object) -> None:
        MerlinStateFactory.register("speak", CheckTable)  # as the application's modules do
        raise ValueError("it does not fit")

    monkeypatch.setattr(fsm_host, "check_machines", refuse)
    with pytest.raises(ValueError, match="does not fit"):
        host.reload()
    assert server.machine is old
    assert MerlinStateFactory.maker("speak") is not CheckTable
    with pytest.raises(ValueError, match="registered already"):
        MerlinStateFactory.register("speak", CheckTable)


def test_a_reload_cannot_serve_other_operators(
    host: fsm_host.MachineHost, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fsm_host, "read_machines", lambda: [Look()])
    with pytest.raises(ValueError, match="the classes are for check-table, but check_table are served"):
        host.reload()


class Client:
    """Takes the place of an action client."""

    ended: List[str] = []

    def __init__(self, name: str, spec: type) -> None:
        self.name, self.action_spec = name, spec

    def shutdown(self) -> None:
        self.ended.append(self.name)


class Drive(MerlinActionSM):
    parameters = ["p"]

    def build(self) -> None:
        self.add("DRIVE", self.state("navigation", "hall"), {"succeeded": "SAY"})
        self.add("SAY", self.state("speak", "here"))


class Ring(MerlinActionSM):
    parameters = ["p"]
    said = "speak"

    def build(self) -> None:
        self.add("SAY", self.state(self.said, "ring"))


class Lift(Ring):
    operator, said = "ring", "pick"


@pytest.mark.parametrize(("robot", "ended"), [("", ["move_base"]), ("ann", [])])
def test_a_host_keeps_no_clients_of_machines_that_it_does_not_serve(
    monkeypatch: pytest.MonkeyPatch, robot: str, ended: List[str]
) -> None:
    classes = [Drive, Ring]
    params = {"~robot": robot, "~robots": True}
    world = ApplicationWorld(
        {"drive": [("r", "robot"), ("p", "place")], "ring": [("p", "place")]}, lambda kind: [], []
    )
    monkeypatch.setattr(Client, "ended", [])
    monkeypatch.setattr(action_state, "ActionClient", Client)
    monkeypatch.setattr(action_state, "shared_guard_watch", lambda: None)
    monkeypatch.setattr(action_state.rospy, "resolve_name", str)
    monkeypatch.setattr(fsm_host.rospy, "get_param", lambda name, default: params.get(name, default))
    monkeypatch.setattr(fsm_host, "flag", lambda name: bool(params.get(name)))
    monkeypatch.setattr(fsm_host, "RobotPresence", mock.Mock())
    monkeypatch.setattr(fsm_host, "read_machines", lambda: [each() for each in classes])
    monkeypatch.setattr(fsm_host, "wait_for_knowledge_base", lambda name, timeout: None)
    monkeypatch.setattr(fsm_host, "read_world", lambda name: world)
    monkeypatch.setattr(fsm_host, "check_machines", lambda *_: {"drive": "r"})
    host = fsm_host.MachineHost()
    assert Client.ended == ended
    if not robot:
        classes[1] = Lift
        assert host.reload() == "reloaded ring; edited: nothing"
        assert sorted(Client.ended) == ["move_base", "move_base", "sound_play"]
        del classes[1]
        host.servers.clear()
        assert host.reload() == "the robots have all actions; edited: nothing"
    del host
    action_state.end_unused_clients()  # the next test makes its own
