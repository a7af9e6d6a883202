# SPDX-License-Identifier: Apache-2.0
"""What has passed of ROS time has passed, whatever becomes of its clock."""

from merlin_ros.work.passed_time import PassedTime


def test_a_clock_that_is_set_back_takes_nothing_away() -> None:
    time = PassedTime(100.0)
    assert [time.look(now) for now in (100.0, 103.0, 40.0, 45.0)] == [100.0, 103.0, 103.0, 108.0]
    assert time.now == 45.0 and time.at(47.0) == 110.0 and time.clock(110.0) == 47.0


def test_nothing_has_passed_where_a_clock_begins() -> None:
    time = PassedTime(0.0)
    time.set(1000.0)
    assert (time.line, time.look(1002.0), time.at(1005.0)) == (0.0, 2.0, 5.0)
