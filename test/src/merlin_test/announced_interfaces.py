# SPDX-License-Identifier: Apache-2.0
"""Waits for action interfaces; until one is announced, it takes a latched dispatch for an old one."""

import threading
from typing import Set

import rospy
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_test import LONG


def wait_for_interfaces(*operators: str) -> None:
    """Waits until the interfaces of these operators are announced."""
    changed = threading.Condition()  # guards the names
    announced: Set[str] = set()

    def announce(formula: DomainFormula) -> None:
        with changed:
            announced.add(formula.name)
            changed.notify_all()

    subscriber = rospy.Subscriber("rosplan_knowledge_base/pddl_action_parameters", DomainFormula, announce)
    with changed:
        there = changed.wait_for(lambda: set(operators) <= announced, LONG)
    subscriber.unregister()
    assert there, f"no interfaces but {announced}"
