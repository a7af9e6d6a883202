# SPDX-License-Identifier: Apache-2.0
"""Ready states that need no robot: functions, dialogues and states that watch each other."""

import threading
from typing import Any, List

import pytest

from merlin_planning.dispatch_progress import DispatchResult
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states import dialogue
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.merlin_state import PREEMPTED, SUCCEEDED, MerlinState
from merlin_sm.states.planning import DispatchPlanState
from merlin_sm.states.while_state import WhileSM
from merlin_test import LONG
from smach import InvalidTransitionError, UserData


def refuse(userdata: Any) -> None:
    raise ValueError("the tray is full")


def run(state: Any, **given: Any) -> str:
    machine = MerlinSM(
        [*state.get_registered_outcomes()], list(given), list(state.get_registered_output_keys())
    )
    with machine:
        machine.add("IT", state)
    userdata = UserData()
    for key, value in given.items():
        userdata[key] = value
    outcome = machine.execute(userdata)
    run.reason = machine.reason
    run.userdata = userdata
    return str(outcome)


def test_a_function_reads_and_sets_userdata() -> None:
    def double(userdata: Any) -> None:
        userdata.twice = 2 * userdata.once

    assert run(FunctionState(double, ["once"], ["twice"]), once=21) == SUCCEEDED
    assert run.userdata.twice == 42


def test_a_function_chooses_the_outcome() -> None:
    assert run(FunctionState(lambda userdata: "other", outcomes=["other"])) == "other"


@pytest.mark.parametrize("answer", [False, 0, "", "other"])
def test_what_a_function_returns_has_to_be_an_outcome(answer: Any) -> None:
    with pytest.raises(InvalidTransitionError, match=f"IT.*ended with {answer!r}"):
        run(FunctionState(lambda userdata: answer))


def test_a_function_that_refuses_aborts_with_its_text() -> None:
    assert run(FunctionState(refuse)) == "aborted"
    assert run.reason == "the tray is full"


def test_a_machine_that_goes_on_after_a_failure_says_what_failed(caplog: pytest.LogCaptureFixture) -> None:
    machine = MerlinSM([SUCCEEDED, "aborted", PREEMPTED])
    with machine:
        machine.add("LOAD", FunctionState(refuse), {"aborted": "GO_ON"})
        machine.add("GO_ON", FunctionState(lambda userdata: None))
    with caplog.at_level("INFO", "rosout"):
        assert machine.execute() == SUCCEEDED
    assert [record.message for record in caplog.records] == ["LOAD was aborted: the tray is full"]


def test_a_machine_that_aborts_after_a_state_that_succeeded_says_so() -> None:
    machine = MerlinSM([SUCCEEDED, "aborted", PREEMPTED])
    with machine:
        machine.add("GIVE_BACK", FunctionState(lambda userdata: None), {SUCCEEDED: "aborted"})
    assert machine.execute() == "aborted"
    assert machine.reason == "state GIVE_BACK ended with succeeded, with which its machine is aborted"


class Dispatcher:
    """A client of the dispatcher that has an answer."""

    def __init__(self, result: DispatchResult) -> None:
        self.dispatch = lambda *arguments: result


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ("(lead ann) failed", "(lead ann) failed"),
        ("(lead ann) failed: she is gone", "(lead ann) failed: she is gone"),
        ("she is gone", "(lead ann): she is gone"),
    ],
)
def test_an_action_that_failed_is_named_once(said: str, reason: str) -> None:
    failed = DispatchResult(False, action="(lead ann)", reason=said)
    state = DispatchPlanState(Dispatcher(failed))  # type: ignore[arg-type]
    assert run(state) == "failed" and run.reason == reason


class Wait(MerlinState):
    """Waits until the test ends it, or a preempt."""

    def __init__(self, outcome: str = SUCCEEDED, at_once: bool = False) -> None:
        super().__init__()
        self.ended = threading.Event()
        self._ends_with = outcome
        if at_once:
            self.ended.set()

    def run(self, userdata: Any) -> str:
        self.interruptible(self.ended.set)
        assert self.ended.wait(LONG)
        self.interruptible(None)
        return PREEMPTED if self.preempt_requested() else self._ends_with


def test_who_runs_ends_who_watches() -> None:
    watch = Wait()
    assert run(WhileSM(Wait(at_once=True), watch)) == SUCCEEDED
    assert watch.outcome == PREEMPTED


def test_who_watches_ends_who_runs() -> None:
    acts = Wait()
    assert run(WhileSM(acts, Wait(at_once=True), "behind")) == "behind"
    assert acts.outcome == PREEMPTED


def test_a_watch_that_fails_ends_both_with_its_reason() -> None:
    assert run(WhileSM(Wait(), FunctionState(refuse), "behind")) == "aborted"
    assert run.reason == "the tray is full"


class Said(MerlinState):
    """Takes the place of speech."""

    log: List[str] = []

    def __init__(self, text: str, keys: tuple = ()) -> None:
        super().__init__(input_keys=keys)
        self._text = text

    def run(self, userdata: Any) -> str:
        self.log.append(self._text)
        return SUCCEEDED


class Heard(MerlinState):
    """Takes the place of hearing: understands the answers in turn, an empty one not at all."""

    answers: List[str] = []

    def __init__(self, grammar: str, timeout: float) -> None:
        super().__init__(["misunderstood"], output_keys=["heard"])

    def run(self, userdata: Any) -> str:
        answer = userdata.heard = self.answers.pop(0)
        return SUCCEEDED if answer else "misunderstood"


@pytest.mark.parametrize(
    "answers, outcome, questions",
    [(["yes"], SUCCEEDED, 1), (["", "", "yes"], SUCCEEDED, 3), (["", "", ""], "misunderstood", 3)],
)
def test_a_question_is_asked_again(
    answers: list, outcome: str, questions: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dialogue, "SpeakState", Said)
    monkeypatch.setattr(dialogue, "ListenState", Heard)
    Said.log.clear()
    Heard.answers[:] = list(answers)
    state = dialogue.AskSM("Coffee?", "grammar")
    assert run(state) == outcome
    assert Said.log == ["Coffee?", *["Sorry, I did not understand. Coffee?"] * (questions - 1)]
    if outcome == SUCCEEDED:
        assert run.userdata.heard == "yes"
    else:
        assert "3 attempts" in run.reason
    Heard.answers[:] = ["", "yes"]
    assert run(state) == SUCCEEDED, "the attempts are counted anew in each run"
