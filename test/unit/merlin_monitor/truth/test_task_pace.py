# SPDX-License-Identifier: Apache-2.0
"""How long the tasks of a mission take: of those that were seen from their beginning to their end."""

from merlin_monitor.truth.worst_truth import TaskPace


def pace_of(*tasks: "tuple[int, float]") -> TaskPace:
    pace = TaskPace()
    for number, at in tasks:
        pace.task(number, at)
    return pace


def test_the_median_of_the_tasks_that_have_ended() -> None:
    assert pace_of((0, 1.0), (1, 10.0)).shown() == {}
    assert pace_of((1, 10.0), (1, 15.0), (2, 30.0)).shown() == {"since": 30.0, "pace": 20.0}
    # One that waited for an operator for long does not count for the others.
    assert pace_of((1, 0.0), (2, 20.0), (3, 400.0), (4, 422.0)).shown() == {"since": 422.0, "pace": 22.0}


def test_a_task_that_was_seen_in_part_does_not_count() -> None:
    assert pace_of((4, 100.0), (5, 101.0)).shown() == {}
    assert pace_of((4, 100.0), (5, 101.0), (6, 131.0)).shown()["pace"] == 30.0
    assert pace_of((1, 0.0), (2, 10.0), (5, 12.0), (6, 14.0)).shown()["pace"] == 10.0


def test_a_mission_that_begins_anew_has_its_own_pace() -> None:
    pace = pace_of((1, 0.0), (2, 10.0), (1, 50.0))
    assert pace.shown() == {}
    pace.task(2, 80.0)
    assert pace.shown() == {"since": 80.0, "pace": 30.0}


def test_a_monitor_that_is_started_again_goes_on() -> None:
    pace = TaskPace()
    pace.take_up({"task": 3, "since": 40.0, "pace": 20.0})
    pace.task(3, 50.0)
    assert pace.shown() == {"since": 40.0, "pace": 20.0}
    pace.task(4, 70.0)
    assert pace.shown() == {"since": 70.0, "pace": 25.0}


def test_simulated_time_that_is_set_back_begins_a_new_pace() -> None:
    pace = pace_of((1, 100.0), (2, 200.0), (3, 5.0))
    assert pace.shown() == {}
    pace.task(4, 25.0)
    assert pace.shown() == {"since": 25.0, "pace": 20.0}
