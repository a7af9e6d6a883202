# SPDX-License-Identifier: Apache-2.0
"""Labels and outcomes that are not texts: what errors, logs and wrong definitions say of them."""

import enum
import threading

import pytest

import smach


class Text(str, enum.Enum):
    ONE, TWO, OK = "ONE", "TWO", "ok"


class Plain(enum.Enum):
    ONE, TWO, OK = 1, 2, 3


def machine(kit, names, act=None):
    sm = smach.StateMachine([names.OK])
    with sm:
        first = kit.Calling(act or (lambda ud: names.OK), [names.OK])
        smach.StateMachine.add(names.ONE, first, {names.OK: names.TWO})
        smach.StateMachine.add(names.TWO, kit.Calling(lambda ud: names.OK, [names.OK]))
    return sm


@pytest.mark.parametrize("names", [Text, Plain])
def test_a_machine_goes_from_member_to_member_and_ends_with_one(kit, names):
    active = []
    sm = machine(kit, names, lambda ud: active.extend(sm.get_active_states()) or names.OK)
    moved, ended = [], []
    sm.register_transition_cb(lambda ud, states: moved.extend(states))
    sm.register_termination_cb(lambda ud, states, outcome: ended.extend([*states, outcome]))
    assert sm.execute() is names.OK
    assert active == [names.ONE] and moved == [names.TWO] and ended == [names.TWO, names.OK]
    assert sm.get_internal_edges() == [(names.OK, names.ONE, names.TWO), (names.OK, names.TWO, None)]


@pytest.mark.parametrize("names, texts", [(Text, ["ONE", "TWO", "ok"]), (Plain, ["Plain.ONE", "Plain.TWO"])])
def test_n7_n10_paths_and_logs_show_the_text_of_a_member(kit, log, names, texts):
    def broken(ud):
        raise ValueError

    assert machine(kit, names).execute() is names.OK
    steps = [text for level, text in log if "transitioning" in text]
    assert len(steps) == 1 and f"'{texts[0]}':" in steps[0] and f"'{texts[1]}'" in steps[0]
    outer = smach.StateMachine([names.OK])
    with outer:
        smach.StateMachine.add("S0", machine(kit, names, broken))
    with pytest.raises(smach.InvalidUserCodeError, match=f"'/S0/{texts[0]}'"):
        outer.execute()


def test_threads_of_a_concurrence_are_named_by_texts(kit):
    seen = []
    both = smach.Concurrence([Text.OK], Text.OK)
    with both:
        smach.Concurrence.add(
            Text.ONE, kit.Calling(lambda ud: seen.append(threading.current_thread().name) or "ok", ["ok"])
        )
    assert both.execute() is Text.OK
    assert seen == ["smach /ONE"]
    assert both._child_outcomes == {"ONE": "ok"}


@pytest.mark.parametrize("label", [None, ["A"], {}], ids=repr)
def test_n5_what_cannot_be_a_label_is_refused(kit, label):
    with smach.StateMachine(["done"]) as sm:
        with pytest.raises(smach.InvalidStateError, match="a label must be"):
            smach.StateMachine.add(label, kit.Done())
        smach.StateMachine.add("A", kit.Done())
    assert sm.execute() == "done"


def test_what_cannot_be_an_outcome_is_refused_where_it_is_returned_or_led_to(kit):
    with pytest.raises(smach.InvalidTransitionError, match=r"\['done'\]"):
        kit.machine(kit.Calling(lambda ud: ["done"])).execute()
    both = smach.Concurrence(["done"], "done", outcome_cb=lambda outcomes: ["done"])
    with both:
        smach.Concurrence.add("A", kit.Done())
    with pytest.raises(smach.InvalidTransitionError, match="outcome_cb"):
        both.execute()
    with smach.StateMachine(["done"]):
        with pytest.raises(smach.InvalidTransitionError, match="not a label"):
            smach.StateMachine.add("A", kit.Done(), {"done": ["A"]})
        smach.StateMachine.add("A", kit.Done())


@pytest.mark.parametrize(
    "outcome_map, said",
    [
        ({"done": [{"A": "done"}, {"B": "done"}]}, r"outcome_map\['done'\] must be a dict"),
        ({"done": {"A": ["done", "failed"]}}, r"outcome_map\['done'\] must name one outcome of 'A'"),
        ([("done", {"A": "done"})], "outcome_map must be a dict"),
    ],
    ids=["list of dicts", "list of outcomes", "list of pairs"],
)
def test_n3_outcome_maps_of_forks_are_refused_with_the_reason(outcome_map, said):
    with pytest.raises(smach.InvalidStateError, match=said):
        smach.Concurrence(["done"], "done", outcome_map=outcome_map)


@pytest.mark.parametrize("argument", ["transitions", "remapping", "constants"])
def test_n3_a_set_in_place_of_a_dict_is_refused_with_the_reason(kit, argument):
    with smach.StateMachine(["done"]):
        with pytest.raises(smach.InvalidStateError, match=f"'/A': {argument} must be a dict"):
            smach.StateMachine.add("A", kit.Done(), **{argument: {"done", "B"}})
        smach.StateMachine.add("A", kit.Done())
    loop = smach.Iterator(["done"], [], [], it=[1])
    with loop, pytest.raises(smach.InvalidStateError, match="final_outcome_map must be a dict"):
        smach.Iterator.set_contained_state("A", kit.Done(), final_outcome_map={"done"})


def test_a_path_with_an_empty_label_is_not_that_of_its_container(kit):
    def broken(ud):
        raise ValueError

    sm = smach.StateMachine(["done"])
    with sm:
        smach.StateMachine.add("", kit.machine(kit.Calling(broken), outcomes=["done"]))
    with pytest.raises(smach.InvalidUserCodeError, match="State '//S0'"):
        sm.execute()
