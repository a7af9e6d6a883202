# SPDX-License-Identifier: Apache-2.0
"""One dispatched action: which execution a cancel stops, and that no cancel is lost whenever it arrives."""

from typing import List, Union

import pytest
from diagnostic_msgs.msg import KeyValue
from hypothesis import given
from hypothesis import strategies as st
from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_actions.action_classes import make_machines
from merlin_actions.core.ending import Closing, Ending, after_closing, closing_of
from merlin_actions.core.execution import Execution, Token, at_once
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_sm.states.function_state import FunctionState

PLACES = [KeyValue("a", "hall"), KeyValue("b", "kitchen")]


def dispatch(plan: int = 1, action: int = 2, places: List[KeyValue] = PLACES) -> ActionDispatch:
    return ActionDispatch(plan_id=plan, action_id=action, name="drive", parameters=places)


def test_it_is_shown_as_pddl() -> None:
    execution = Execution(dispatch(), PLACES)
    assert execution.text == "(drive hall kitchen)"
    assert execution.binding == {"a": "hall", "b": "kitchen"}
    assert execution.key == (1, 2)


def test_executions_of_one_action_have_different_tokens() -> None:
    assert Execution(dispatch(), PLACES).token != Execution(dispatch(), PLACES).token


def test_a_token_names_plan_action_and_life() -> None:
    execution = Execution(dispatch(), PLACES, "a1b2")
    token = Token.read(execution.token)
    assert (token.key, token.life) == ((1, 2), "a1b2")
    assert str(token) == execution.token


@pytest.mark.parametrize("text", ["", "other", "robot/1/a1b2/3", "1", "1/x/a1b2/3", "-1/2/a1b2/3"])
def test_a_token_of_another_program_names_no_action(text: str) -> None:
    assert Token.read(text).key is None


@pytest.mark.parametrize(
    ("cancel", "meant"),
    [
        (dispatch(), True),
        (dispatch(plan=2), False),
        (dispatch(action=3), False),
        (dispatch(places=PLACES[:1]), False),
        (dispatch(places=[PLACES[0], KeyValue("b", "bathroom")]), False),
    ],
)
def test_a_cancel_means_an_execution_by_ids_and_parameters(cancel: ActionDispatch, meant: bool) -> None:
    assert Execution(dispatch(), PLACES).matches(cancel) == meant


@given(st.lists(st.sampled_from(["announce", "withdraw", "cancel"]), max_size=8))
def test_a_cancel_reaches_whatever_is_announced_before_or_after_it(events: List[str]) -> None:
    execution = Execution(dispatch(), PLACES)
    announced: List[List[int]] = []
    active = False
    cancelled = False
    for event in events:
        if event == "announce":
            calls: List[int] = []
            announced.append(calls)
            execution.interruptible(lambda calls=calls: calls.append(1))
            active = True
            assert bool(calls) == cancelled, "one that came before is passed on at once"
        elif event == "withdraw":
            execution.interruptible(None)
            active = False
        else:
            before = len(announced[-1]) if announced else 0
            execution.cancel(f"reason {cancelled}")
            cancelled = True
            if announced:
                assert len(announced[-1]) == before + active
    assert execution.cancelled.is_set() == cancelled
    assert execution.cancel_reason == ("reason False" if cancelled else "cancelled"), (
        "the first reason counts"
    )


class OrderToBarman(MerlinActionSM):
    parameters = ["t"]

    def build(self) -> None:
        self.add("NOTE", FunctionState(self._note, ["t"]))

    def _note(self, userdata: object) -> None:
        if userdata.t == "table_9":
            raise ValueError("there is no such table")


def test_a_machine_runs_with_its_parameters_and_gives_a_reason() -> None:
    machine = OrderToBarman()
    assert machine.operator_name() == "order_to_barman"
    assert machine.run_once({"t": "table_1"}) == "succeeded"
    assert machine.run_once({"t": "table_9"}) == "aborted"
    assert machine.reason == "there is no such table"


def test_a_machine_that_is_cancelled_before_it_runs_does_nothing() -> None:
    machine = OrderToBarman()
    machine.prepare()
    machine.cancel()
    assert machine.run_once({"t": "table_9"}) == "preempted"


def test_a_machine_whose_parameters_are_not_those_of_the_domain_is_refused() -> None:
    OrderToBarman().check_signature(["t"])
    with pytest.raises(ValueError, match=r"declares the parameters \['t'\], but operator order_to_barman"):
        OrderToBarman().check_signature(["t", "i"])


def test_an_action_without_states_is_refused_when_it_is_made() -> None:
    class Nothing(MerlinActionSM):
        pass

    with pytest.raises(NotImplementedError, match="Nothing has to implement build"):
        Nothing()
    assert make_machines([]) == []


def test_a_token_tells_the_life_that_has_begun_it() -> None:
    token = Token.read("3/1/life_1/7")
    assert (token.key, token.life, token.number) == ((3, 1), "life_1", "7")
    assert token.left_by_earlier("life_2") and not token.left_by_earlier("life_1")
    for text in ("of another program", "3/1", "a/b/life_1/7"):
        other = Token.read(text)
        assert not (other.key and other.life) and not other.left_by_earlier("life_2")


@pytest.mark.parametrize("said, limit", [(False, 1), (True, 0), (1, 1), (3, 3), (0, 1)])
def test_a_class_says_how_many_run_at_once(said: Union[bool, int], limit: int) -> None:
    assert at_once(said) == limit


@given(st.builds(Ending, st.booleans(), st.text(max_size=3), st.booleans(), st.text(max_size=3)))
def test_effects_count_only_when_they_came_true(ending: Ending) -> None:
    closing = closing_of(ending)
    assert (closing is Closing.END) == ending.succeeded
    assert (closing is Closing.ROLLBACK) == (not ending.succeeded and not ending.begun)
    failed = after_closing(ending, "the disk is full")
    assert not failed.succeeded and "the disk is full" in failed.reason
    assert failed.unstopped == ending.unstopped
