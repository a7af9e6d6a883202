# SPDX-License-Identifier: Apache-2.0
"""Defects B6, B7 and B11: whatever children do, a container ends and says why."""

import threading

import pytest

import smach


@pytest.mark.parametrize("answer", [None, 5], ids=["none", "number"])
def test_b6_child_that_returns_no_outcome_does_not_hang_a_concurrence(kit, answer):
    other = kit.Waiting()
    container = kit.concurrence(A=kit.Calling(lambda ud: answer), B=other)
    with pytest.raises(smach.InvalidStateError, match="/A"):
        kit.Running(container).end()
    assert other.outcomes == ["preempted"]


def test_b6_termination_callback_that_raises_does_not_hang_a_concurrence(kit):
    def broken(outcomes):
        raise ValueError("in the callback")

    other = kit.Waiting()
    container = smach.Concurrence(["done"], "done", child_termination_cb=broken)
    with container:
        smach.Concurrence.add("A", kit.Done())
        smach.Concurrence.add("B", other)
    with pytest.raises(smach.InvalidStateError, match="(?s)child_termination_cb.*in the callback") as caught:
        kit.Running(container).end()
    assert isinstance(caught.value.__cause__, ValueError)


def test_b6_child_that_raises_ends_a_concurrence_with_its_cause(kit):
    def broken(ud):
        raise ValueError("in the child")

    other = kit.Waiting()
    container = kit.concurrence(A=kit.Calling(broken), B=other)
    with pytest.raises(smach.InvalidStateError, match="(?s)/A.*in the child") as caught:
        kit.Running(container).end()
    assert isinstance(caught.value.__cause__, ValueError)
    assert other.outcomes == ["preempted"]
    assert not container.is_running()


def test_b7_shutdown_preempts_the_children_of_a_concurrence_and_leaves_no_thread(kit, shutdown):
    before = set(threading.enumerate())
    children = {"A": kit.Waiting(), "B": kit.Waiting()}
    container = kit.concurrence(**children)
    run = kit.Running(container)
    for child in children.values():
        assert child.started.wait(kit.LIMIT)
    shutdown.set()
    smach.log.notify_shutdown()
    assert run.end() is None
    assert [child.outcomes for child in children.values()] == [["preempted"], ["preempted"]]
    assert [thread for thread in set(threading.enumerate()) - before if thread.name.startswith("smach")] == []


def test_b7_child_that_ignores_a_shutdown_keeps_neither_the_container_nor_the_process(kit, shutdown, log):
    stubborn = kit.Waiting(obeys=False)
    run = kit.Running(kit.concurrence(STUBBORN=stubborn))
    assert stubborn.started.wait(kit.LIMIT)
    left = [thread for thread in threading.enumerate() if thread.name == "smach /STUBBORN"]
    assert [thread.daemon for thread in left] == [True]
    shutdown.set()
    smach.log.notify_shutdown()
    assert run.end() is None
    assert any("STUBBORN" in text for level, text in log if level == "warn")
    stubborn.release.set()


def test_b11_every_container_says_whether_it_runs(kit):
    loop = smach.Iterator(["done", "preempted"], [], [], it=[1], exhausted_outcome="done")
    state = kit.Waiting()
    with loop:
        smach.Iterator.set_contained_state("A", state, loop_outcomes=["done"])
    for container, leaf in (
        (loop, state),
        *[
            (make(w), w)
            for make, w in ((kit.machine, kit.Waiting()), (lambda w: kit.concurrence(A=w), kit.Waiting()))
        ],
    ):
        assert not container.is_running()
        run = kit.Running(container)
        assert leaf.started.wait(kit.LIMIT)
        assert container.is_running() and not container.wait_until_idle(0.0)
        container.request_preempt()
        assert run.end() == "preempted"
        assert not container.is_running() and container.wait_until_idle()


def test_b11_a_state_does_not_wait_for_the_container_that_executes_it(kit):
    containers = []

    def wait(ud):
        # The state that ends the program runs its preempt handler.
        assert not any(each.wait_until_idle(kit.LIMIT) for each in containers)
        return "done" if all(each.runs_in_this_thread() for each in containers) else "waited"

    inner = kit.machine(kit.Calling(wait))
    containers += [inner, kit.concurrence(A=inner)]
    assert kit.Running(containers[1]).end() == "done"
    assert not any(each.runs_in_this_thread() for each in containers)


def test_n11_a_container_that_runs_cannot_be_executed_again(kit):
    state = kit.Waiting()
    sm = kit.machine(state)
    run = kit.Running(sm)
    assert state.started.wait(kit.LIMIT)
    with pytest.raises(smach.InvalidStateError, match="executed already"):
        sm.execute()
    sm.request_preempt()
    assert run.end() == "preempted"


def test_shutdown_ends_a_machine_between_two_states(kit, shutdown):
    second = kit.Done()
    sm = kit.machine(kit.Calling(lambda ud: shutdown.set() or "done"), second)
    assert sm.execute() is None
    assert second.runs == 0 and not sm.is_running()
