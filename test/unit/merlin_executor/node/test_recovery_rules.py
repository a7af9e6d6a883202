# SPDX-License-Identifier: Apache-2.0
"""Remains are settled, actions that did not stop are reported, and two executors are noticed."""

from typing import Dict, List, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from merlin_msgs.msg import ExecuteResult

from merlin_executor.core.outcome import Outcome, Verdict, crashed, outcome_name
from merlin_executor.core.request_limits import MAX_GOALS, MAX_TEXT, MAX_TOKENS, RequestTooLarge, check_size
from merlin_executor.core.standstill import Halt, still_moving, together, unstopped
from merlin_executor.mission.mission_pause import PauseSwitch
from merlin_executor.node.executor_node import must_yield, other_executors
from merlin_executor.node.recovery import ATTEMPTS, BRIDGE_GRACE, Leftovers


def constants(message_class: type) -> Dict[str, int]:
    return {name: getattr(message_class, name) for name in dir(message_class) if name.isupper()}


def test_the_numbers_are_those_of_the_messages() -> None:
    assert {outcome.name: int(outcome) for outcome in Outcome} == constants(ExecuteResult)


def test_names_of_outcomes() -> None:
    assert outcome_name(2) == "CANCELLED"
    assert outcome_name(77) == "77"


def test_a_crash_is_reported_in_one_line() -> None:
    verdict = crashed(RecursionError("maximum recursion depth exceeded"))
    assert verdict.outcome is Outcome.INTERNAL and verdict.outcome.of_software
    assert "RecursionError: maximum recursion depth exceeded" in verdict.reason
    assert len(crashed(ValueError("x" * 100000)).reason) < 1000


# --- executions that are open ---------------------------------------------------------------------------


def test_bridges_have_time_to_settle_their_own() -> None:
    leftovers = Leftovers()
    assert leftovers.look(10.0, ["a"]).wait == pytest.approx(BRIDGE_GRACE)
    assert not leftovers.look(10.0 + BRIDGE_GRACE - 0.1, ["a"]).settle
    assert leftovers.look(10.2, []).done


def test_what_no_bridge_settles_is_settled() -> None:
    leftovers = Leftovers()
    leftovers.look(0.0, ["a", "b"])
    look = leftovers.look(BRIDGE_GRACE, ["b"])
    assert look.settle == ["b"] and not look.done
    assert leftovers.look(BRIDGE_GRACE, []).done


def test_what_cannot_be_settled_is_given_up_and_named() -> None:
    leftovers = Leftovers()
    leftovers.look(0.0, ["a"])
    for _ in range(ATTEMPTS):
        assert leftovers.look(BRIDGE_GRACE, ["a"]).settle == ["a"]
    look = leftovers.look(BRIDGE_GRACE, ["a"])
    assert look.done and look.stuck == ["a"]


def test_one_that_was_closed_and_opened_again_has_its_time_again() -> None:
    leftovers = Leftovers()
    leftovers.look(0.0, ["a"])
    leftovers.look(1.0, [])
    assert leftovers.look(BRIDGE_GRACE, ["a"]).wait == pytest.approx(BRIDGE_GRACE)


@given(st.lists(st.sets(st.sampled_from("abc")), max_size=30), st.floats(0.1, 3.0))
def test_a_recovery_ends(looks: List[set], step: float) -> None:
    """Whatever is open at each look, in bounded time there is nothing to wait for."""
    leftovers = Leftovers()
    now = 0.0
    for open_tokens in looks:
        now += step
        look = leftovers.look(now, sorted(open_tokens))
        assert set(look.settle) | set(look.stuck) <= open_tokens
        assert 0.0 <= look.wait <= BRIDGE_GRACE
    for _ in range(ATTEMPTS * 3 + 1):
        now += BRIDGE_GRACE
        if leftovers.look(now, ["a", "b", "c"]).done:
            return
    raise AssertionError("it never ends")


# --- what did not stop ----------------------------------------------------------------------------------

HALTED = Halt(True, True)
NO_GUARD = Halt(False)
DEAF = Halt(True, False, "its node does not run")


@pytest.mark.parametrize(
    ("halt", "words"),
    [
        (HALTED, "the guard has halted the base"),
        (NO_GUARD, "no guard runs that could halt the base"),
        (DEAF, "the guard could not halt the base: its node does not run"),
        (Halt(True), "the guard could not halt the base: it gave no reason"),
    ],
)
def test_what_did_not_stop_is_named_and_what_the_guard_did(halt: Halt, words: str) -> None:
    verdict = unstopped(["(navigate a b)", "(wave)"], halt)
    assert verdict.outcome is Outcome.CANCEL_TIMEOUT
    assert verdict.reason == f"(navigate a b), (wave) did not stop; {words}"
    assert verdict.action == "(navigate a b), (wave)"


def test_why_it_had_to_stop_is_reported_too() -> None:
    assert unstopped(["(wave)"], HALTED, "(ask): no voice").reason.startswith(
        "(ask): no voice; (wave) did not"
    )
    reported = "(wave) did not stop: the planning system's plan dispatcher /d did not end its plan within 5 s"
    assert unstopped(["(wave)"], HALTED, reported).reason == f"{reported}; the guard has halted the base"


