"""The host refuses machines that do not fit the domain before any of them serves."""

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
    fields = {"operators": lambda self: operators, "instances": lambda self, kind: []}
    monkeypatch.setattr(fsm_host, "knowledge_client", lambda name: type("Knowledge", (), fields)())
    monkeypatch.setattr(fsm_host, "get_param", lambda name, default: default)
    with pytest.raises(ValueError, match="CheckTable"):
        fsm_host.check_machines([CheckTable()], "rosplan_knowledge_base", complete=False)
