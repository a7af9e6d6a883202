# SPDX-License-Identifier: Apache-2.0
"""What containers do as documented: transitions, outcomes, callbacks, structure, pickling."""

import pickle
import threading
import traceback

import pytest

import smach


class Next(smach.State):
    """Ends with 'done'; at module level, for pickling."""

    def __init__(self):
        smach.State.__init__(self, outcomes=["done"])

    def execute(self, ud):
        return "done"


def test_machine_goes_from_state_to_state_and_ends_with_an_outcome(kit):
    sm = smach.StateMachine(outcomes=["end"])
    a, b = kit.Done(), kit.Done()
    with sm:
        assert smach.StateMachine.add("A", a, transitions={"done": "B"}) is a
        smach.StateMachine.add("B", b, transitions={"done": "end"})
    assert sm.execute() == "end"
    assert (a.runs, b.runs) == (1, 1)
    assert sm["A"] is a and sm.get_children() == {"A": a, "B": b}
    assert sm.get_initial_states() == ["A"]
    sm.set_initial_state(["B"])
    sm.execute()
    assert (a.runs, b.runs) == (1, 2)


def test_active_states(kit):
    seen = []
    sm = kit.machine(kit.Calling(lambda ud: seen.append(sm.get_active_states()) or "done"))
    assert sm.get_active_states() == ["None"]
    sm.execute()
    assert seen == [["S0"]] and sm.get_active_states() == ["None"]


def test_userdata_flows_through_remapping_and_nesting(kit):
    def double(ud):
        ud.out = ud.inp * 2
        return "done"

    inner = smach.StateMachine(["done"], input_keys=["n"], output_keys=["m"])
    with inner:
        smach.StateMachine.add(
            "DOUBLE",
            kit.Calling(double, input_keys=["inp"], output_keys=["out"]),
            remapping={"inp": "n", "out": "m"},
        )
    outer = smach.StateMachine(["done"])
    with outer:
        smach.StateMachine.add("INNER", inner, remapping={"n": "x", "m": "x"})
    outer.userdata.x = 4
    assert outer.execute() == "done"
    assert outer.userdata.x == 8


def test_missing_input_key_is_a_warning(kit, log):
    sm = smach.StateMachine(["done"], input_keys=["x"])
    with sm:
        smach.StateMachine.add("A", kit.Done())
    assert sm.execute(smach.UserData()) == "done"
    assert any("'x'" in text for level, text in log if level == "warn")


def test_n9_exception_of_a_state_carries_its_path_traceback_and_cause(kit):
    def broken(ud):
        raise ZeroDivisionError("here it is")

    inner = kit.machine(kit.Calling(broken))
    outer = kit.machine(inner)
    with pytest.raises(smach.InvalidUserCodeError) as caught:
        outer.execute()
    text = str(caught.value)
    assert "/S0/S0" in text and "here it is" in text and "in broken" in text
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    assert any(frame.name == "broken" for frame in traceback.extract_tb(caught.value.__cause__.__traceback__))
    assert not outer.is_running() and not inner.is_running()


def test_unregistered_outcome_raises(kit):
    sm = kit.machine(kit.Calling(lambda ud: "unheard"))
    with pytest.raises(smach.InvalidTransitionError, match="(?s)/S0.*unheard"):
        sm.execute()


def test_add_auto_leads_to_the_state_added_next(kit):
    sm = smach.StateMachine(["done", "end"])
    with sm:
        smach.StateMachine.add_auto("A", kit.Done(), ["done"], transitions={"done": "end"})
        smach.StateMachine.add("B", kit.Done(), {"done": "end"})
    assert sm.get_internal_edges() == [("done", "A", "B"), ("done", "B", "end")]


def test_sequence(kit):
    sequence = smach.Sequence(["done", "end"], connector_outcome="done")
    with sequence:
        smach.Sequence.add("A", kit.Done())
        smach.Sequence.add("B", kit.Done(), transitions={"done": "D"})
        smach.Sequence.add("C", kit.Done())
        smach.Sequence.add("D", kit.Done())
    assert sequence.get_internal_edges() == [
        ("done", "A", "B"),
        ("done", "B", "D"),
        ("done", "C", "D"),
        ("done", "D", None),
    ]
    assert sequence.execute() == "done"
    assert sequence["C"].runs == 0


def test_concurrence_outcome_by_callback_map_and_default(kit):
    def run(**policy):
        container = smach.Concurrence(["one", "two", "other"], "other", **policy)
        with container:
            smach.Concurrence.add("A", kit.Done())
            smach.Concurrence.add("B", kit.Calling(lambda ud: "failed", ["done", "failed"]))
        return container.execute()

    maps = {"one": {"A": "done"}, "two": {"A": "done", "B": "failed"}}
    assert run() == "other"
    assert run(outcome_map={"one": {"B": "done"}}) == "other"
    assert run(outcome_map=maps) == "two"
    assert run(outcome_map=maps, outcome_cb=lambda outcomes: None) == "two"
    seen = []
    assert run(outcome_map=maps, outcome_cb=lambda outcomes: seen.append(outcomes) or "one") == "one"
    assert seen == [{"A": "done", "B": "failed"}]
    with pytest.raises(smach.InvalidTransitionError, match="unheard"):
        run(outcome_cb=lambda outcomes: "unheard")


