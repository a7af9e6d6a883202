# SPDX-License-Identifier: Apache-2.0
"""Defects D1 to D9 and D11: definitions are checked before they run, and share nothing with others."""

import threading

import pytest

import smach
from merlin_test import LONG


@pytest.fixture
def logged_errors():
    """What smach logs as errors."""
    before, errors = (smach.loginfo, smach.logwarn, smach.logdebug, smach.logerr), []
    smach.set_loggers(*before[:3], errors.append)
    yield errors
    smach.set_loggers(*before)


def in_thread(function):
    """Runs a function in another thread; returns what it returned."""
    results = []
    thread = threading.Thread(target=lambda: results.append(function()), daemon=True)
    thread.start()
    thread.join(LONG)
    assert results, "the other thread hangs or failed"
    return results[0]


def test_a_state_that_was_not_made_is_refused_by_its_class():
    class Forgets(smach.State):
        def __init__(self):
            pass

    for container in (smach.StateMachine(["done"]), smach.Sequence(["done"], "done")):
        refusal = pytest.raises(smach.InvalidStateError, match=r"'/A': Forgets.__init__ does not call super")
        with refusal, container:
            container.add("A", Forgets())


def test_a_sequence_names_transitions_that_are_no_mapping(kit):
    refusal = pytest.raises(smach.InvalidStateError, match="'/A': transitions must be a dict")
    with refusal, smach.Sequence(["done"], "done"):
        smach.Sequence.add("A", kit.Done(), 5)


def test_containers_cannot_contain_each_other():
    outer, inner, innermost = (smach.StateMachine(["done"]) for _ in range(3))
    with outer:
        smach.StateMachine.add("B", inner)
    with inner:
        smach.StateMachine.add("C", innermost)
    refusal = pytest.raises(smach.InvalidStateError, match="'/B/C/A': a container cannot contain itself")
    with refusal, innermost:
        smach.StateMachine.add("A", outer)


def test_d1_exception_while_building_leaves_no_container_open(kit):
    sm = smach.StateMachine(["done"])
    with pytest.raises(ZeroDivisionError), sm:
        smach.StateMachine.add("A", kit.Done())
        raise ZeroDivisionError
    assert not sm.is_opened()
    with pytest.raises(smach.InvalidStateError):
        smach.StateMachine.add("B", kit.Done())
    assert in_thread(lambda: kit.machine(kit.Done()).execute()) == "done"


def test_d1_exception_of_the_user_is_not_hidden_by_a_consistency_error(kit):
    with pytest.raises(ZeroDivisionError), smach.StateMachine(["done"]).opened():
        raise ZeroDivisionError


def test_d2_transitions_of_the_caller_stay_as_they_are(kit):
    shared = {"done": "end"}
    sm = smach.StateMachine(["end", "other"])
    with sm:
        smach.StateMachine.add("A", kit.Calling(lambda ud: "other", ["done", "other"]), shared)
        smach.StateMachine.add("B", kit.Done(), shared)
    assert shared == {"done": "end"}
    assert sm.execute() == "other"


def test_d3_iterator_leaves_the_outcomes_of_the_caller_as_they_are(kit):
    outcomes = ["done"]
    smach.Iterator(outcomes, [], [])
    assert outcomes == ["done"]


def test_d3_arguments_of_one_object_do_not_reach_another():
    first, second = smach.State(), smach.State()
    first.register_outcomes(["a"])
    first.register_io_keys(["k"])
    assert second.get_registered_outcomes() == () and second.get_registered_input_keys() == ()
    args, kwargs = [1], {"b": 2}
    state = smach.CBState(lambda ud, *a, **k: f"{a}{k}", args, kwargs)
    args.append(3)
    kwargs["c"] = 4
    assert state.execute(None) == "(1,){'b': 2}"


