# SPDX-License-Identifier: Apache-2.0
"""A state whose function reads userdata that it does not list, or cannot be called, is refused when made."""

from typing import Any, Callable

import pytest
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from std_msgs.msg import String
from std_srvs.srv import Empty

from merlin_executor.mission.goal_state import GoalState
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states.action_state import ActionState
from merlin_sm.states.dialogue import AskSM
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.knowledge import KnowledgeState
from merlin_sm.states.merlin_state import MerlinState
from merlin_sm.states.recognition import RecognizeState
from merlin_sm.states.ros_calls import ServiceCallState, TopicState
from merlin_sm.states.speech import SpeakState
from merlin_sm.states.text_keys import keys_read


class Machine:
    def decide(self, userdata: Any) -> str:
        userdata.seen = userdata["heard"]
        return "yes" if userdata.heard else "no"


def forwards(userdata: Any) -> None:
    print(userdata)


def another(userdata: Any) -> Any:
    userdata = Machine()
    return userdata.decide


@pytest.mark.parametrize(
    ("function", "keys"),
    [
        (Machine().decide, ["heard"]),
        (lambda userdata: userdata.a + userdata.b, ["a", "b"]),
        (lambda _: "succeeded", []),
        (forwards, []),
        (another, []),
        (print, []),
        (lambda: None, []),
    ],
)
def test_the_keys_that_a_function_reads(function: Callable[..., Any], keys: list) -> None:
    assert keys_read(function) == keys


def test_a_key_that_is_not_listed_is_named() -> None:
    with pytest.raises(ValueError, match="decide, line 2.*'heard', .* the inputs of its state: x"):
        FunctionState(Machine().decide, ["x"], ["seen"])
    FunctionState(Machine().decide, ["heard"], ["seen"])


def two(userdata: Any, more: Any) -> None:
    pass


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: FunctionState(two), "two, line .*, cannot be called with userdata: missing .*'more'"),
        (lambda: FunctionState(lambda: None), "<lambda>, .* cannot be called with userdata: too many"),
        (lambda: FunctionState(None), "None is not a function"),
        (lambda: TopicState("said", String, True), "True, for the message, is not a function"),
        (
            lambda: ActionState("drive", MoveBaseAction, MoveBaseGoal(), on_result="done"),
            "'done', for the result, is not a function",
        ),
        (lambda: GoalState(two), "two, .* cannot be called with userdata: missing"),
        (lambda: ServiceCallState("clear", Empty, two), "two, .* cannot be called with userdata: missing"),
        (
            lambda: ServiceCallState("clear", Empty, on_response=lambda userdata: None),
            "<lambda>, .* cannot be called with userdata and response: too many",
        ),
        (lambda: TopicState("said", String, Machine().decide), "decide, .* with userdata and message"),
        (
            lambda: ActionState("drive", MoveBaseAction, lambda: MoveBaseGoal()),
            "<lambda>, .* cannot be called with userdata: too many",
        ),
        (
            lambda: ActionState("drive", MoveBaseAction, MoveBaseGoal(), on_result=lambda result: None),
            "<lambda>, .* cannot be called with userdata and result: too many",
        ),
    ],
)
def test_a_function_with_other_parameters_is_named(make: Callable[[], Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        make()


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: MerlinState("done"), "outcomes"),
        (lambda: MerlinState(input_keys="done"), "input_keys"),
        (lambda: MerlinState(output_keys="done"), "output_keys"),
        (lambda: MerlinSM("done"), "outcomes"),
        (lambda: MerlinSM(["succeeded"], "done"), "input_keys"),
        (lambda: MerlinSM(["succeeded"], [], "done"), "output_keys"),
        (lambda: FunctionState(print, "done"), "inputs"),
        (lambda: FunctionState(Machine().decide, ["heard"], "done"), "outputs"),
        (lambda: FunctionState(print, [], [], "done"), "outcomes"),
        (lambda: TopicState("said", String, outcomes="done"), "outcomes"),
        (lambda: SpeakState("It is {done}.", "done"), "keys"),
        (lambda: AskSM("Is it {done}?", "", "done"), "keys"),
        (lambda: KnowledgeState("done"), "add"),
        (lambda: KnowledgeState(remove="done"), "remove"),
        (lambda: RecognizeState("done"), "classes"),
        (lambda: RecognizeState(["cup"], input_keys="done"), "input_keys"),
    ],
)
def test_a_text_where_a_list_belongs_is_named(make: Callable[[], Any], name: str) -> None:
    with pytest.raises(ValueError, match=rf"{name} is a text, where a list belongs: {name} = \['done'\]"):
        make()
