"""The guard's private parameters, checked when they are read."""

import math
from typing import Any, List, NamedTuple

import rospy
from rosgraph.names import is_legal_name

from merlin_guard.settings import GuardSettings
from merlin_ros.parameters import ParameterError

DEFAULT_SERVERS = ("move_base",)
SERVER_WAIT = 30.0  # s; a simulator loads its world that long on a busy machine


class GuardParameters(NamedTuple):
    """The node's parameters."""

    servers: List[str]
    """Resolved names of the actions that move the base."""
    settings: GuardSettings
    server_wait: float
    """s of wall time after which a motion server that never spoke is named in a warning."""
    stop_button: int
    """Index of the button of `joy` that stops the base; -1: none."""


def read_parameters() -> GuardParameters:
    """Reads them.

    :raises ParameterError: when one has the wrong type or a value that makes no sense.
    """
    default = GuardSettings()
    settings = GuardSettings(
        require_lease=_flag("~require_lease", default.require_lease),
        **{
            name: _duration(f"~{name}", value)
            for name, value in default._asdict().items()
            if name != "require_lease"
        },
    )
    try:
        settings.check()
    except ValueError as error:
        raise ParameterError(f"parameters of {rospy.get_name()}: {error}") from error
    return GuardParameters(
        servers=_servers(rospy.get_param("~motion_servers", list(DEFAULT_SERVERS))),
        settings=settings,
        server_wait=_duration("~server_wait", SERVER_WAIT),
        stop_button=_button(rospy.get_param("~stop_button", -1)),
    )


def _servers(value: Any) -> List[str]:
    if not isinstance(value, list) or not value:
        raise ParameterError(
            f"parameter ~motion_servers is {value!r}; it has to be a list of action names, as [move_base]"
        )
    for name in value:
        if not isinstance(name, str) or not name or not is_legal_name(name):
            raise ParameterError(
                f"parameter ~motion_servers has {name!r}, which is not the name of an action"
            )
    return list(dict.fromkeys(rospy.resolve_name(name) for name in value))


def _duration(name: str, default: float) -> float:
    value = rospy.get_param(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ParameterError(f"parameter {name} is {value!r}; it has to be a number of seconds")
    if value <= 0.0:
        raise ParameterError(f"parameter {name} is {value:g}; it has to be more than 0 s")
    return float(value)


def _flag(name: str, default: bool) -> bool:
    value = rospy.get_param(name, default)
    if not isinstance(value, bool):
        raise ParameterError(f"parameter {name} is {value!r}; it has to be true or false")
    return value


def _button(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < -1:
        raise ParameterError(
            f"parameter ~stop_button is {value!r}; it has to be the index of a button, 0 or more, or -1"
        )
    return value
