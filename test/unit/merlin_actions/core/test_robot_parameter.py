# SPDX-License-Identifier: Apache-2.0
"""What was written for one robot is that of one of several, where the domain says so."""

from typing import List

import pytest

from merlin_actions.actions.navigate import Navigate
from merlin_actions.core.application_check import ApplicationError, ApplicationWorld
from merlin_actions.core.robot_parameter import robot_parameter, with_robot
from merlin_actions.machine_survey import fitted
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_sm.states.function_state import FunctionState

ROBOT, PLACE = ("r", "waiter"), ("p", "place")
FACTS = {
    "robot_at": [ROBOT, PLACE],
    "free": [PLACE],
    "battery": [ROBOT],
    "near": [PLACE, ROBOT],
    "meet": [ROBOT, ("s", "robot"), PLACE],
}
PARENTS = {"waiter": "robot", "robot": "object", "place": "object"}


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("(robot_at anywhere)", "(robot_at ?bob anywhere)"),
        ("(not (robot_at ?from))", "(not (robot_at ?bob ?from))"),
        ("(Robot_At ?other anywhere)", "(Robot_At ?other anywhere)"),
        ("(near ?p)", "(near ?p ?bob)"),
        ("(free ?to)", "(free ?to)"),
        ("(decrease (battery) (* 0.1 #t))", "(decrease (battery ?bob) (* 0.1 #t))"),
        ("(meet ?s ?p)", "(meet ?s ?p)"),  # which of its robots is meant is not clear
        ("(unknown)", "(unknown)"),
        ("(robot_at", "(robot_at"),
    ],
)
def test_a_fact_gets_the_robot_that_the_domain_has(text: str, wanted: str) -> None:
    assert with_robot(text, "bob", FACTS, PARENTS) == wanted


def test_types_of_a_foreign_knowledge_base_that_form_a_ring_are_not_robots() -> None:
    assert robot_parameter("open", [PLACE], {"place": "object", "object": "place"}) == ""


class Serve(MerlinActionSM):
    parameters = ["t"]
    optional = ["b"]
    while_running = ["(battery)"]
    if_interrupted = ["(robot_at anywhere)"]
    if_stopped_at = ["(robot_at ?here)"]

    def build(self) -> None:
        self.add("A", FunctionState(lambda userdata: None, list(self.parameters)))


def world(*variables: str) -> ApplicationWorld:
    kinds = {"r": "waiter", "s": "robot"}
    parameters = [(name, kinds.get(name, "place")) for name in variables]
    return ApplicationWorld({"serve": parameters}, lambda kind: [], [], None, PARENTS, FACTS)


def test_the_class_of_one_robot_gets_the_parameter_and_the_facts_of_several() -> None:
    machine = fitted(Serve(), world("r", "b", "t"))
    assert isinstance(machine, Serve) and machine.operator_name() == "serve"
    assert (list(machine.parameters), machine.robot_parameter) == (["r", "b", "t"], "r")
    assert machine.while_running == ["(battery ?r)"]
    assert (machine.if_interrupted, machine.if_stopped_at) == (
        ["(robot_at ?r anywhere)"],
        ["(robot_at ?r ?here)"],
    )
    assert machine.run_once({"r": "bob", "b": "bar", "t": "table_1"}) == "succeeded"


def test_with_one_robot_it_is_what_was_written_and_stands_nowhere() -> None:
    machine = fitted(Serve(), world("t"))
    assert (list(machine.parameters), machine.robot_parameter) == (["t"], "")
    assert (machine.if_interrupted, machine.if_stopped_at) == (["(robot_at anywhere)"], [])


class ServeOne(Serve):
    operator = "serve"
    parameters = ["r", "t"]


def test_a_class_that_names_the_robot_itself_is_served_too() -> None:
    machine = fitted(ServeOne(), world("r", "t"))
    assert (list(machine.parameters), machine.robot_parameter) == (["r", "t"], "r")


@pytest.mark.parametrize("variables", [["r", "x"], ["r", "t", "x"], ["r", "s", "t"], []])
def test_what_does_not_fit_stays_for_the_check_to_name(variables: List[str]) -> None:
    machine = Serve()
    assert fitted(machine, world(*variables)) is machine


def test_a_machine_that_needs_nothing_is_the_same() -> None:
    machine = Navigate()
    parameters = [("from", "place"), ("to", "place")]
    there = ApplicationWorld({"navigate": parameters}, lambda kind: [], [], None, PARENTS, FACTS)
    assert fitted(machine, there) is machine


class Broken(Serve):
    operator = "serve"

    def build(self) -> None:
        if self.robot_parameter:
            raise ValueError("no such thing")
        super().build()


def test_one_that_cannot_be_made_for_several_is_named() -> None:
    with pytest.raises(ApplicationError, match=r"test_robot_parameter:Broken cannot be made: no such thing"):
        fitted(Broken(), world("r", "t"))
