# SPDX-License-Identifier: Apache-2.0
"""How old the last recorded moment is, and which run of a history is meant."""

import contextlib
from pathlib import Path

import pytest
from robot_scenario import BEGIN, RobotScenario

from merlin_explain.claims import QuestionError
from merlin_explain.execution.recorded_past import RecordedPast
from merlin_monitor.history.history_file import HistoryError, begin_run, open_for_writing
from merlin_monitor.state.history_store import LONGEST_SEGMENT, HistoryStore
from merlin_monitor.state.state_tree import StateTree
from merlin_pddl.domain import Domain


@pytest.mark.parametrize("jump", [0.0, 3600.0, -86400.0])
def test_a_clock_that_was_set_makes_the_present_neither_old_nor_new(
    scenario: RobotScenario, jump: float
) -> None:
    ticks = 500.0  # of the machine when the scenario began
    scenario.model.tree.set("why", "clock", BEGIN - ticks)
    scenario.wait(10.0)
    with contextlib.closing(scenario.past()) as past:
        age = past.age(past.moment(), ticks + 12.0, BEGIN + 12.0 + jump)
    assert age == pytest.approx(2.0, abs=0.1)


def test_a_monitor_that_goes_on_is_found_after_the_clock_was_set(scenario: RobotScenario) -> None:
    scenario.model.settle()
    with contextlib.closing(open_for_writing(str(scenario.file))) as file:
        file.execute("UPDATE runs SET session = 'master /merlin_monitor'")
        file.commit()
        begin_run(file, BEGIN, "master /other_robot")
    session = "master /merlin_monitor"
    with contextlib.closing(RecordedPast(scenario.file, scenario.domain, session=session)) as past:
        assert past.moment().at == pytest.approx(BEGIN, abs=0.1)


def test_a_run_that_is_not_there_is_named(scenario: RobotScenario) -> None:
    scenario.model.settle()
    with pytest.raises(QuestionError, match="there is no run 3; there are: 1"):
        RecordedPast(scenario.file, scenario.domain, run=3)


def test_what_is_recorded_before_the_time_is_renewed_is_not_of_the_moment_before(
    scenario: RobotScenario,
) -> None:
    scenario.wait(1.0)
    scenario.now += 0.3
    scenario.model.tree.set("now", "later", True)
    scenario.model.record()  # with the time of 0.3 s ago
    scenario.wait(1.0)
    with contextlib.closing(scenario.past(1.1)) as past:
        assert "later" not in past.moment().section("now")
    with contextlib.closing(scenario.past(1.4)) as past:
        assert "later" in past.moment().section("now")


def test_a_segment_that_cannot_be_read_hides_no_other(scenario: RobotScenario) -> None:
    for _ in range(3):
        scenario.wait(LONGEST_SEGMENT + 1.0)
        scenario.wait(1.0)
    with contextlib.closing(scenario.past()) as past:
        begin, end = past.span()
    with contextlib.closing(open_for_writing(str(scenario.file))) as file, file:
        numbers = [number for (number,) in file.execute("SELECT number FROM segments ORDER BY number")]
        for number in (numbers[0], numbers[-1]):
            file.execute("UPDATE frames SET data = zeroblob(9) WHERE segment = ?", (number,))
    with contextlib.closing(scenario.past()) as past:
        first, last = past.span()
        assert begin < first < last < end - LONGEST_SEGMENT
        assert past.moment().at == last
    middle = last - BEGIN - 0.5
    with contextlib.closing(scenario.past(middle)) as past:
        assert past.moment().at <= last
    with contextlib.closing(open_for_writing(str(scenario.file))) as file, file:
        file.execute("UPDATE frames SET data = zeroblob(9)")
    with pytest.raises(HistoryError, match="nothing that was shown in run 1 can be read"):
        scenario.past()


def test_of_a_simulator_that_was_begun_anew_the_last_life_is_meant(tmp_path: Path) -> None:
    wall = [BEGIN]
    tree, store = StateTree(), HistoryStore(tmp_path / "history", 1000, clock=lambda: wall[0])
    store.follow(tree, live=False)
    clock_was_set = [*range(0, 30, 2), 27.5, *range(30, 60, 2)]
    for life, times in (("first", [*range(10, 500, 10)]), ("second", clock_was_set)):
        for at in times:
            wall[0] += 1.0
            tree.set("meta", "time", float(at))
            tree.set("now", "doing", f"{life} {at}")
            store.take()
    store.close()
    for at, doing in ((58.0, "second 58"), (30.0, "second 30"), (11.0, "second 10"), (0.0, "second 58")):
        with contextlib.closing(RecordedPast(tmp_path / "history", Domain(""), at)) as past:
            assert past.moment().section("now")["doing"] == doing
    with pytest.raises(QuestionError, match="the recording is of 2.0 s to 58.0 s, and has no 450.0 s"):
        RecordedPast(tmp_path / "history", Domain(""), 450.0)
