# SPDX-License-Identifier: Apache-2.0
"""A behaviour tree as a state: what it ends with, what it interrupts, and when it is ticked."""

import threading
from typing import Any, Callable, Iterator, List

import py_trees
import pytest
from py_trees.common import ParallelPolicy, Status
from py_trees.composites import Selector
from tree_world import Act, Run, Watch, both, fails, function, leaf, sequence

from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED, GivenUp
from merlin_sm.trees import behaviour_tree
from merlin_sm.trees.behaviour_tree import BehaviourTree
from merlin_sm.trees.state_behaviour import StateBehaviour
from merlin_test import LONG


def test_states_run_one_after_the_other_and_share_userdata() -> None:
    heard: List[str] = []
    ask = function("ASK", lambda userdata: userdata.update({"answer": "tea"}), outputs=["answer"])
    note = StateBehaviour(
        "NOTE",
        FunctionState(lambda userdata: heard.append(userdata.text), ["text"]),
        remapping={"text": "answer"},
    )
    drive = Act()
    run = Run(sequence(ask, leaf("DRIVE", drive), note))
    assert drive.begun.wait(LONG)
    assert heard == []
    drive.end(lambda: SUCCEEDED)
    assert run.ended() == (SUCCEEDED, "")
    assert heard == ["tea"]


def test_a_failure_has_the_reason_of_the_state_that_decided() -> None:
    root = Selector("ANY", True, [function("A", fails("no door")), sequence(function("B", fails("no key")))])
    assert Run(root).ended() == (ABORTED, "no key")
    root = sequence(Selector("ANY", True, [function("A", fails("no door")), function("B", lambda _: None)]))
    assert Run(root).ended() == (SUCCEEDED, "")
    assert Run(sequence(Watch("DOOR", Status.FAILURE))).ended() == (ABORTED, "DOOR failed")


def test_outcomes_are_mapped() -> None:
    state = FunctionState(lambda _: "none_there", outcomes=["none_there"])
    assert Run(sequence(leaf("LOOK", state))).ended() == (ABORTED, "LOOK ended with none_there")
    mapped = leaf("LOOK", state, success=("succeeded", "none_there"))
    assert Run(sequence(mapped)).ended() == (SUCCEEDED, "")
    with pytest.raises(ValueError, match="'LOOK': its state has no outcome 'gone', only succeeded, aborted"):
        leaf("LOOK", state, success=("gone",))


def test_a_preempt_interrupts_every_state_at_once_and_waits_for_each() -> None:
    drive, speak, watch = Act(), Act(), Watch("WATCH")
    speak.may_stop.clear()
    run = Run(both(leaf("DRIVE", drive), leaf("SPEAK", speak), watch))
    assert drive.begun.wait(LONG) and speak.begun.wait(LONG)
    run.machine.cancel()
    assert drive.interrupted.is_set() and speak.interrupted.is_set()  # in the caller's thread
    assert run.outcome == ""
    speak.may_stop.set()
    assert run.ended() == (PREEMPTED, "cancelled")
    assert watch.ends == [Status.INVALID]


def test_a_preempt_that_comes_first_begins_nothing() -> None:
    drive = Act()
    machine = MerlinSM([SUCCEEDED, ABORTED, PREEMPTED])
    with machine:
        machine.add("TREE", BehaviourTree(sequence(leaf("DRIVE", drive))))
    machine.prepare()
    machine.cancel()
    assert machine.execute() == PREEMPTED
    assert drive.runs == 0


def test_a_preempt_reaches_a_nested_machine_that_has_not_begun() -> None:
    inner = MerlinSM([SUCCEEDED, ABORTED, PREEMPTED])
    drive = Act()
    held, go = threading.Event(), threading.Event()
    inner.register_start_cb(lambda *_: (held.set(), go.wait(LONG)))
    with inner:
        inner.add("DRIVE", drive)
    run = Run(sequence(leaf("INNER", inner)))
    assert held.wait(LONG)
    run.machine.cancel()
    go.set()
    assert run.ended()[0] == PREEMPTED
    assert drive.runs == 0 or drive.interrupted.is_set()


def test_the_first_success_of_a_parallel_interrupts_the_others() -> None:
    drive, see = Act(), Act()
    run = Run(both(leaf("DRIVE", drive), leaf("SEE", see), policy=ParallelPolicy.SuccessOnOne()))
    assert drive.begun.wait(LONG) and see.begun.wait(LONG)
    see.end(lambda: SUCCEEDED)
    assert run.ended() == (SUCCEEDED, "")
    assert drive.interrupted.is_set()


