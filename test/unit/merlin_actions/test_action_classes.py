# SPDX-License-Identifier: Apache-2.0
"""What a launch file names as actions is made, or refused with what is wrong."""

from typing import Any

import pytest

import smach
from merlin_actions.action_classes import make_machines
from merlin_actions.actions.navigate import Navigate
from merlin_actions.core.names import by_ros_name
from merlin_actions.merlin_action_sm import MerlinActionSM


def test_each_class_is_made() -> None:
    (machine,) = make_machines(["merlin_actions.actions.navigate:Navigate"])
    assert isinstance(machine, Navigate)
    assert machine.operator_name() == "navigate"


@pytest.mark.parametrize(
    ("path", "why"),
    [
        ("merlin_actions.actions.navigate", "write package.module:Class"),
        ("merlin_actions.actions.fly:Fly", "No module named 'merlin_actions.actions.fly'"),
        ("merlin_actions.actions.navigate:Fly", "merlin_actions.actions.navigate has no Fly"),
        ("merlin_actions.core.names:ros_name", "is not a class"),
        ("threading:Thread", "is not a MerlinActionSM"),
        (":Navigate", "(?i)empty module name"),
    ],
)
def test_what_is_no_class_of_actions_is_refused(path: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        make_machines([path])


def test_a_class_that_stands_twice_is_refused() -> None:
    path = "merlin_actions.actions.navigate:Navigate"
    with pytest.raises(ValueError, match=f"{path} stands twice"):
        make_machines([path, path])


class Exits(MerlinActionSM):
    def build(self) -> None:
        raise SystemExit(0)


class ForgetsSuper(MerlinActionSM):
    def __init__(self) -> None:
        pass


@pytest.mark.parametrize(
    ("of", "why"),
    [(Exits, "SystemExit: 0"), (ForgetsSuper, r"its __init__ does not call super\(\).__init__\(\)")],
)
def test_a_class_that_ends_the_process_or_is_not_made_is_refused(of: type, why: str) -> None:
    with pytest.raises(ValueError, match=f"{of.__name__} cannot be made: {why}"):
        make_machines([f"{__name__}:{of.__name__}"])


@pytest.mark.parametrize("number", [0, 2.5, "2", None])
def test_a_number_of_runs_at_once_that_is_not_one_is_refused(
    number: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Navigate, "concurrent", number)
    with pytest.raises(ValueError, match=f"concurrent has to be a whole number from 1 on, not {number!r}"):
        make_machines(["merlin_actions.actions.navigate:Navigate"])


@pytest.mark.parametrize("name", ["parameters", "outcomes", "if_interrupted", "while_running"])
def test_a_text_where_a_list_belongs_is_named(name: str) -> None:
    of = type("Text", (MerlinActionSM,), {name: "(quiet)"})
    with pytest.raises(
        ValueError, match=rf"{name} is a text, where a list belongs: {name} = \['\(quiet\)'\]"
    ):
        of()


def test_a_module_that_ends_the_process_is_refused(tmp_path, monkeypatch) -> None:
    (tmp_path / "ends_at_import.py").write_text("raise SystemExit(0)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ValueError, match=r"SystemExit: 0 \(ends_at_import.py, line 1\)"):
        make_machines(["ends_at_import:Greet"])


def test_two_operators_of_one_ros_name_are_refused() -> None:
    assert by_ros_name(["check-table", "greet"]) == {"check_table": "check-table", "greet": "greet"}
    with pytest.raises(ValueError, match="'check-table' and 'Check_Table' both map to actions/check_table"):
        by_ros_name(["check-table", "Check_Table"])


class LeadsNowhere(MerlinActionSM):
    """A plain machine of SMACH in it has a mistake."""

    def build(self) -> None:
        inner = smach.StateMachine(["succeeded", "aborted", "preempted"])
        with inner:
            smach.StateMachine.add("A", self.state("wait", seconds=1.0), {"succeeded": "NOWHERE"})
        self.add("INNER", inner)


def test_a_machine_with_one_that_leads_nowhere_is_refused_when_it_is_made() -> None:
    with pytest.raises(smach.InvalidTransitionError, match="(?s)/INNER.*NOWHERE"):
        LeadsNowhere()