def test_n8_termination_callback_that_names_children_preempts_only_these(kit):
    one, two = kit.Waiting(), kit.Waiting()
    container = smach.Concurrence(
        ["done"], "done", child_termination_cb=lambda outcomes: ["ONE"] if outcomes["ONE"] is None else []
    )
    with container:
        smach.Concurrence.add("ONE", one)
        smach.Concurrence.add("TWO", two)
        smach.Concurrence.add("ENDS", kit.Done())
    run = kit.Running(container)
    assert one.asked.wait(kit.LIMIT)
    two.release.set()
    assert run.end() == "done"
    assert (one.outcomes, two.outcomes) == (["preempted"], ["done"])


def test_concurrence_calls_back_at_each_start_and_end(kit):
    first, second = kit.Waiting(), kit.Waiting()
    container = kit.concurrence(A=first, B=second)
    calls, only_b = [], threading.Event()

    def moved(ud, active):
        calls.append(sorted(active))
        if active == ["B"]:
            only_b.set()

    container.register_transition_cb(moved)
    run = kit.Running(container)
    assert first.started.wait(kit.LIMIT) and second.started.wait(kit.LIMIT)
    assert sorted(container.get_active_states()) == ["A", "B"]
    first.release.set()
    assert only_b.wait(kit.LIMIT)
    assert container.get_active_states() == ["B"]
    second.release.set()
    assert run.end() == "done"
    assert calls == [["A", "B"], ["A", "B"], ["B"], []]
    assert container.get_active_states() == []


def test_callbacks_get_userdata_states_and_arguments(kit):
    sm = kit.machine(kit.Done(), kit.Done())
    calls = []
    sm.register_start_cb(lambda *args: calls.append(("start", *args)), cb_args=[1])
    sm.register_transition_cb(lambda *args: calls.append(("transition", *args)), cb_args=[2])
    sm.register_termination_cb(lambda *args: calls.append(("end", *args)), cb_args=[3])
    sm.execute()
    assert calls == [
        ("start", sm.userdata, ["S0"], 1),
        ("transition", sm.userdata, ["S1"], 2),
        ("end", sm.userdata, ["S1"], "done", 3),
    ]


@pytest.mark.parametrize("kind", ["start", "transition", "termination"])
def test_i5_callback_that_raises_hides_no_other(kit, log, kind):
    sm = kit.machine(kit.Done(), kit.Done())
    called = []

    def broken(*args):
        raise ValueError("broken callback")

    register = getattr(sm, f"register_{kind}_cb")
    register(broken)
    register(lambda *args: called.append(1))
    assert sm.execute() == "done"
    assert called == [1]
    assert any("broken callback" in text for level, text in log if level == "error")


def test_i6_outcomes_children_and_edges_keep_their_order(kit):
    labels = [f"S{i}" for i in range(20)]
    outcomes = [f"o{i}" for i in range(19, -1, -1)]
    state = smach.State(outcomes=outcomes)
    assert state.get_registered_outcomes() == tuple(outcomes)
    sm = kit.machine(*[kit.Done() for _ in labels])
    assert list(sm.get_children()) == labels
    assert [source for _, source, _ in sm.get_internal_edges()] == labels
    container = smach.StateMachine(outcomes)
    assert container.get_registered_outcomes() == tuple(outcomes)


def test_machine_survives_pickling():
    inner, sm = smach.StateMachine(["done"]), smach.StateMachine(["done"])
    with inner:
        smach.StateMachine.add("LEAF", Next())
    with sm:
        smach.StateMachine.add("INNER", inner)
    sm.userdata.x = [1]
    again = pickle.loads(pickle.dumps(sm))
    assert again.execute() == "done" and again.userdata.x == [1]
    assert again["INNER"]._path("LEAF") == "/INNER/LEAF"


def test_base_state_and_cb_state():
    state = smach.State(outcomes=["a"], input_keys=["i"], output_keys=["o"], io_keys=["io"])
    assert state.get_registered_input_keys() == ("i", "io")
    assert state.get_registered_output_keys() == ("o", "io")
    with pytest.raises(NotImplementedError):
        state.execute(None)
    state.request_preempt()
    assert state.preempt_requested()
    state.service_preempt()
    assert not state.preempt_requested()
    state.request_preempt()
    state.recall_preempt()
    assert not state.preempt_requested()
    with_args = smach.CBState(
        lambda ud, a, b: f"{a}{b}", cb_args=["x"], cb_kwargs={"b": "y"}, outcomes=["xy"]
    )
    assert with_args.execute(None) == "xy"


def test_errors_are_logged_when_they_are_made(log):
    smach.InvalidStateError("seen")
    assert any(level == "error" and "seen" in text for level, text in log)
    assert issubclass(smach.InvalidTransitionError, smach.exceptions.SmachError)


def test_shutdown_check_and_loggers_are_replaced(log, shutdown):
    smach.logwarn("w")
    smach.logdebug("d")
    assert ("warn", "w") in log and ("debug", "d") in log
    assert not smach.is_shutdown()
    shutdown.set()
    assert smach.is_shutdown()
