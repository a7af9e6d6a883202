"""Which trials are drawn, and that a seed gives the same ones again."""

from itertools import islice

import pytest
from chaos.faults import CLIENT, GUARD, LINK, MASTER, NODES, all_faults
from chaos.moments import Moment
from chaos.trials import draw, known_failures
from hypothesis import given
from hypothesis import strategies as st


@given(st.integers(0, 1000))
def test_equal_seeds_draw_equal_trials(seed: int) -> None:
    assert list(islice(draw(seed), 30)) == list(islice(draw(seed), 30))


def test_every_node_meets_every_signal_at_every_moment_respawning_and_alone() -> None:
    drawn = list(islice(draw(1), 5000))
    seen = {(trial.fault.name, trial.moment, not trial.alone) for trial in drawn}
    for node in NODES:
        for signal in ("kill", "stop10", "stop", "term"):
            for moment in Moment:
                for respawn in (True, False):
                    assert (f"{node}:{signal}", moment, respawn) in seen


def test_each_known_failure_can_be_run_alone() -> None:
    for name in known_failures():
        trials = list(islice(draw(3, [name]), 2))
        assert [trial.name for trial in trials] == [name, name]
        assert trials[0].cancel == known_failures()[name].cancel


def test_known_means_all_known_failures() -> None:
    names = known_failures()
    assert {trial.name for trial in islice(draw(1, ["known"]), len(names))} == set(names)


def test_a_pattern_chooses_faults() -> None:
    assert {trial.fault.name for trial in islice(draw(1, ["navigation:*"]), 100)} == {
        f"navigation:{signal}" for signal in ("kill", "stop", "stop10", "term")
    }


def test_a_start_in_random_order_is_a_fault_like_others() -> None:
    trials = list(islice(draw(1, ["start:*"]), 3))
    assert {(trial.fault.name, trial.moment, trial.variant.shuffled) for trial in trials} == {
        ("start:shuffled", Moment.IDLE, True)
    }
    assert len({trial.seed for trial in trials}) == 3


def test_nodes_that_are_absent_are_left_out() -> None:
    for trial in islice(draw(1, absent=[GUARD]), 3000):
        assert GUARD not in trial.fault.targets


def test_a_pattern_that_fits_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="no fault fits"):
        next(draw(1, ["warp_drive:kill"]))


def test_a_cut_link_needs_a_network_and_a_dead_guard_a_base_that_stops() -> None:
    for trial in islice(draw(1), 3000):
        assert trial.variant.network == (trial.fault.kind == LINK) or trial.name in known_failures()
        if trial.fault.targets == (GUARD,):
            assert trial.variant.base_timeout is not None
        if {MASTER, CLIENT} & set(trial.fault.targets):
            assert not trial.alone
        if CLIENT in trial.fault.targets:
            assert not trial.cancel


def test_names_of_faults_are_unique() -> None:
    assert not set(all_faults()) & set(known_failures())
