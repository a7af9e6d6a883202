# SPDX-License-Identifier: Apache-2.0
"""MerlinSM, MerlinState and the while-machine: no preempt is lost, and each end has its reason."""

import enum
import threading
from typing import Any, List, Optional

import pytest
import rospy
from hypothesis import given
from hypothesis import strategies as st

from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED, MerlinState
from merlin_test import LONG
from smach import (
    CBState,
    Concurrence,
    InvalidStateError,
    InvalidTransitionError,
    State,
    StateMachine,
    UserData,
)

OUTCOMES = [SUCCEEDED, ABORTED, PREEMPTED]


class Step(str, enum.Enum):
    """Labels."""

    GO, REST = "GO", "REST"


class Wait(MerlinState):
    """Waits until it is interrupted, or does not wait at all."""

    def __init__(self, outcome: Optional[str] = None, reason: str = "") -> None:
        super().__init__()
        self.begun = threading.Event()
        self.ends_with, self._why = outcome, reason

    def run(self, userdata: Any) -> str:
        if self.ends_with is not None:
            return self.fail(self._why) if self.ends_with == ABORTED else self.ends_with
        woken = threading.Event()
        self.interruptible(woken.set)
        self.begun.set()
        assert woken.wait(LONG)
        self.interruptible(None)
        return PREEMPTED


def machine(*states: State) -> MerlinSM:
    """The states one after the other."""
    made = MerlinSM(OUTCOMES)
    with made:
        for number, state in enumerate(states):
            following = f"S{number + 1}" if number + 1 < len(states) else SUCCEEDED
            made.add(f"S{number}", state, {SUCCEEDED: following})
    return made


def run_in_thread(made: Any, outcomes: List[str]) -> threading.Thread:
    thread = threading.Thread(target=lambda: outcomes.append(made.execute(UserData())))
    thread.start()
    return thread


@given(st.lists(st.sampled_from([SUCCEEDED, ABORTED]), min_size=1, max_size=4))
def test_a_machine_ends_at_its_first_failure_and_says_why(outcomes: List[str]) -> None:
    states = [Wait(outcome, f"reason {number}") for number, outcome in enumerate(outcomes)]
    made = machine(*states)
    assert made.execute(UserData()) == (ABORTED if ABORTED in outcomes else SUCCEEDED)
    assert made.reason == (f"reason {outcomes.index(ABORTED)}" if ABORTED in outcomes else "")


def test_a_reason_comes_out_of_nested_machines_and_is_forgotten_by_the_next_run() -> None:
    failing = Wait(ABORTED, "the door is shut")
    outer = MerlinSM(OUTCOMES)
    with outer:
        outer.add("INNER", machine(failing))
    assert outer.execute(UserData()) == ABORTED
    assert outer.reason == "the door is shut"
    failing.ends_with = SUCCEEDED
    assert outer.execute(UserData()) == SUCCEEDED
    assert outer.reason == ""


def test_a_reason_comes_out_of_the_containers_of_smach() -> None:
    failing, waiting = Wait(ABORTED, "the door is shut"), Wait()
    both = Concurrence(OUTCOMES, ABORTED, child_termination_cb=lambda ended: True)
    with both:
        Concurrence.add("FAILS", failing)
        Concurrence.add("WAITS", waiting)
    inner = StateMachine(OUTCOMES)
    with inner:
        StateMachine.add("BOTH", both)
    outer = machine(inner)
    assert outer.execute(UserData()) == ABORTED
    assert outer.reason == "the door is shut"


def test_containers_of_smach_without_a_reason_are_named_with_how_they_ended() -> None:
    both = Concurrence([*OUTCOMES, "hot"], ABORTED, outcome_map={"hot": {"ONE": SUCCEEDED}})
    with both:
        Concurrence.add("ONE", Wait(SUCCEEDED))
        Concurrence.add("TWO", Wait(SUCCEEDED))
    outer = MerlinSM(OUTCOMES)
    with outer:
        outer.add("BOTH", both, {"hot": ABORTED})
    assert outer.execute(UserData()) == ABORTED
    assert outer.reason == "state BOTH ended with hot, with which its machine is aborted"


def test_of_states_that_ended_together_without_a_reason_none_is_blamed_alone() -> None:
    both = Concurrence(OUTCOMES, ABORTED)
    with both:
        Concurrence.add("ONE", Wait(SUCCEEDED))
        Concurrence.add("TWO", Wait(SUCCEEDED))
    outer = machine(both)
    assert outer.execute(UserData()) == ABORTED
    assert outer.reason == "states ONE and TWO ended with outcomes with which their machine is aborted"


def test_a_machine_can_be_cancelled_before_it_runs_and_runs_again_after_prepare() -> None:
    made = machine(Wait(SUCCEEDED))
    made.prepare()
    made.cancel()
    assert made.execute(UserData()) == PREEMPTED
    made.prepare()
    assert made.execute(UserData()) == SUCCEEDED


@pytest.mark.parametrize("depth", [1, 3])
def test_a_cancel_wakes_the_state_that_waits_however_deep_it_is(depth: int) -> None:
    waiting = Wait()
    made: Any = waiting
    for _ in range(depth):
        made = machine(made)
    made.prepare()
    outcomes: List[str] = []
    thread = run_in_thread(made, outcomes)
    assert waiting.begun.wait(LONG)
    made.cancel()
    thread.join(LONG)
    assert outcomes == [PREEMPTED]
    assert made.reason == "cancelled"


