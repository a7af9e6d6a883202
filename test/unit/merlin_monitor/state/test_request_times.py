# SPDX-License-Identifier: Apache-2.0
"""What the queue shows of requests in time: as was expected first, and as it was."""

from merlin_monitor.state.request_times import REMEMBERED, SHOWN, RequestTimes, Shown

GOALS = ["(checked hall)"]
HALL = Shown(["hall checked"], GOALS, 30.0)


def test_an_ended_request_has_the_first_expectation_and_its_real_times() -> None:
    times = RequestTimes()
    times.expect("a", 10.0, 20.0, HALL)
    assert not times.begin("a", 12.0, GOALS)
    assert times.expect("a", 12.0, 31.0, HALL) == [10.0, 20.0], "the first one is kept"
    assert times.begin("a", 25.0, GOALS), "it goes on"
    times.end("a", 33.0, "late")
    assert times.ended() == [
        {
            "request": "a",
            "words": ["hall checked"],
            "goals": GOALS,
            "planned": [10.0, 20.0],
            "real": [12.0, 33.0],
            "deadline": 30.0,
            "state": "late",
        }
    ]
    assert times.began("a") is None and times.goals("a") == GOALS


def test_what_never_ran_or_had_no_expectation_ends_without_them() -> None:
    times = RequestTimes()
    assert times.expect("a", 0.0, 0.0, HALL) == [0.0, 0.0], "not known"
    times.end("a", 5.0, "cancelled")
    (ended,) = times.ended()
    assert ended["planned"] is None and ended["real"] is None and ended["words"] == ["hall checked"]
    assert times.expect("a", 7.0, 8.0, HALL) == [7.0, 8.0], "sent again"


def test_what_is_kept_is_bounded() -> None:
    times = RequestTimes()
    for number in range(REMEMBERED + 10):
        times.begin(str(number), 0.0, GOALS)
        times.expect(str(number), 0.0, 1.0, HALL)
    assert times.began("9") is None and times.began("10") is not None
    for number in range(SHOWN + 3):
        times.end(str(number), 2.0, "succeeded")
    assert [each["request"] for each in times.ended()] == [str(number) for number in range(3, SHOWN + 3)]


def test_an_earlier_life_of_the_monitor_goes_on() -> None:
    times = RequestTimes()
    times.remember({"request": "a", "began": 5.0, "goals": GOALS, "planned": [4.0, 9.0], "words": []})
    times.remember({"request": "b", "began": 6.0, "goals": GOALS})  # of a version without these fields
    assert times.run("a", 50.0, 70.0, HALL) == {"began": 5.0, "planned": [4.0, 9.0]}
    assert times.run("b", 50.0, 70.0, HALL) == {"began": 6.0, "planned": [6.0, 70.0]}
    assert times.run("", 50.0, 0.0, HALL) == {"began": 0.0, "planned": [0.0, 0.0]}
