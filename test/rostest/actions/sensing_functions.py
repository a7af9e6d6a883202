# SPDX-License-Identifier: Apache-2.0
"""Sensing functions as a user writes them."""

from std_srvs.srv import SetBoolRequest

_asked = []


def at(msg, params):
    """msg.data names the place; the robot is nowhere else."""
    if msg.data == "nonsense":
        raise RuntimeError("cannot make sense of it")
    places = sorted({*params[1], msg.data})
    return [(f"{robot}:{place}", place == msg.data) for robot in params[0] for place in places]


def painted(res, params):
    """All parts are painted when the service says so."""
    return bool(res.success)


def look_request():
    """Cannot be made at first."""
    _asked.append(True)
    if len(_asked) == 1:
        raise RuntimeError("not yet")
    return SetBoolRequest(True)