def test_nothing_begins_while_what_was_interrupted_still_stops() -> None:
    door = Watch("DOOR", Status.FAILURE)
    drive, through = Act(), Act()
    drive.may_stop.clear()
    first = sequence(door, leaf("THROUGH", through), memory=False)
    run = Run(Selector("ANY", False, [first, leaf("DRIVE", drive)]))
    assert drive.begun.wait(LONG)
    door.says = Status.SUCCESS
    run.tree.wake()
    assert drive.interrupted.wait(LONG)
    assert not through.begun.is_set()
    drive.may_stop.set()
    assert through.begun.wait(LONG)
    through.end(lambda: SUCCEEDED)
    assert run.ended() == (SUCCEEDED, "")


def test_what_did_not_stop_ends_the_tree_with_its_name() -> None:
    drive = Act()

    def late() -> str:
        drive.unstopped = "/move_base"
        return drive.fail("/move_base did not stop within 2 s")

    see = Act()
    run = Run(both(leaf("DRIVE", drive), leaf("SEE", see), policy=ParallelPolicy.SuccessOnOne()))
    assert drive.begun.wait(LONG) and see.begun.wait(LONG)
    drive.how = late
    see.end(lambda: SUCCEEDED)
    assert run.ended() == (ABORTED, "/move_base did not stop within 2 s")


def test_what_did_not_stop_may_be_tried_again_although_another_state_gave_up() -> None:
    drive, see = Act(), Act()

    def late() -> str:
        drive.unstopped = "/move_base"
        return drive.fail("/move_base did not stop within 2 s")

    run = Run(both(leaf("DRIVE", drive), leaf("SEE", see)))
    assert drive.begun.wait(LONG) and see.begun.wait(LONG)
    drive.how = late
    see.end(lambda: see.give_up("there is no cup"))
    assert run.ended() == (ABORTED, "/move_base did not stop within 2 s")
    assert not run.machine.given_up


def test_an_exception_of_a_state_or_a_behaviour_ends_everything_and_is_raised() -> None:
    drive, speak = Act(), Act()

    def broken() -> str:
        raise RuntimeError("a mistake")

    run = Run(both(leaf("DRIVE", drive), leaf("SPEAK", speak)))
    assert drive.begun.wait(LONG) and speak.begun.wait(LONG)
    speak.end(broken)
    with pytest.raises(Exception, match="a mistake"):
        run.ended()
    assert drive.interrupted.is_set()

    class Broken(Watch):
        def update(self) -> Status:
            raise RuntimeError("another mistake")

    with pytest.raises(Exception, match="another mistake"):
        Run(sequence(Broken("BROKEN"))).ended()


def test_a_state_for_which_there_is_no_thread_ends_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    start = threading.Thread.start

    def short_of_threads(thread: threading.Thread) -> None:
        if thread.name == "behaviour SPEAK":
            raise RuntimeError("can't start new thread")
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", short_of_threads)
    with pytest.raises(Exception, match="can't start new thread"):
        Run(both(leaf("DRIVE", Act()), leaf("SPEAK", Act()))).ended()


def test_what_gave_up_counts_when_it_had_the_last_word() -> None:
    def hopeless(userdata: Any) -> None:
        raise GivenUp("there is no attic", about="attic")

    drive = FunctionState(hopeless)
    assert Run(sequence(leaf("DRIVE", drive))).ended() == (ABORTED, "there is no attic")
    assert drive.given_up and drive.about == "attic"
    for why in ("busy", "there is no attic, and the robot is busy"):
        other = Selector("ANY", True, [leaf("DRIVE", FunctionState(hopeless)), function("B", fails(why))])
        run = Run(other)
        assert run.ended() == (ABORTED, why)
        assert (run.machine.given_up, run.machine.about) == (False, "")


def test_a_retry_begins_anew_at_once() -> None:
    tries: List[int] = []

    def third(userdata: Any) -> None:
        tries.append(1)
        if len(tries) < 3:
            raise ValueError("not yet")

    assert Run(py_trees.decorators.Retry("RETRY", function("TRY", third), 5)).ended() == (SUCCEEDED, "")
    drive = Act()
    run = Run(py_trees.decorators.Retry("RETRY", leaf("DRIVE", drive), 2))
    for _ in range(2):
        assert drive.begun.wait(LONG)
        drive.begun.clear()
        drive.end(lambda: drive.fail("blocked"))
    assert run.ended() == (ABORTED, "blocked")
    assert drive.runs == 2


