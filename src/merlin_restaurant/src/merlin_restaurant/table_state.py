# SPDX-License-Identifier: Apache-2.0
"""Which state a table is in, from what the camera saw there."""

import math
from typing import List, Sequence, Tuple

from merlin_restaurant.menu import DISHES
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_sm.states.navigation import point_of_interest
from merlin_sm.states.recognition import Recognized

STATES = ("needs_serving", "already_served", "needs_cleaning", "ready")
AHEAD = 0.9  # m from a table's point of interest, straight ahead, to the middle of the table
REACH = 0.55  # m from the middle within which a thing stands on the table
SEAT = 1.15  # m from the middle within which a person sits at the table


def spot(name: str, ahead: float = AHEAD) -> Tuple[float, float]:
    """The place that lies straight ahead of a robot at a point of interest; m, frame map."""
    pose = point_of_interest(name).pose
    yaw = 2 * math.atan2(pose.orientation.z, pose.orientation.w)
    return pose.position.x + ahead * math.cos(yaw), pose.position.y + ahead * math.sin(yaw)


def seen_near(detections: Sequence[Recognized], place: Tuple[float, float], reach: float) -> List[str]:
    """Class names of what was seen within a reach (m) of a place of the map."""
    return [item.name for item in detections if math.dist(place, item.position[:2]) <= reach]


def people_at(table: str, detections: Sequence[Recognized]) -> int:
    """How many people sit at a table."""
    return seen_near(detections, spot(table), SEAT).count("person")


def dishes_on(table: str, detections: Sequence[Recognized]) -> List[str]:
    """What stands on a table."""
    return [name for name in seen_near(detections, spot(table), REACH) if name in DISHES]


def decide(people: int, dishes: Sequence[str]) -> str:
    """The state of a table: one of STATES."""
    if people:
        return "already_served" if dishes else "needs_serving"
    return "needs_cleaning" if dishes else "ready"


def remember_state(robot: MerlinROSPlanAssistant, table: str, state: str) -> None:
    """Makes one of the four states true and the others false; an order of guests that left is forgotten.

    Where the domain has waiters, the next guest gets a new one.
    """
    forgotten = [f"({other} {table})" for other in STATES if other != state]
    added = [f"({state} {table})"]
    if state != "needs_serving":
        forgotten.append(f"(ordered {table})")
        if "waiter" in robot.knowledge.predicates():
            added.append(f"(unclaimed {table})")
            forgotten += [fact for fact in robot.facts("waiter") if fact.endswith(f" {table})")]
    robot.change_facts(add=added, remove=forgotten)