@pytest.mark.parametrize(
    "transitions, initial",
    [({"done": "NOWHERE"}, None), ({}, None), ({"done": "end"}, "NOWHERE")],
    ids=["target", "no transition", "initial state"],
)
def test_d4_inconsistent_machine_is_logged_when_it_is_closed_and_raises_when_it_is_executed(
    kit, logged_errors, transitions, initial
):
    inner, outer = smach.StateMachine(["end"]), smach.StateMachine(["end"])
    with outer:
        smach.StateMachine.add("INNER", inner)
        with inner:
            smach.StateMachine.add("A", kit.Done(), transitions)
            if initial:
                inner.set_initial_state([initial])
    assert len(logged_errors) == 1 and "/INNER" in logged_errors[0] and (initial or "A") in logged_errors[0]
    assert not inner.is_opened() and not outer.is_opened()
    with pytest.raises(smach.SmachError, match="(?s)/INNER"):
        outer.execute()


def test_d4_empty_machine_raises(kit):
    with smach.StateMachine(["done"]) as empty:
        pass
    with pytest.raises(smach.InvalidStateError, match="no states"):
        empty.execute()


def test_d4_containers_are_completed_in_a_second_block(kit):
    """Programs do: the first block leads to a state that the second one adds."""
    sm = smach.StateMachine(["end"])
    with sm:
        smach.StateMachine.add("A", kit.Done(), {"done": "B"})
    both = smach.Concurrence(["yes", "no"], "no", outcome_map={"yes": {"C": "done", "D": "done"}})
    with both:
        smach.Concurrence.add("C", kit.Done())
    with both:
        smach.Concurrence.add("D", kit.Done())
    with sm:
        smach.StateMachine.add("B", both, {"yes": "end", "no": "A"})
    assert sm.execute() == "end"


def test_d5_concurrence_refuses_a_label_twice(kit):
    container = smach.Concurrence(["done"], "done")
    with container:
        smach.Concurrence.add("A", kit.Done())
        with pytest.raises(smach.InvalidStateError, match="/A"):
            smach.Concurrence.add("A", kit.Done())


@pytest.mark.parametrize("criteria", [{"B": "done"}, {"A": "unheard"}], ids=["child", "outcome"])
def test_d5_outcome_map_that_speaks_of_what_does_not_exist_raises(kit, criteria):
    container = smach.Concurrence(["done"], "done", outcome_map={"done": criteria})
    with container:
        smach.Concurrence.add("A", kit.Done())
    with pytest.raises(smach.SmachError, match=next(iter(criteria))):
        container.execute()


@pytest.mark.parametrize("arguments", [{"default_outcome": "x"}, {"outcome_map": {"x": {}}}])
def test_d5_policy_for_an_unregistered_outcome_raises(arguments):
    with pytest.raises(smach.InvalidStateError, match="'x'"):
        smach.Concurrence(**{"outcomes": ["done"], "default_outcome": "done", **arguments})


def test_d6_concurrence_refuses_an_unregistered_outcome_of_a_child(kit):
    container = kit.concurrence(A=kit.Calling(lambda ud: "unheard"))
    with pytest.raises(smach.SmachError, match="unheard"):
        kit.Running(container).end()


def test_d7_threads_build_at_the_same_time_without_mixing(kit):
    machines = {name: smach.StateMachine(["done"]) for name in ("A", "B")}
    both_open, both_added = threading.Barrier(2, timeout=LONG), threading.Barrier(2, timeout=LONG)

    def build(name):
        # With one lock for all this would hang; with one stack for all both would add to the same machine.
        with machines[name]:
            both_open.wait()
            smach.StateMachine.add(name, kit.Done())
            both_added.wait()

    other = threading.Thread(target=build, args=("B",), daemon=True)
    other.start()
    build("A")
    other.join(LONG)
    assert {name: list(sm.get_children()) for name, sm in machines.items()} == {"A": ["A"], "B": ["B"]}


