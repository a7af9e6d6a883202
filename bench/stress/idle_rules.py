# SPDX-License-Identifier: Apache-2.0
"""What must hold of a robot whose Executor is idle. Without ROS."""

import math
from typing import Iterator, Mapping, NamedTuple, Optional, Sequence, Tuple

#: m within which the robot is at a point of interest.
NEAR = 0.5


class IdleRobot(NamedTuple):
    """What is known of the robot and its knowledge base."""

    goals: Sequence[str] = ()
    """Goals besides those of the problem, as PDDL text."""
    positions: Sequence[str] = ()
    """The facts of the predicate that says where the robot is."""
    place: Optional[Tuple[float, float]] = None
    """Where the robot is, m; None: not known."""
    points: Mapping[str, Tuple[float, float]] = {}
    """The points of interest, m."""
    is_driving: bool = False
    """Whether the last velocity command was not zero."""


def violations(robot: IdleRobot, predicate: str) -> Iterator[str]:
    """What must not be so, one sentence each.

    :param predicate: of the positions.
    """
    if robot.goals:
        yield f"goals are left in the knowledge base: {list(robot.goals)}"
    if len(robot.positions) != 1:
        yield f"{len(robot.positions)} facts {predicate} hold when idle: {list(robot.positions)}"
    for position in robot.positions:
        # The name of a place, not of a point of interest, says nothing about coordinates.
        point = robot.points.get(position.strip("()").split()[-1])
        if robot.place is not None and point is not None:
            distance = math.dist(robot.place, point)
            if distance > NEAR:
                yield f"{position} holds, but the robot is {distance:.2f} m away from there"
    if robot.is_driving:
        yield "the robot is commanded to drive while the executor is idle"
