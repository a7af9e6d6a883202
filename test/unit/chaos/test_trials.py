# SPDX-License-Identifier: Apache-2.0
"""Which trials are drawn, and that a seed gives the same ones again."""

import io
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, Iterable, List

import pytest
from chaos import campaign
from chaos.faults import (
    AGAIN,
    CLIENT,
    DESCRIPTORS,
    GUARD,
    LINK,
    MASTER,
    NODES,
    THREADS,
    all_faults,
)
from chaos.judging.rules import Judgement
from chaos.moments import Moment
from chaos.result import Result
from chaos.trials import JOINS, Trial, can_join, draw, known_failures


@pytest.fixture(scope="module")
def drawn() -> List[Trial]:
    """So many that everything which can be drawn is among them."""
    return list(islice(draw(1), 5000))


@pytest.mark.parametrize("seeds", [(0, 1, 1000), pytest.param(range(100), marks=pytest.mark.long)])
def test_equal_seeds_draw_equal_trials(seeds: Iterable[int]) -> None:
    for seed in seeds:
        assert list(islice(draw(seed), 30)) == list(islice(draw(seed), 30))


def test_every_node_meets_every_signal_at_every_moment_respawning_and_alone(drawn: List[Trial]) -> None:
    seen = {(trial.fault.name, trial.moment, not trial.alone) for trial in drawn}
    for node in NODES:
        for signal in ("kill", "stop10", "stop", "term"):
            for moment in Moment:
                for respawn in (True, False):
                    assert (f"{node}:{signal}", moment, respawn) in seen


def test_one_in_some_drives_is_of_several_requests(drawn: List[Trial]) -> None:
    able = [trial for trial in drawn if can_join(trial)]
    joined = [trial for trial in drawn if trial.joined]
    assert len(joined) == len(able) // JOINS and all(map(can_join, joined))
    assert {trial.moment for trial in joined} == {Moment.DRIVING, Moment.PLANNING, Moment.CANCELLING}
    assert {trial.cancel for trial in joined} == {True, False}
    assert all(trial.joined == can_join(trial) for trial in islice(draw(1, joins=1), 500))
    assert [replace(trial, joined=False) for trial in islice(draw(1, joins=1), 500)] == [
        replace(trial, joined=False) for trial in drawn[:500]
    ]


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
        assert GUARD not in (*trial.fault.targets, trial.fault.on)


def test_a_pattern_that_fits_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="no fault fits"):
        next(draw(1, ["warp_drive:kill"]))


def test_a_cut_link_needs_a_network_and_a_dead_guard_a_base_that_stops(drawn: List[Trial]) -> None:
    for trial in drawn:
        assert trial.variant.network == (trial.fault.kind == LINK) or trial.name in known_failures()
        if trial.fault.targets == (GUARD,):
            assert trial.variant.base_timeout is not None
        if {MASTER, CLIENT} & set(trial.fault.targets):
            assert not trial.alone
        if CLIENT in trial.fault.targets:
            assert not trial.cancel


def test_names_of_faults_are_unique() -> None:
    assert not set(all_faults()) & set(known_failures())


def test_every_fault_is_drawn(drawn: List[Trial]) -> None:
    assert {trial.fault.name for trial in drawn} == set(all_faults())


def test_what_is_about_a_drive_strikes_only_a_drive() -> None:
    patterns = ["half_open:*", "forged:*", "plain*", "page:*"]
    assert {trial.moment for trial in islice(draw(1, patterns), 300)} == {Moment.DRIVING}


def test_one_drawn_trial_in_ten_has_a_stop_and_no_known_failure_has() -> None:
    drawn = list(islice(draw(5, ["navigation:*"]), 200))
    assert [number % 10 for number, trial in enumerate(drawn, 1) if trial.stop] == [0] * 20
    assert not any(trial.stop for trial in islice(draw(5, ["known"]), 40))


@pytest.mark.parametrize("kind", ["sockets", "descriptors", "threads"])
def test_a_shortage_always_has_a_stop(kind: str) -> None:
    assert all(trial.stop for trial in islice(draw(5, [f"{kind}:*"]), 50))


def test_what_has_to_stop_the_base_by_itself_has_no_cancel_beside_it() -> None:
    patterns = ["page:*", "half_open:*", "again:*"]
    assert not any(trial.cancel for trial in islice(draw(5, patterns), 50))


def test_the_peer_of_a_node_whose_sockets_are_taken_is_another_one() -> None:
    for fault in all_faults().values():
        assert fault.on not in fault.targets or fault.kind == AGAIN


def test_a_base_that_never_stops_by_itself_has_a_guard_that_lives(drawn: List[Trial]) -> None:
    for trial in drawn:
        if trial.fault.kind in (DESCRIPTORS, THREADS) and trial.fault.on == GUARD:
            assert trial.variant.base_timeout is not None


GOOD = Judgement((), None, None, None, "CANCELLED")
NAMES = ("executor_killed", "navigation_killed", "speech_killed")


class System:
    """Starts at once."""

    logs: Path

    def __init__(self, variant: Any, seed: int) -> None:
        self.variant = variant

    def start(self) -> None:
        pass

    def stop(self, keep: bool = False) -> None:
        pass

    def missing_nodes(self) -> List[str]:
        return []


class Runner:
    """The first trial of one failure comes too late for its moment."""

    def __init__(self, tried: List[Trial]) -> None:
        self._tried = tried

    def run(self, trial: Trial) -> Result:
        late = trial.name == NAMES[0] and NAMES[0] not in [other.name for other in self._tried]
        self._tried.append(trial)
        return Result(trial, None if late else GOOD, "not valid" if late else "")


@pytest.mark.parametrize("seed", range(5))  # another one may take its place, or the same by chance
def test_a_known_failure_that_came_too_late_is_tried_again_at_another_time(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: List[Trial] = []
    runner = Runner(tried)
    monkeypatch.setattr(System, "logs", tmp_path, raising=False)
    monkeypatch.setattr(campaign, "System", System)
    monkeypatch.setattr(campaign, "Runner", lambda *_: runner)
    trials = campaign.Campaign(tmp_path / "trials.csv", {}, io.StringIO())
    assert trials.run(draw(seed, NAMES), len(NAMES), None) == 0
    valid = [row["name"] for row in trials.rows if row["valid"] == "1"]
    assert sorted(valid) == sorted(NAMES)
    assert len({trial.seed for trial in tried}) == len(tried) == len(NAMES) + 1
