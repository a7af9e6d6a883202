# SPDX-License-Identifier: Apache-2.0
"""The Iterator, and defect D8: it goes through all items, again in each run, and hides no error."""

import pytest

import smach


def iterator(state, it, outcomes=("done", "preempted"), **how):
    loop = smach.Iterator(list(outcomes), [], ["seen"], it=it, exhausted_outcome="exhausted")
    with loop:
        smach.Iterator.set_contained_state("A", state, **how)
    loop.userdata.seen = []
    return loop


def collect(ud):
    ud.seen = [*ud.seen, ud.it_data]
    return "stop" if ud.it_data == "stop" else "go"


def test_d8_without_lists_of_outcomes_all_items_are_gone_through(kit):
    loop = iterator(kit.Calling(collect, ["go", "stop"]), [1, "stop", 3])
    assert loop.execute() == "exhausted"
    assert loop.userdata.seen == [1, "stop", 3]


@pytest.mark.parametrize("how", [{"break_outcomes": ["stop"]}, {"loop_outcomes": ["go"]}])
def test_d8_loop_ends_by_an_outcome_that_breaks(kit, how):
    loop = iterator(
        kit.Calling(collect, ["go", "stop"]), [1, "stop", 3], final_outcome_map={"stop": "done"}, **how
    )
    assert loop.execute() == "done"
    assert loop.userdata.seen == [1, "stop"]


def test_d8_items_of_a_generator_are_there_in_every_run(kit):
    loop = iterator(kit.Calling(collect, ["go", "stop"]), (i for i in (1, 2)), loop_outcomes=["go", "stop"])
    assert [loop.execute(), loop.execute()] == ["exhausted", "exhausted"]
    assert loop.userdata.seen == [1, 2, 1, 2]


def test_d8_items_of_a_callable_are_asked_for_in_every_run(kit):
    asked = []
    loop = iterator(kit.Calling(collect, ["go", "stop"]), lambda: asked.append(1) or [len(asked)])
    loop.execute()
    loop.execute()
    assert loop.userdata.seen == [1, 2]


def test_d8_error_of_the_items_is_not_taken_for_their_end(kit):
    def items():
        yield 1
        raise ValueError("no more items for you")

    loop = iterator(kit.Calling(collect, ["go", "stop"]), items)
    with pytest.raises(smach.InvalidUserCodeError, match="no more items") as caught:
        loop.execute()
    assert isinstance(caught.value.__cause__, ValueError)


def test_d8_iterator_does_not_run_after_an_exception(kit):
    def broken(ud):
        raise ValueError("x")

    loop = iterator(kit.Calling(broken), [1])
    with pytest.raises(smach.InvalidUserCodeError):
        loop.execute()
    assert not loop.is_running()
    assert loop.get_active_states() == []


def test_preempted_iterator_ends_with_the_outcome_of_its_state(kit):
    state = kit.Waiting()
    loop = iterator(state, [1, 2, 3], loop_outcomes=["done"])
    run = kit.Running(loop)
    assert state.started.wait(kit.LIMIT)
    loop.request_preempt()
    assert run.end() == "preempted"
    assert state.outcomes == ["preempted"]


def test_iterator_passes_an_ignored_request_on(kit):
    stubborn, after = kit.Waiting(obeys=False), kit.Checking()
    loop = iterator(stubborn, [1, 2], loop_outcomes=["done", "preempted"])
    sm = smach.StateMachine(["done", "preempted"])
    with sm:
        smach.StateMachine.add("LOOP", loop, {"done": "AFTER", "exhausted": "AFTER"})
        smach.StateMachine.add("AFTER", after)
    run = kit.Running(sm)
    assert stubborn.started.wait(kit.LIMIT)
    sm.request_preempt()
    stubborn.release.set()
    assert run.end() == "preempted"
    assert after.outcomes == ["preempted"]


def test_structure_and_callbacks(kit):
    loop = iterator(
        kit.Calling(collect, ["go", "stop"]),
        [1, 2],
        break_outcomes=["stop"],
        final_outcome_map={"stop": "done"},
    )
    calls = []
    loop.register_start_cb(lambda ud, states: calls.append(("start", states)))
    loop.register_transition_cb(lambda ud, states: calls.append(("transition", states)))
    loop.register_termination_cb(lambda ud, states, outcome: calls.append((outcome, states)))
    loop.execute()
    assert calls == [("start", ["A"]), ("transition", ["A"]), ("exhausted", ["A"])]
    assert loop.get_internal_edges() == [
        ("go", "A", "A"),
        ("stop", "A", "done"),
        ("exhausted", "A", "exhausted"),
    ]
    assert loop.get_registered_outcomes() == ("done", "preempted", "exhausted")


def test_broken_definitions_raise(kit):
    with pytest.raises(smach.InvalidStateError, match="no contained state"):
        smach.Iterator(["done"], [], []).execute()
    with pytest.raises(smach.InvalidStateError, match="iterable"):
        smach.Iterator(["done"], [], [], it=5)
    with pytest.raises(smach.InvalidTransitionError, match="'stop'"):
        iterator(kit.Done(), [1], break_outcomes=["stop"]).execute()
    with pytest.raises(smach.InvalidTransitionError, match="'done'"):
        iterator(kit.Done(), [1], outcomes=["other"], break_outcomes=["done"]).execute()


def test_set_iteritems(kit):
    loop = smach.Iterator(["done"], [], [])
    seen = []
    with loop:
        smach.Iterator.set_iteritems([1, 2], "number")
        smach.Iterator.set_contained_state("A", kit.Calling(lambda ud: seen.append(ud.number) or "done"))
    assert loop.execute() == "exhausted" and seen == [1, 2]
