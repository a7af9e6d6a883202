# SPDX-License-Identifier: Apache-2.0
"""What the robot knows of an order: facts (wants ?t ?i)."""

from typing import List, Sequence

from merlin_restaurant.menu import MENU
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant


def order_of(robot: MerlinROSPlanAssistant, table: str) -> List[str]:
    """The items that a table wants, in the order of the menu.

    :raises ValueError: nothing is known.
    """
    facts = robot.facts("wants")
    items = [item for item in MENU if f"(wants {table} {item})" in facts]
    if not items:
        raise ValueError(f"what {table} wants is not known")
    return items


def remember_order(robot: MerlinROSPlanAssistant, table: str, items: Sequence[str]) -> None:
    """Takes the place of what the table wanted before."""
    robot.change_facts(
        add=[f"(wants {table} {item})" for item in items], remove=[f"(wants {table} {item})" for item in MENU]
    )
