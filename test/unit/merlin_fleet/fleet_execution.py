"""What is on its way in a small fleet, and what its robots do."""

from typing import NamedTuple

TAKES = 3  # rounds of an execution


class Message(NamedTuple):
    """A question of a robot that is on its way to the hub."""

    robot: int
    life: str
    sent_at: float
    decision: object


class Execution:
    """What a robot's Executor does for the fleet."""

    def __init__(self) -> None:
        self.left = TAKES
        self.stopping = False
        self.stop_takes = 1  # rounds
