# SPDX-License-Identifier: Apache-2.0
"""How fast a velocity may be that reaches the base, and how fast it may grow."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_guard.velocity_limits import CREDIT, STANDING, Velocity, VelocityLimiter, VelocityLimits

LIMITS = VelocityLimits(1.0, 2.0, 1.0, 2.0)
SOFT = VelocityLimits(1.0, 2.0, 1.0, 2.0, 4.0, 8.0)
SPEEDS_ONLY = VelocityLimits(1.0, 2.0, math.inf, math.inf)


class Base:
    """What a base gets whose navigation sends one velocity after the other."""

    def __init__(self, limits=LIMITS, refuse=False):
        self.limiter = VelocityLimiter(limits, refuse)
        self.now = 100.0
        self.fault = ""

    def gets(self, x=0.0, y=0.0, yaw=0.0, after=0.05):
        self.now += after
        sent, self.fault = self.limiter.judge(Velocity(x=x, y=y, yaw=yaw), self.now)
        self.limiter.sent(sent, self.now)
        return sent

    def drive(self, x=0.0, y=0.0, yaw=0.0):
        while self.gets(x, y, yaw) != Velocity(x=x, y=y, yaw=yaw):
            pass
        return self


def test_what_is_within_the_limits_goes_as_it_is():
    base = Base(SPEEDS_ONLY)
    for asked in (Velocity(x=1.0, yaw=2.0), Velocity(x=-0.6, y=0.8, yaw=-2.0), STANDING):
        assert base.gets(asked.x, asked.y, asked.yaw) == asked and not base.fault


@pytest.mark.parametrize("asked", [1e300, -1e300, 1.7e308])
def test_no_velocity_is_too_large(asked):
    base = Base(SPEEDS_ONLY)
    sent = base.gets(asked)
    assert sent.x == pytest.approx(math.copysign(1.0, asked)) and "above the limits" in base.fault


def test_speed_and_turning_are_scaled_together():
    sent = Base(SPEEDS_ONLY).gets(x=4.0, y=3.0, yaw=1.0)
    assert sent == pytest.approx(Velocity(x=0.8, y=0.6, yaw=0.2))
    assert Base(SPEEDS_ONLY).gets(x=0.5, yaw=-8.0) == pytest.approx(Velocity(x=0.125, yaw=-2.0))


@pytest.mark.parametrize("part", ["x", "y", "z", "roll", "pitch", "yaw"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_zero(part, value):
    sent, fault = Base().limiter.judge(Velocity(x=0.1)._replace(**{part: value}), 1.0)
    assert sent == STANDING and "not finite" in fault


@pytest.mark.parametrize("part", ["z", "roll", "pitch"])
def test_a_base_on_the_floor_does_not_leave_it(part):
    sent, fault = Base().limiter.judge(Velocity(x=0.1)._replace(**{part: 1e-3}), 1.0)
    assert sent == STANDING and "leaves the floor" in fault


def test_what_is_above_a_limit_is_zero_where_that_is_wanted():
    base = Base(SPEEDS_ONLY, refuse=True)
    assert base.gets(1.1) == STANDING and "zero is sent" in base.fault
    assert base.gets(1.0) == Velocity(x=1.0) and not base.fault


def test_a_speed_grows_step_by_step_and_on_its_curve():
    base = Base()
    sent = [base.gets(0.3, yaw=0.3) for _ in range(8)]
    assert sent[0].x == pytest.approx(CREDIT) and sent[1].x == pytest.approx(CREDIT + 0.05)
    assert sent[-1] == Velocity(x=0.3, yaw=0.3) and all(each.x == each.yaw for each in sent)


def test_a_base_that_gets_slower_or_stops_does_so_at_once():
    base = Base().drive(1.0, yaw=2.0)
    assert base.gets(0.5, yaw=1.0) == Velocity(x=0.5, yaw=1.0) and not base.fault
    assert base.gets() == STANDING and not base.fault
    assert base.gets(0.5, after=0.0).x < CREDIT


def test_the_other_direction_begins_from_zero():
    base = Base().drive(1.0)
    assert -CREDIT - 1e-9 <= base.gets(-1.0).x < 0.0


def test_a_late_command_may_not_jump():
    base = Base()
    base.gets(0.0)
    assert base.gets(1.0, after=3600.0).x == pytest.approx(CREDIT)


def test_commands_in_a_bunch_gain_nothing():
    base = Base()
    assert [base.gets(1.0, after=1e-6).x for _ in range(100)][-1] < CREDIT + 0.001


def test_growth_begins_anew_when_the_guard_has_stopped_the_base():
    base = Base().drive(1.0)
    base.limiter.stood()
    assert base.gets(1.0).x <= CREDIT + 1e-9


@pytest.mark.parametrize("asked", [{"x": 1.0}, {"y": -1.0}, {"yaw": 2.0}])
def test_a_drive_begins_softly_where_jerk_has_a_limit(asked):
    base = Base(SOFT)
    gone, (largest,) = [0.0], asked.values()
    while gone[-1] < abs(largest):
        gone.append(max(map(abs, base.gets(**asked))))
        assert ("grows faster" in base.fault) == (gone[-1] < abs(largest))
    rates = [(after - before) / 0.05 / abs(largest) for before, after in zip(gone, gone[1:])]
    # The first command has a saved tenth of a second; the last step ends with what was asked for.
    assert rates[:4] == pytest.approx([0.4 * 2, 0.6, 0.8, 1.0]) and rates[4:-1] == [pytest.approx(1.0)] * 16


@pytest.mark.parametrize("kept", [0.0, 0.1])
def test_jerk_does_not_slow_a_base_that_stops_or_gets_slower(kept):
    base = Base(SOFT)
    while base.gets(1.0).x < 0.6:
        pass  # with the whole acceleration by now
    assert base.gets(kept) == Velocity(x=kept) and not base.fault
    assert base.gets(1.0, after=CREDIT).x == pytest.approx(kept + 4.0 * CREDIT**2), "it begins anew"


def test_a_drive_that_the_guard_has_stopped_begins_softly():
    base = Base(SOFT).drive(0.6)
    base.limiter.stood()
    assert base.gets(1.0, after=CREDIT).x == pytest.approx(4.0 * CREDIT**2)


def test_commands_in_a_bunch_gain_no_acceleration():
    base = Base(SOFT)
    assert [base.gets(1.0, after=1e-6).x for _ in range(1000)][-1] < 4.0 * (CREDIT + 0.001) ** 2


NUMBERS = st.floats(-3.0, 3.0) | st.floats(allow_nan=False, allow_infinity=False)
LIMIT = st.floats(0.05, 5.0)
COMMANDS = st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS, st.floats(0.0, 1.0)), max_size=30)


@given(st.builds(VelocityLimits, LIMIT, LIMIT, *[LIMIT | st.just(math.inf)] * 4), COMMANDS)
def test_whatever_is_asked_for(limits, commands):
    base, before, spent, drives = Base(limits), STANDING, [0.0], 0.0
    for x, y, yaw, after in commands:
        sent = base.gets(x, y, yaw, after)
        assert sent.speed <= limits.max_speed * (1 + 1e-6)
        assert abs(sent.yaw) <= limits.max_turn_speed * (1 + 1e-6)
        for asked, part in ((x, sent.x), (y, sent.y), (yaw, sent.yaw)):
            assert asked * part >= 0.0 and abs(part) <= abs(asked)
        scale = max(abs(x), abs(y), abs(yaw)) or 1.0
        largest = max(map(abs, sent)) or 1.0
        for asked, part in ((x, sent.x), (y, sent.y), (yaw, sent.yaw)):
            if any(sent):
                assert part / largest == pytest.approx(asked / scale, abs=1e-6), "it left its curve"
        if not (x or y or yaw):
            assert sent == STANDING and not base.fault
        # Growth since any earlier moment is within the acceleration.
        grown = max(0.0, sent.speed - before.speed)
        spent = [max(0.0, each - after * limits.max_acceleration) + grown for each in spent] + [0.0]
        assert max(spent) <= limits.max_acceleration * (CREDIT + 1e-6) + 1e-6
        drives = drives + after if sent.speed else 0.0
        assert sent.speed <= limits.max_jerk * (drives + CREDIT + 1e-6) ** 2 + 1e-6
        before = sent


def test_the_defaults_are_those_of_the_simulated_robot():
    from merlin_sim.robot.diff_drive import DriveLimits

    base = DriveLimits()
    assert VelocityLimits()[:4] == (base.speed, base.turn_speed, base.acceleration, base.turn_acceleration)
