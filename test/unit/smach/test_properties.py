# SPDX-License-Identifier: Apache-2.0
"""Random nested machines under preempt requests at random moments: they end, and leave no flag behind."""

import contextlib
import threading
from unittest import mock

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import smach

LIMIT = 60.0  # s after which a run counts as hanging
OUTCOMES = ["done", "failed", "preempted"]


class Leaf(smach.State):
    """Goes through a script: at each step it may look for a request, ignore it, or let time pass.

    :param script: steps.
    :param outcome: at the end.
    """

    def __init__(self, script, outcome):
        smach.State.__init__(self, outcomes=OUTCOMES)
        self.script, self.outcome = script, outcome
        self.wake = threading.Event()

    def request_preempt(self):
        smach.State.request_preempt(self)
        self.wake.set()

    def execute(self, ud):
        for step in self.script:
            if step == "wait":
                self.wake.wait(0.002)
                self.wake.clear()
            elif step == "look" and self.preempt_requested():
                self.service_preempt()
                return "preempted"
            elif step == "recall":
                self.recall_preempt()
        return self.outcome


leaves = st.builds(
    Leaf,
    st.lists(st.sampled_from(["wait", "look", "recall"]), max_size=4),
    st.sampled_from(["done", "failed"]),
)


def build_machine(children, targets):
    sm = smach.StateMachine(outcomes=OUTCOMES)
    with sm:
        for i, child in enumerate(children):
            later = [f"S{j}" for j in range(i + 1, len(children))] + [None]
            transitions = {
                outcome: later[targets[(3 * i + k) % len(targets)] % len(later)]
                for k, outcome in enumerate(OUTCOMES)
            }
            smach.StateMachine.add(f"S{i}", child, transitions)
    return sm


def build_concurrence(children, hasty):
    container = smach.Concurrence(
        outcomes=OUTCOMES,
        default_outcome="done",
        outcome_map={"failed": {"C0": "failed"}},
        child_termination_cb=(lambda outcomes: hasty),
    )
    with container:
        for i, child in enumerate(children):
            smach.Concurrence.add(f"C{i}", child)
    return container


def build_iterator(child, count):
    loop = smach.Iterator(OUTCOMES, [], [], it=range(count), exhausted_outcome="done")
    with loop:
        smach.Iterator.set_contained_state("I", child, break_outcomes=["failed"])
    return loop


def containers(children):
    return st.one_of(
        st.builds(
            build_machine,
            st.lists(children, min_size=1, max_size=3),
            st.lists(st.integers(0, 5), min_size=1, max_size=9),
        ),
        st.builds(build_concurrence, st.lists(children, min_size=1, max_size=3), st.booleans()),
        st.builds(build_iterator, children, st.integers(0, 3)),
    )


trees = st.recursive(leaves, containers, max_leaves=8).flatmap(
    lambda tree: st.just(tree) if isinstance(tree, smach.Container) else containers(st.just(tree))
)


def all_states(state):
    yield state
    if isinstance(state, smach.Container):
        for child in state.get_children().values():
            yield from all_states(child)


@contextlib.contextmanager
def threads_begun():
    """Collects the threads that this one begins, and those that these begin.

    What an earlier test of this process has left may begin others meanwhile.
    """
    here, begun, start = threading.current_thread(), [], threading.Thread.start

    def noted(thread):
        if threading.current_thread() in (here, *begun):
            begun.append(thread)
        start(thread)

    with mock.patch.object(threading.Thread, "start", noted):
        yield begun


def execute(tree, delays):
    """Executes a tree in a thread while this one preempts it after each of the delays, s."""
    results = []

    def run():
        try:
            results.append(tree.execute())
        except BaseException as error:
            results.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    for delay in delays:
        thread.join(delay)
        tree.request_preempt()
    thread.join(LIMIT)
    assert not thread.is_alive(), "hangs"
    return results[0]


@settings(
    max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
)
@given(trees, st.lists(st.floats(0.0, 0.01), max_size=4))
def test_random_machines_end_with_a_registered_outcome_and_clear_flags(tree, delays):
    smach.set_loggers(*[lambda text: None] * 4)
    with threads_begun() as threads:
        run_twice(tree, delays)
    assert [thread for thread in threads if thread.is_alive()] == []


def run_twice(tree, delays):
    assert execute(tree, delays) in tree.get_registered_outcomes()
    tree.request_preempt()  # while idle; the next run must not see it
    seen = {}
    for state in all_states(tree):
        if isinstance(state, smach.Container):
            seen[state] = []
            state.register_start_cb(lambda ud, states, s=state: seen[s].append(s.preempt_requested()))
    assert execute(tree, []) in tree.get_registered_outcomes()
    assert seen[tree] == [False]
    if not has_hasty_concurrence(tree):  # which preempts containers as they start
        assert not any(any(asked) for asked in seen.values())
    assert [state for state in all_states(tree) if state.preempt_requested()] == []
    assert not any(s.is_running() for s in all_states(tree) if isinstance(s, smach.Container))


def has_hasty_concurrence(tree):
    """Whether some Concurrence preempts its children by itself."""
    return any(isinstance(s, smach.Concurrence) and s._child_termination_cb({}) for s in all_states(tree))


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, 7), st.lists(st.sampled_from(["machine", "concurrence", "iterator"]), max_size=4))
def test_request_at_any_transition_ends_a_machine_of_looking_states(moment, nesting):
    """Whenever the request comes, the state that runs then or the one after it is preempted."""
    smach.set_loggers(*[lambda text: None] * 4)
    leaves = [Leaf(["look"], "done") for _ in range(8)]
    sm = build_machine(leaves, [0])  # every outcome leads to the next state

    class Preempts(smach.State):
        def __init__(self):
            smach.State.__init__(self, outcomes=OUTCOMES)

        def execute(self, ud):
            root.request_preempt()  # this state ignores it
            return "done"

    sm._states[f"S{moment}"] = Preempts()
    preempted = []
    for leaf in leaves:
        leaf.service_preempt = lambda leaf=leaf: (preempted.append(leaf), smach.State.service_preempt(leaf))
    root = sm
    for kind in nesting:
        root = (
            build_machine([root], [0])
            if kind == "machine"
            else build_concurrence([root], False)
            if kind == "concurrence"
            else build_iterator(root, 1)
        )
    assert execute(root, []) in root.get_registered_outcomes()
    assert preempted == leaves[moment + 1 : moment + 2]