@given(st.lists(st.sampled_from(["announce", "withdraw", "preempt"]), max_size=8))
def test_a_preempt_reaches_what_is_announced_whenever_it_comes(events: List[str]) -> None:
    state = Wait()
    calls: List[int] = []
    announced = preempted = False
    for event in events:
        before = len(calls)
        if event == "announce":
            state.interruptible(lambda: calls.append(1))
            announced = True
            assert len(calls) == before + preempted, "one that came before is passed on at once"
        elif event == "withdraw":
            state.interruptible(None)
            announced = False
        else:
            state.request_preempt()
            preempted = True
            assert len(calls) == before + announced


def test_a_preempt_ends_both() -> None:
    acting, watching = Wait(), Wait()
    both = MerlinStateFactory.create("while", acting, watching)
    outcomes: List[str] = []
    thread = run_in_thread(both, outcomes)
    assert acting.begun.wait(LONG) and watching.begun.wait(LONG)
    both.request_preempt()
    thread.join(LONG)
    assert outcomes == [PREEMPTED]


def test_an_unknown_state_is_named_with_those_there_are() -> None:
    with pytest.raises(KeyError, match="'fly'.*navigation"):
        MerlinStateFactory.create("fly")


def test_a_machine_that_leads_nowhere_is_refused_when_it_is_closed() -> None:
    """SMACH only logs that; a robot would learn of it when it runs the machine."""
    with pytest.raises(InvalidTransitionError, match="NOWHERE"), MerlinSM(OUTCOMES) as made:
        made.add("A", Wait(SUCCEEDED), {SUCCEEDED: "NOWHERE"})


def test_a_machine_begins_each_run_without_what_the_last_one_left() -> None:
    seen: List[List[str]] = []

    def work(userdata: Any) -> str:
        seen.append(sorted(made.userdata.keys()))
        userdata.place = "hall"
        return SUCCEEDED

    made = MerlinSM([SUCCEEDED])
    made.userdata.robot = "r1"
    with made:
        made.add("WORK", CBState(work, outcomes=[SUCCEEDED], output_keys=["place"]))
    both = MerlinStateFactory.create("while", made, Wait())
    for run in (made.execute, made.execute, both.execute):
        assert run(UserData()) == SUCCEEDED
    assert seen == [["robot"]] * 3
    assert not MerlinStateFactory.create("while", Wait(), Wait()).keeps_userdata


@pytest.mark.parametrize("deep", [False, True])
def test_what_a_container_of_smach_inside_has_heard_is_forgotten_by_the_next_run(deep: bool) -> None:
    heard, said = ["coffee", ""], []

    def listen(userdata: Any) -> str:
        word = heard.pop(0)
        if word:
            userdata.order = word
        return SUCCEEDED

    def say(userdata: Any) -> str:
        said.append(userdata.order if "order" in userdata else "nothing")
        return SUCCEEDED

    keys = {"output_keys": ["order"]}
    both = Concurrence([SUCCEEDED], SUCCEEDED, **keys)
    with both:
        Concurrence.add("LISTEN", CBState(listen, outcomes=[SUCCEEDED], **keys))
    made = MerlinSM([SUCCEEDED, PREEMPTED])
    with made:
        watched = MerlinStateFactory.create("while", both, Wait()) if deep else both
        MerlinSM.add("BOTH", watched, {SUCCEEDED: "SAY", **({"seen": "SAY", ABORTED: "SAY"} if deep else {})})
        MerlinSM.add("SAY", CBState(say, outcomes=[SUCCEEDED], input_keys=["order"]))
    for _ in range(2):
        assert made.execute(UserData()) == SUCCEEDED
    assert said == ["coffee", "nothing"]


def test_a_watch_reads_and_writes_userdata() -> None:
    def watch(userdata: Any) -> str:
        userdata.seen = userdata.limit + 1
        return SUCCEEDED

    keys = {"input_keys": ["limit"], "output_keys": ["seen"]}
    made = MerlinSM(["seen", *OUTCOMES], **keys)
    made.userdata.limit = 6
    with made:
        MerlinSM.add(
            "BOTH", MerlinStateFactory.create("while", Wait(), CBState(watch, outcomes=[SUCCEEDED], **keys))
        )
    assert made.execute() == "seen"
    assert made.userdata.seen == 7


def test_labels_that_are_members_of_an_enumeration(monkeypatch: pytest.MonkeyPatch) -> None:
    said: List[str] = []
    monkeypatch.setattr(rospy, "loginfo", said.append)
    made = MerlinSM([SUCCEEDED])
    with made:
        made.add(Step.GO, Wait(ABORTED, "no way"), {ABORTED: Step.REST, PREEMPTED: SUCCEEDED})
        made.add(Step.REST, Wait(SUCCEEDED), {ABORTED: SUCCEEDED, PREEMPTED: SUCCEEDED})
    assert made.execute(UserData()) == SUCCEEDED
    assert said == ["GO was aborted: no way"]


@pytest.mark.parametrize("add", [MerlinSM.add, MerlinSM.add_auto])
def test_what_is_no_state_is_named_when_it_is_added(add: Any) -> None:
    with pytest.raises(InvalidStateError, match="GO.*speak"), MerlinSM(OUTCOMES):
        add("GO", "speak", [SUCCEEDED])
