"""How long deadlines are."""

import math
import threading

import pytest

from merlin_ros.deadline import Deadline, limit


@pytest.mark.parametrize("seconds", [0.0, -1.0])
def test_zero_has_passed(seconds):
    assert Deadline(seconds).expired
    assert not Deadline(seconds).wait_event(threading.Event())
    with threading.Condition() as condition:
        assert not Deadline(seconds).wait(condition, lambda: False)


def test_none_never_passes():
    assert Deadline(None).remaining() == math.inf


def test_what_holds_already_is_no_matter_of_time():
    happened = threading.Event()
    happened.set()
    assert Deadline(0.0).wait_event(happened)


def test_a_parameter_of_zero_is_no_limit():
    assert [limit(seconds) for seconds in (2.0, 0.0, -1.0)] == [2.0, None, None]