def test_d9_set_initial_state_of_concurrence_and_iterator(kit):
    userdata = smach.UserData()
    userdata.x = 1
    container = kit.concurrence(A=kit.Done(), B=kit.Done())
    container.set_initial_state(["A", "B"], userdata)
    assert container.userdata.x == 1
    with pytest.raises(smach.InvalidStateError, match="NOWHERE"):
        container.set_initial_state(["NOWHERE"])
    loop = smach.Iterator(["done"], [], [], it=[1])
    with loop:
        smach.Iterator.set_contained_state("A", kit.Done(), loop_outcomes=["done"])
    loop.set_initial_state(["A"], userdata)
    assert loop.userdata.x == 1


def test_d11_interface_of_a_callback_has_its_io_keys():
    @smach.cb_interface(outcomes=["done"], input_keys=["a"], output_keys=["b"], io_keys=["c"])
    def callback(ud):
        return "done"

    assert callback.get_registered_input_keys() == ("a", "c")
    assert callback.get_registered_output_keys() == ("b", "c")
    state = smach.CBState(callback)
    assert state.get_registered_output_keys() == ("b", "c")
    assert smach.has_smach_interface(callback) and not smach.has_smach_interface(len)


def test_d11_arguments_of_opened_are_those_of_every_add(kit):
    sm = smach.StateMachine(["end", "done"])
    with sm.opened(transitions={"done": "end", "unknown here": "end"}, remapping={"x": "y"}):
        smach.StateMachine.add("A", kit.Done(io_keys=["x"]))
        smach.StateMachine.add("B", kit.Done(), {"done": "done"})
    assert sm.get_internal_edges() == [("done", "A", "end"), ("done", "B", "done")]
    assert sm._remappings["A"] == {"x": "y"}
    with pytest.raises(smach.InvalidStateError, match="transition"), sm.opened(transition={}):
        smach.StateMachine.add("C", kit.Done())


def test_errors_of_add_say_where_and_what(kit):
    sm = smach.StateMachine(["done"])
    with sm:
        smach.StateMachine.add("A", kit.Done())
        with pytest.raises(smach.InvalidTransitionError, match="(?s)/B.*'other'"):
            smach.StateMachine.add("B", kit.Done(), {"other": "A"})
        with pytest.raises(smach.InvalidStateError, match="/A"):
            smach.StateMachine.add("A", kit.Done())
        with pytest.raises(smach.InvalidStateError, match="/C"):
            smach.StateMachine.add("C", "no state")
        with pytest.raises(smach.InvalidStateError, match="not a Concurrence"):
            smach.Concurrence.add("D", kit.Done())
    assert list(sm.get_children()) == ["A"]


@pytest.mark.parametrize(
    "arguments", [{"outcomes": "done"}, {"input_keys": [None]}, {"outcomes": [["a"]]}, {"io_keys": "ab"}]
)
def test_n4_lists_of_names_that_are_none_raise_type_error(arguments):
    with pytest.raises(TypeError):
        smach.State(**arguments)


def test_n4_tuples_are_lists_of_names():
    state = smach.State(outcomes=("done",), input_keys=("a",), io_keys=("b",))
    assert state.get_registered_outcomes() == ("done",) and state.get_registered_input_keys() == ("a", "b")


def test_n6_what_is_open_belongs_to_the_thread_and_to_no_attribute(kit):
    with smach.StateMachine(["done"]) as sm:
        smach.StateMachine.add("A", kit.Done())
        assert smach.Container._currently_opened_container() is sm
        assert not hasattr(sm, "_construction_stack") and not hasattr(sm, "_construction_lock")
        with pytest.raises(smach.InvalidStateError, match="not a Concurrence"):
            smach.Concurrence._currently_opened_container()

    def in_another_thread():
        with sm, pytest.raises(smach.InvalidStateError, match="Iterator"):
            smach.Iterator._currently_opened_container()
        return True

    assert in_thread(in_another_thread)
