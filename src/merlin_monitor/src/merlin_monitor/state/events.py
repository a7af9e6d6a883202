"""What is worth remembering: the events of the history."""

from typing import Any, Callable, Dict, NamedTuple


class Event(NamedTuple):
    """Something that happened.

    Attributes:
        kind: mission, goal, plan, action, machine, knowledge, health, guard, control or monitor.
        text: one line in plain words.
        at: ROS time, s.
        detail: what a timeline draws: ``began`` and ``ended`` (ROS time, s), ``outcome``, ``lane``.
    """

    kind: str
    text: str
    at: float
    detail: Dict[str, Any] = {}


Tell = Callable[[Event], None]
