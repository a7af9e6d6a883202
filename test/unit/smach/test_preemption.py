# SPDX-License-Identifier: Apache-2.0
"""Defects P1 to P8: preempt requests are neither lost nor do they outlive the run they were made in."""

import threading

import pytest

import smach


def flags(container):
    """All preempt flags of a tree of containers."""
    found = [container.preempt_requested()]
    for child in container.get_children().values():
        found += flags(child) if isinstance(child, smach.container.Container) else [child.preempt_requested()]
    return found


@pytest.mark.parametrize("kind", ["machine", "concurrence", "iterator"])
def test_p1_request_to_an_idle_container_does_not_preempt_its_next_run(kit, kind):
    state = kit.Checking()
    if kind == "machine":
        container = kit.machine(state)
    elif kind == "concurrence":
        container = kit.concurrence(A=state)
    else:
        container = smach.Iterator(["done", "preempted"], [], [], it=[1], exhausted_outcome="done")
        with container:
            smach.Iterator.set_contained_state("A", state, loop_outcomes=["done"])
    container.request_preempt()
    assert container.execute() == "done"
    assert state.outcomes == ["done"]


def test_p1_request_that_no_state_serviced_does_not_preempt_the_next_run(kit):
    stubborn = kit.Waiting(obeys=False)
    sm = kit.machine(stubborn)
    run = kit.Running(sm)
    assert stubborn.started.wait(kit.LIMIT)
    sm.request_preempt()
    stubborn.release.set()
    assert run.end() == "done"
    assert flags(sm) == [False, False]
    stubborn.obeys = True
    stubborn.release.set()
    assert sm.execute() == "done"


def test_p1_request_to_an_idle_nested_machine_does_not_preempt_it(kit):
    state = kit.Checking()
    inner = kit.machine(state)
    outer = kit.machine(kit.Done(), inner)
    inner.request_preempt()
    assert outer.execute() == "done"
    assert state.outcomes == ["done"]


def test_p2_second_request_to_the_same_state_reaches_it(kit):
    class Twice(smach.State):
        """Recalls the first request, ends at the second."""

        def __init__(self):
            smach.State.__init__(self, outcomes=["done", "preempted"])
            self.asked = threading.Semaphore(0)
            self.recalled = threading.Event()

        def request_preempt(self):
            smach.State.request_preempt(self)
            self.asked.release()

        def execute(self, ud):
            assert self.asked.acquire(timeout=kit.LIMIT)
            self.recall_preempt()
            self.recalled.set()
            if not self.asked.acquire(timeout=kit.LIMIT):
                return "done"
            self.service_preempt()
            return "preempted"

    state = Twice()
    sm = kit.machine(state)
    run = kit.Running(sm)
    while not state.recalled.is_set():
        sm.request_preempt()
        if state.recalled.wait(0.01):
            break
    sm.request_preempt()
    assert run.end() == "preempted"


@pytest.mark.parametrize("kind", ["start", "transition"])
def test_p3_request_from_a_callback_is_served(kit, kind):
    last = kit.Checking()
    sm = kit.machine(kit.Checking(), last)
    getattr(sm, f"register_{kind}_cb")(lambda *args: sm.request_preempt())
    assert kit.Running(sm).end() == "preempted"


def test_p3_request_from_a_termination_callback_is_for_the_run_that_ends(kit):
    sm = kit.machine(kit.Checking())
    sm.register_termination_cb(lambda *args: sm.request_preempt())
    assert kit.Running(sm).end() == "done"
    assert kit.Running(sm).end() == "done"


def test_p4_concurrence_passes_on_a_request_that_was_there_first(kit):
    child = kit.Waiting()
    container = kit.concurrence(A=child)
    container.register_start_cb(lambda *args: container.request_preempt())
    assert kit.Running(container).end() == "preempted"
    assert child.outcomes == ["preempted"]


def test_p4_concurrence_entered_under_a_pending_request_preempts_its_children(kit):
    stubborn, child = kit.Waiting(obeys=False), kit.Waiting()
    sm = kit.machine(stubborn, kit.concurrence(A=child))
    run = kit.Running(sm)
    assert stubborn.started.wait(kit.LIMIT)
    sm.request_preempt()
    stubborn.release.set()
    assert run.end() == "preempted"
    assert child.outcomes == ["preempted"]