def test_a_tree_in_which_nothing_happens_is_not_ticked() -> None:
    drive, watch = Act(), Watch("WATCH")
    condition = function("STILL", lambda userdata: None)  # runs within the tick
    run = Run(both(sequence(condition, leaf("DRIVE", drive), memory=False), watch))
    assert drive.begun.wait(LONG)
    rests = threading.Event()
    wait = run.tree._wait
    run.tree._wait = lambda: (rests.set(), wait())  # type: ignore[method-assign]
    run.tree.wake()
    assert rests.wait(LONG)
    before = watch.ticks
    run.tree.wake()
    with watch.ticked:
        assert watch.ticked.wait_for(lambda: watch.ticks > before, LONG)  # the first wake may come late
    watch.says = Status.SUCCESS
    drive.end(lambda: SUCCEEDED)
    assert run.ended() == (SUCCEEDED, "")
    assert watch.ticks <= before + 3


def test_a_write_to_the_blackboard_is_seen_by_what_was_ticked_before() -> None:
    board = py_trees.blackboard.Client(name="test")
    board.register_key("door", py_trees.common.Access.WRITE)
    board.register_key("hall", py_trees.common.Access.WRITE)

    class Open(Watch):
        def update(self) -> Status:
            board.door = "open"
            return super().update()

    waits = py_trees.behaviours.WaitForBlackboardVariableValue(
        "SEE", py_trees.common.ComparisonExpression("door", "open", lambda a, b: a == b)
    )
    board.door = "shut"
    assert Run(both(waits, Open("OPEN"), policy=ParallelPolicy.SuccessOnOne())).ended() == (SUCCEEDED, "")


@pytest.fixture
def timers(monkeypatch: pytest.MonkeyPatch) -> Iterator[List[float]]:
    """The periods of timers, which fire at once."""
    asked: List[float] = []

    class Alarm:
        def __init__(self, period: float, callback: Callable[[], None], name: str) -> None:
            asked.append(period)
            callback()

        def shutdown(self) -> None:
            """Like that of the real one."""

    monkeypatch.setattr(behaviour_tree, "call_after", Alarm)
    yield asked


def test_a_period_ticks_although_nothing_happens(timers: List[float]) -> None:
    class Third(Watch):
        def update(self) -> Status:
            super().update()
            return Status.SUCCESS if self.ticks >= 3 else Status.RUNNING

    assert Run(sequence(Third("COUNT")), period=0.5).ended() == (SUCCEEDED, "")
    counts = Third("COUNT")
    counts.period = 0.25
    assert Run(sequence(counts)).ended() == (SUCCEEDED, "")
    assert set(timers) == {0.5, 0.25}


def test_a_tree_that_does_not_wait_for_anything_says_so() -> None:
    never = py_trees.decorators.FailureIsRunning("AGAIN", py_trees.behaviours.Failure("NO"))
    with pytest.raises(Exception, match="tree AGAIN was ticked 1000 times and does not wait for anything"):
        Run(never).ended()


def test_a_tree_is_seen_as_containers() -> None:
    inner = Selector("ANY", True, [Watch("A/B"), Watch("C"), Watch("C")])
    tree = BehaviourTree(sequence(leaf("DRIVE", Act("place")), inner), ["to"])
    assert list(tree.get_children()) == ["DRIVE", "ANY"]
    # An edge has the outcome of what it leaves: pictures begin it there.
    assert tree.get_internal_edges() == [
        ("succeeded", "DRIVE", "ANY"),
        ("aborted", "DRIVE", "aborted"),
        ("success", "ANY", "succeeded"),
        ("failure", "ANY", "aborted"),
    ]
    branch = tree["ANY"]
    assert list(branch.get_children()) == ["A_B", "C", "C 2"]
    assert ("failure", "C", "C 2") in branch.get_internal_edges()
    assert branch.get_initial_states() == ["A_B"]
    assert set(branch.get_registered_input_keys()) == {"to", "place"}


def test_what_changes_is_reported_to_viewers() -> None:
    drive, seen = Act(), []
    inner = sequence(leaf("DRIVE", drive))
    inner.name = "IN"
    tree = BehaviourTree(sequence(function("FIRST", lambda _: None), inner))
    tree.register_transition_cb(lambda userdata, states: seen.append(("tree", *states)))
    tree["IN"].register_start_cb(
        lambda userdata, states: seen.append(("in", *tree["IN"].get_active_states()))
    )
    tree["IN"].register_termination_cb(lambda userdata, states, outcome: seen.append((*states, outcome)))
    thread = threading.Thread(target=tree.execute)
    thread.start()
    assert drive.begun.wait(LONG)
    drive.end(lambda: SUCCEEDED)
    thread.join(LONG)
    assert seen == [("tree", "IN"), ("in", "DRIVE"), ("DRIVE", "success")]


def test_machines_without_trees_do_not_import_py_trees() -> None:
    import subprocess
    import sys

    code = (
        "import sys, merlin_actions.nodes.fsm_host, merlin_executor.mission; "
        "from merlin_sm.state_factory import MerlinStateFactory; sys.exit('py_trees' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=LONG, check=False).returncode == 0
