# SPDX-License-Identifier: Apache-2.0
"""What a launch file names as actions is made, or refused with what is wrong."""

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
