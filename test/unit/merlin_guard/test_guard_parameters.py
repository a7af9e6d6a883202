# SPDX-License-Identifier: Apache-2.0
"""The guard's parameters: what is known of the base."""

import math
import re

import pytest

from merlin_guard import guard_parameters
from merlin_guard.guard_parameters import read_parameters
from merlin_guard.velocity_limits import VelocityLimits
from merlin_ros.parameters import ParameterError

KNOWN = {
    "~max_speed": 0.5,
    "~max_turn_speed": 1,
    "~max_acceleration": "inf",
    "~max_turn_acceleration": "1e0",
    "~base_timeout": 0.25,
}


@pytest.fixture
def read(monkeypatch):
    def read(**given):
        values = {f"~{name}": value for name, value in given.items()}
        monkeypatch.setattr(
            guard_parameters.rospy, "get_param", lambda name, default=None: values.get(name, default)
        )
        monkeypatch.setattr(guard_parameters.rospy, "resolve_name", lambda name: f"/{name.strip('~/')}")
        return read_parameters()

    return read


def known(**others):
    return {**{name[1:]: value for name, value in KNOWN.items()}, **others}


def test_what_is_known_of_a_base_is_taken(read):
    parameters = read(**known(over_limit="refuse"))
    assert parameters.limits == VelocityLimits(0.5, 1.0, math.inf, 1.0) and parameters.refuse
    assert parameters.base_timeout == 0.25 and parameters.unknown_of_base() == ""


def test_nobody_has_to_say_anything_and_is_reminded_of_it(read):
    parameters = read(max_speed="", base_timeout="")  # as arguments of a launch file that nobody gave
    assert parameters.limits == VelocityLimits() and not parameters.refuse
    text = parameters.unknown_of_base()
    assert "max_speed:=1 max_turn_speed:=2 max_acceleration:=1 max_turn_acceleration:=2" in text
    assert "docs/real-robot.md" in text and "base_timeout" in text


def test_a_base_that_drives_on_for_long_is_named(read):
    assert "drives on for 2 s" in read(**known(base_timeout=2.0)).unknown_of_base()


@pytest.mark.parametrize(
    "name",
    [
        "max_speed",
        "max_turn_speed",
        "max_acceleration",
        "max_turn_acceleration",
        "max_jerk",
        "max_turn_jerk",
        "base_timeout",
    ],
)
@pytest.mark.parametrize("value", [-1.0, "nan", math.nan, "fast", True, [1.0], -math.inf])
def test_a_limit_that_makes_no_sense_is_named(read, name, value):
    with pytest.raises(ParameterError, match=f"~{name} is"):
        read(**known(**{name: value}))


@pytest.mark.parametrize(
    "name, value",
    [
        ("max_speed", 0.0),
        ("max_acceleration", 0),
        ("max_speed", math.inf),
        ("max_jerk", 0),
        ("max_turn_jerk", 0.0),
    ],
)
def test_a_base_has_a_speed_and_its_limit(read, name, value):
    with pytest.raises(ParameterError, match=f"~{name} is"):
        read(**known(**{name: value}))


@pytest.mark.parametrize("value", ["brake", 3, True, []])
def test_what_happens_above_a_limit_is_one_of_two_words(read, value):
    with pytest.raises(ParameterError, match="has to be clamp or refuse"):
        read(over_limit=value)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"cancel_deadline": "soon"}, "~cancel_deadline is 'soon'"),
        ({"command_timeout": -1}, "~command_timeout is -1"),
        ({"motion_servers": "move_base"}, "~motion_servers is 'move_base'; it has to be a list"),
        ({"motion_servers": [3]}, "~motion_servers has 3"),
        ({"motion_servers": []}, "~motion_servers is []"),
        ({"require_lease": "perhaps"}, "~require_lease is 'perhaps'"),
        ({"stop_button": -3}, "~stop_button is -3"),
        ({"max_speed": 0}, "~max_speed is 0; it has to be a number, more than 0"),
        ({"max_turn_speed": "fast"}, "~max_turn_speed is 'fast'"),
        ({"over_limit": "brake"}, "~over_limit is 'brake'; it has to be clamp or refuse"),
        ({"suspend_after": 9.0}, "suspend_after (9 s) is longer than lose_after (3 s)"),
    ],
)
def test_what_cannot_be_used_is_named_with_its_value(read, given, text):
    with pytest.raises(ParameterError, match=re.escape(text)):
        read(**given)
