"""The host refuses machines that do not fit the domain before any of them serves."""

from typing import Any, Dict, List

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_actions.nodes import fsm_host
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


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Dict[str, DomainFormula]:
    operators: Dict[str, DomainFormula] = {}
    knowledge: Any = type("Knowledge", (), {"operators": lambda self: operators})()
    monkeypatch.setattr(fsm_host, "knowledge_client", lambda name: knowledge)
    monkeypatch.setattr(fsm_host, "MerlinActionServer", Server)
    monkeypatch.setattr(fsm_host, "number", lambda name, default, least: default)
    return operators


def operator(*keys: str) -> DomainFormula:
    return DomainFormula(typed_parameters=[KeyValue(key, "table") for key in keys])


def make(machines: List[MerlinActionSM]) -> List[Any]:
    return fsm_host.make_servers(machines, "rosplan_knowledge_base")


def test_each_machine_gets_a_server(domain: Dict[str, DomainFormula]) -> None:
    domain["check_table"] = operator("t")
    machine = CheckTable()
    (server,) = make([machine])
    assert server.machine is machine


def test_an_operator_that_the_domain_does_not_have_is_named(domain: Dict[str, DomainFormula]) -> None:
    domain["navigate"] = operator("to")
    with pytest.raises(
        ValueError, match="CheckTable: the domain has no operator 'check_table', only navigate"
    ):
        make([CheckTable()])


def test_other_parameters_than_those_of_the_domain_are_refused(domain: Dict[str, DomainFormula]) -> None:
    domain["check_table"] = operator("t", "c")
    with pytest.raises(ValueError, match="declares the parameters"):
        make([CheckTable()])


def test_two_operators_with_one_ros_name_are_refused(domain: Dict[str, DomainFormula]) -> None:
    domain.update({"check_table": operator("t"), "check-table": operator("t")})
    with pytest.raises(ValueError, match="both map to actions/check_table"):
        make([CheckTable(), Look()])
