# SPDX-License-Identifier: Apache-2.0
"""The guard's private parameters, checked when they are read."""

import math
import sys
from typing import Any, Callable, List, NamedTuple

import rospy

from merlin_guard.settings import GuardSettings
from merlin_guard.velocity_limits import VelocityLimits
from merlin_ros.parameters import ParameterError, flag, is_name

DEFAULT_SERVERS = ("move_base",)
CLAMP, REFUSE = "clamp", "refuse"
LONGEST_TIMEOUT = 0.5  # s that a base may go on without commands, as docs/real-robot.md has it checked
LEASE = "require_lease"
SERVER_WAIT = 30.0  # s; a simulator loads its world that long on a busy machine


class GuardParameters(NamedTuple):
    """What the parameters of the guard say, checked."""

    servers: List[str]
    """Resolved names of the actions that move the base."""
    settings: GuardSettings
    server_wait: float
    """s of wall time after which a motion server that never spoke is named in a warning."""
    stop_button: int
    """Index of the button of `joy` that stops the base; -1: none."""
    limits: VelocityLimits
    limits_given: bool
    """Whether all that have a default are set for this robot."""
    refuse: bool
    """Whether zero is sent in place of a velocity above a limit, and not a smaller one."""
    base_timeout: float
    """s without a command after which the base stops by itself; 0: not known."""

    def unknown_of_base(self) -> str:
        """What should be known of the base and is not, one sentence; empty: nothing."""
        said = []
        if not self.limits_given:
            names = " ".join(f"{name}:={value:g}" for name, value in self.limits._asdict().items())
            said.append(f"not all limits of this robot are set; what holds: {names}")
        if not self.base_timeout:
            said.append(
                "it is not set whether the base stops by itself when this guard dies; check it as "
                'docs/real-robot.md says under "The time-out of the base", and set base_timeout'
            )
        elif self.base_timeout > LONGEST_TIMEOUT:
            said.append(
                f"the base drives on for {self.base_timeout:g} s (base_timeout) when this guard dies; set "
                f"the time-out of its driver to {LONGEST_TIMEOUT:g} s or less"
            )
        return "; ".join(said)


def read_parameters() -> GuardParameters:
    """Reads them.

    :raises ParameterError: when one has the wrong type or a value that makes no sense.
    """
    default = GuardSettings()
    times = {name: _seconds(name, value) for name, value in default._asdict().items() if name != LEASE}
    settings = GuardSettings(**times, require_lease=flag(f"~{LEASE}", default.require_lease))
    try:
        settings.check()
    except ValueError as error:
        raise ParameterError(f"parameters of {rospy.get_name()}: {error}") from error
    limits = VelocityLimits()._asdict()
    finite = [name for name, value in limits.items() if math.isfinite(value)]
    return GuardParameters(
        servers=_servers(rospy.get_param("~motion_servers", list(DEFAULT_SERVERS))),
        settings=settings,
        server_wait=_seconds("server_wait", SERVER_WAIT),
        stop_button=_button(rospy.get_param("~stop_button", -1)),
        limits=VelocityLimits(**{name: _limit(name, value) for name, value in limits.items()}),
        limits_given=all(_given(f"~{name}") is not None for name in finite),
        refuse=_refuse(_given("~over_limit")),
        base_timeout=_number(
            "~base_timeout", 0.0, "a number of seconds; empty or 0: not known", lambda s: 0.0 <= s < math.inf
        ),
    )


def _given(name: str) -> Any:
    """A parameter; None when it is missing, or empty as an argument of a launch file that was not given."""
    value = rospy.get_param(name, None)
    return None if value == "" else value


def _number(name: str, default: float, wanted: str, fits: Callable[[float], bool]) -> float:
    """A parameter that may be missing; a text, as `inf` is for YAML, may be a number too."""
    value = _given(name)
    if value is None:
        return default
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not fits(number):  # NaN does not
        raise ParameterError(f"parameter {name} is {value!r}; it has to be {wanted}")
    return number


def _seconds(name: str, default: float) -> float:
    return _number(f"~{name}", default, "a number of seconds, more than 0", lambda s: 0.0 < s < math.inf)


def _limit(name: str, default: float) -> float:
    most, wanted = math.inf, "a number, more than 0"
    if name.endswith("speed"):
        most, wanted = sys.float_info.max, f"{wanted}, and not infinite"
    return _number(f"~{name}", default, wanted, lambda value: 0.0 < value <= most)


def _refuse(value: Any) -> bool:
    if value not in (None, CLAMP, REFUSE):
        raise ParameterError(f"parameter ~over_limit is {value!r}; it has to be {CLAMP} or {REFUSE}")
    return bool(value == REFUSE)


def _servers(value: Any) -> List[str]:
    if not isinstance(value, list) or not value:
        raise ParameterError(
            f"parameter ~motion_servers is {value!r}; it has to be a list of action names, as [move_base]"
        )
    for name in value:
        if not is_name(name):
            raise ParameterError(
                f"parameter ~motion_servers has {name!r}, which is not the name of an action"
            )
    return list(dict.fromkeys(rospy.resolve_name(name) for name in value))


def _button(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < -1:
        raise ParameterError(
            f"parameter ~stop_button is {value!r}; it has to be the index of a button, 0 or more, or -1"
        )
    return value