def test_p5_request_after_the_children_ended_keeps_their_results_and_goes_on(kit):
    after = kit.Checking()
    container = smach.Concurrence(
        ["both", "other", "preempted"], "other", outcome_map={"both": {"A": "done"}}
    )
    with container:
        smach.Concurrence.add("A", kit.Done())
    sm = smach.StateMachine(["done", "preempted"])
    with sm:
        smach.StateMachine.add("C", container, {"both": "AFTER", "other": "done"})
        smach.StateMachine.add("AFTER", after)
    # The last transition callback runs when the only child has ended.
    container.register_transition_cb(lambda ud, active: None if active else sm.request_preempt())
    assert kit.Running(sm).end() == "preempted"
    assert after.outcomes == ["preempted"]


def test_p5_request_that_a_child_ignored_goes_on_to_the_next_state(kit):
    stubborn, after = kit.Waiting(obeys=False), kit.Checking()
    sm = kit.machine(kit.concurrence(A=stubborn), after)
    run = kit.Running(sm)
    assert stubborn.started.wait(kit.LIMIT)
    sm.request_preempt()
    stubborn.release.set()
    assert run.end() == "preempted"
    assert after.outcomes == ["preempted"]


def test_p6_concurrence_preempted_in_vain_starts_clean_the_next_time(kit):
    stubborn = kit.Waiting(obeys=False)
    container = kit.concurrence(A=stubborn)
    run = kit.Running(container)
    assert stubborn.started.wait(kit.LIMIT)
    container.request_preempt()
    stubborn.release.set()
    assert run.end() == "done"
    assert flags(container) == [False, False]
    stubborn.release.set()
    assert kit.Running(container).end() == "done"


def test_p7_concurrence_without_the_outcome_preempted_ends_with_one_it_has(kit):
    child = kit.Waiting()
    container = smach.Concurrence(
        outcomes=["stopped", "other"], default_outcome="other", outcome_map={"stopped": {"A": "preempted"}}
    )
    with container:
        smach.Concurrence.add("A", child)
    sm = smach.StateMachine(["stopped", "other"])
    with sm:
        smach.StateMachine.add("C", container)
    run = kit.Running(sm)
    assert child.started.wait(kit.LIMIT)
    sm.request_preempt()
    assert run.end() == "stopped"


def test_p8_child_preempted_by_the_termination_callback_as_it_ends_starts_clean(kit):
    first = kit.Waiting(obeys=False)
    container = smach.Concurrence(["done", "preempted"], "done", child_termination_cb=lambda outcomes: True)
    gate = threading.Event()
    with container:
        smach.Concurrence.add("A", first)
        smach.Concurrence.add("B", kit.Calling(lambda ud: "done" if gate.wait(kit.LIMIT) else "late"))
    run = kit.Running(container)
    assert first.started.wait(kit.LIMIT)
    gate.set()  # B ends; its end preempts A, which ends without having noticed
    assert first.asked.wait(kit.LIMIT)
    first.release.set()
    assert run.end() == "done"
    assert flags(container) == [False, False, False]
    first.release.set()
    assert kit.Running(container).end() == "done"
    assert first.outcomes == ["done", "done"]


def test_p8_request_on_its_way_to_a_state_that_ends_goes_on_to_the_next(kit):
    on_its_way = threading.Event()

    class Slow(smach.State):
        """Ends while a request is still on its way to it."""

        def __init__(self):
            smach.State.__init__(self, outcomes=["done"])

        def request_preempt(self):
            on_its_way.set()
            threading.Event().wait(0.1)
            smach.State.request_preempt(self)

        def execute(self, ud):
            started.set()
            assert on_its_way.wait(kit.LIMIT)
            return "done"

    started, after = threading.Event(), kit.Checking()
    sm = kit.machine(Slow(), after)
    run = kit.Running(sm)
    assert started.wait(kit.LIMIT)
    sm.request_preempt()
    assert run.end() == "preempted"
    assert after.outcomes == ["preempted"]
    assert not any(flags(sm))


def test_request_made_from_within_the_state_reaches_it(kit):
    sm = smach.StateMachine(["preempted", "done"])

    class Self(smach.State):
        def __init__(self):
            smach.State.__init__(self, outcomes=["done", "preempted"])

        def execute(self, ud):
            sm.request_preempt()
            if self.preempt_requested():
                self.service_preempt()
                return "preempted"
            return "done"

    with sm:
        smach.StateMachine.add("A", Self())
    assert kit.Running(sm).end() == "preempted"


def test_request_reaches_a_leaf_eight_containers_deep(kit):
    leaf = kit.Waiting()
    container = leaf
    for level in range(8):
        container = kit.machine(container) if level % 2 else kit.concurrence(C=container)
    run = kit.Running(container)
    assert leaf.started.wait(kit.LIMIT)
    container.request_preempt()
    assert run.end() == "preempted"
    assert not any(flags(container))