@pytest.mark.parametrize("why", ["", "(ask): no voice"])
def test_the_server_that_does_not_stop_is_named(why: str) -> None:
    server = "/move_base did not stop when navigate was cancelled"
    verdict = unstopped(["(navigate a b)"], HALTED, why, server)
    words = f"(navigate a b) did not stop: {server}"
    assert verdict.reason == f"{why}{'; ' * bool(why)}{words}; the guard has halted the base"


def test_a_cancel_is_not_complete_while_the_base_moves() -> None:
    verdict = still_moving(Verdict(Outcome.CANCELLED, "cancelled"), HALTED)
    assert verdict.outcome is Outcome.CANCEL_TIMEOUT
    assert "the base still moves" in verdict.reason


def test_a_failure_stays_the_failure_that_it_was() -> None:
    verdict = still_moving(Verdict(Outcome.ACTION_FAILED, "blocked", "(navigate a b)"), NO_GUARD)
    assert verdict.outcome is Outcome.ACTION_FAILED and verdict.action == "(navigate a b)"
    assert verdict.reason.startswith("blocked; the base still moves, no guard")


# --- two executors --------------------------------------------------------------------------------------

TOPIC = "/d/action_dispatch"
STATE = [
    [
        [TOPIC, ["/planning_system", "/a", "/b"]],
        ["/merlin/status", ["/a"]],
        ["/other/merlin/status", ["/far"]],
        ["/other/d/action_dispatch", ["/far"]],
    ],
    [],
    [],
]
TYPES = {"/merlin/status": "merlin_msgs/ExecutorStatus", "/other/merlin/status": "merlin_msgs/ExecutorStatus"}


def test_only_an_executor_that_serves_on_the_same_dispatcher_is_a_rival() -> None:
    publishers = dict(STATE[0])
    assert other_executors("/b", TOPIC, publishers, TYPES) == ["/a"]
    assert other_executors("/a", TOPIC, publishers, TYPES) == []  # itself; /b does not serve yet
    assert other_executors("/c", "/elsewhere", publishers, TYPES) == []


def test_of_two_that_begin_at_once_one_stays() -> None:
    assert must_yield("/b", ["/a"]) and not must_yield("/a", ["/b"])
    assert not must_yield("/a", [])


# --- size -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("texts", "items", "tokens", "what"),
    [
        (["(a)"] * (MAX_GOALS + 1), 0, 0, "1001 goals"),
        ((), MAX_GOALS + 1, 0, "1001 goals"),
        (["(a)"], MAX_GOALS, 0, "1001 goals"),
        (["(a)" + " " * MAX_TEXT], 0, 0, "65539 characters"),
        ((), 1, MAX_TOKENS + 1, "1001 tokens"),
    ],
)
def test_a_request_beyond_a_limit_is_refused(texts: List[str], items: int, tokens: int, what: str) -> None:
    assert what in too_large(texts, items, tokens)


def test_what_a_request_does_not_have_leaves_no_room_for_more() -> None:
    with pytest.raises(RequestTooLarge, match="1001 goals"):
        check_size(["(a)"] * (MAX_GOALS + 1))
    with pytest.raises(RequestTooLarge, match="1001 goals"):
        check_size((), MAX_GOALS + 1)


def test_a_request_at_the_limits_is_taken() -> None:
    assert too_large(["(a)"] * MAX_GOALS, 0, MAX_TOKENS) == ""
    assert too_large([" " * MAX_TEXT], MAX_GOALS - 1) == ""


def too_large(texts: Sequence[str], items: int = 0, tokens: int = 0) -> str:
    """The limit that a request exceeds, in words; empty: none."""
    try:
        check_size(texts, items, tokens)
    except RequestTooLarge as error:
        return str(error)
    return ""


# --- missions -------------------------------------------------------------------------------------------


def test_a_switch_answers_what_makes_no_sense() -> None:
    switch = PauseSwitch()
    assert switch.set(True) == (False, "The mission has ended.")
    switch.begin()
    assert switch.set(False) == (False, "The mission is not paused.")
    assert switch.set(True)[0] and switch.paused
    assert switch.set(True) == (False, "The mission is paused already.")
    assert switch.set(False)[0] and not switch.paused
    switch.end()
    assert not switch.set(True)[0]


def test_a_mission_that_pauses_itself_ends_no_pause_that_an_operator_wants() -> None:
    switch = PauseSwitch()
    switch.begin()
    assert switch.set(True, asked=False)[0]
    assert switch.set(True) == (True, "Paused: no further goal is sent.")
    assert not switch.set(False, asked=False)[0] and switch.paused
    assert switch.set(False)[0] and not switch.paused
    assert switch.set(True, asked=False)[0]
    assert switch.set(False, asked=False)[0] and not switch.paused


def test_several_bases_stand_when_all_that_have_a_guard_were_halted() -> None:
    none, halted, failed = Halt(False), Halt(True, True), Halt(True, False, "no")
    assert together([none, none]) == none
    assert together([none, halted, halted]) == halted
    assert together([halted, failed]) == failed
