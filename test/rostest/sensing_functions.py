"""Sensing functions as a user writes them."""


def at(msg, params):
    """msg.data names the place; the robot is nowhere else."""
    if msg.data == "nonsense":
        raise RuntimeError("cannot make sense of it")
    return [(f"{robot}:{place}", place == msg.data) for robot in params[0] for place in params[1]]


def painted(res, params):
    """All parts are painted when the service says so."""
    return bool(res.success)