def test_request_after_prepare_run_counts_even_before_execute(kit):
    state = kit.Checking()
    sm = kit.machine(state)
    sm.request_preempt()
    sm.prepare_run()
    assert not sm.preempt_requested()
    sm.request_preempt()
    assert sm.execute() == "preempted"
    assert sm.execute() == "done"


def test_request_that_came_first_reaches_a_machine_run_inside_a_state(kit):
    """A state that runs a machine of its own and passes requests on to it, as many programs do."""
    leaf = kit.Checking()
    inner = kit.machine(leaf)
    inside, asked = threading.Event(), threading.Event()

    class Wrapper(smach.State):
        def __init__(self):
            smach.State.__init__(self, outcomes=["done", "preempted"])

        def request_preempt(self):
            smach.State.request_preempt(self)
            inner.request_preempt()
            asked.set()

        def execute(self, ud):
            inside.set()
            assert asked.wait(kit.LIMIT)
            return inner.execute()

    sm = kit.machine(Wrapper())
    run = kit.Running(sm)
    assert inside.wait(kit.LIMIT)
    sm.request_preempt()
    assert run.end() == "preempted"
    assert leaf.outcomes == ["preempted"]


def test_a_state_that_raises_in_request_preempt_does_not_keep_it_from_its_siblings(kit, log):
    class Broken(kit.Waiting):
        def request_preempt(self):
            raise RuntimeError("no")

    broken, child = Broken(), kit.Waiting()
    container = kit.concurrence(A=broken, B=child)
    run = kit.Running(container)
    assert broken.started.wait(kit.LIMIT)
    assert child.started.wait(kit.LIMIT)
    container.request_preempt()
    assert child.asked.wait(kit.LIMIT)
    broken.release.set()
    run.end()
    assert any("request_preempt() raised" in text for level, text in log if level == "error")


@pytest.mark.parametrize("nested", [False, True])
def test_one_request_at_any_moment_ends_a_machine_that_would_run_for_ever(kit, log, nested):
    """A request lost between two states, or between execute() and the first, would never come again."""
    loop = smach.StateMachine(["preempted"])
    with loop:
        smach.StateMachine.add("A", kit.Checking(), {"done": "B"})
        smach.StateMachine.add("B", kit.Checking(), {"done": "A"})
    root = loop
    if nested:
        both = smach.Concurrence(["preempted", "other"], "other")
        with both:
            smach.Concurrence.add("LOOP", loop)
            smach.Concurrence.add("WAITS", kit.Waiting())
        root = smach.StateMachine(["preempted", "other"])
        with root:
            smach.StateMachine.add("BOTH", both, {"other": "BOTH"})
    for i in range(100):
        root.prepare_run()
        run = kit.Running(root)
        threading.Event().wait(i * 3e-5)
        root.request_preempt()
        assert run.end() == "preempted"
        assert not any(flags(root))


@pytest.mark.parametrize("container", ["machine", "concurrence", "iterator"])
def test_a_request_whose_child_ends_before_it_hears_of_it_is_not_lost(kit, container):
    """The child ends after the request was noted by its container and before it was passed on."""
    free, ended = threading.Event(), threading.Event()

    def work(ud):
        assert free.wait(kit.LIMIT)
        return "done"

    child = kit.Calling(work)
    if container == "machine":
        inner = smach.StateMachine(["done"])
        with inner:
            smach.StateMachine.add("WORK", child, {"done": "done"})
    elif container == "concurrence":
        inner = smach.Concurrence(["done"], "done")
        with inner:
            smach.Concurrence.add("WORK", child)
    else:
        inner = smach.Iterator(["done"], [], [], it=[1], exhausted_outcome="done")
        with inner:
            smach.Iterator.set_contained_state("WORK", child, loop_outcomes=["done"])
    root = smach.StateMachine(["done", "preempted"])
    with root:
        smach.StateMachine.add("FIRST", inner, {"done": "CHECK"})
        smach.StateMachine.add("CHECK", kit.Checking(), {"done": "done"})
    pass_on = inner._forward_preempt
    started = threading.Event()
    inner.register_start_cb(lambda *_: started.set())
    inner.register_termination_cb(lambda *_: ended.set())

    def pass_on_too_late(children):
        if children:
            free.set()
            assert ended.wait(kit.LIMIT)
        pass_on(children)

    inner._forward_preempt = pass_on_too_late
    run = kit.Running(root)
    assert started.wait(kit.LIMIT)
    while not inner._smach_executing:
        threading.Event().wait(0.001)
    root.request_preempt()
    assert run.end() == "preempted"
