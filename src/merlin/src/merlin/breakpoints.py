# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin breakpoints`: holds before actions, goals and states, and continues them."""

import argparse

import rospy
from merlin_msgs.msg import ExecutorStatus

from merlin.running import at_robot
from merlin_pddl.breakpoints import BreakpointError
from merlin_planning.knowledge_client import DEFAULT_KNOWLEDGE_BASE, KnowledgeClient
from merlin_sm.breakpoint_client import BreakpointClient

LIMIT = 10.0  # s for the Executor's status
ERRORS = (BreakpointError, rospy.ROSException)


def main() -> int:
    """Sets breakpoints, or continues; returns the exit code, 2 when that failed."""
    parser = argparse.ArgumentParser(
        prog="rosrun merlin breakpoints",
        description="Holds the robot before actions, goals, states. Without arguments: says what holds it.",
    )
    parser.add_argument(
        "before", nargs="*", help='"(navigate * kitchen)", * for any argument; NAVIGATE/DRIVE'
    )
    ways = parser.add_mutually_exclusive_group()
    ways.add_argument(
        "--step", action="store_true", help="one action or state begins, and the next one is held"
    )
    ways.add_argument("--continue", dest="go_on", action="store_true", help="what is held goes on")
    ways.add_argument("--clear", action="store_true", help="it goes on, and no breakpoints are left")
    parser.add_argument("--robot", help="namespace of the robot, where there are several")
    given = parser.parse_args()
    return at_robot("merlin breakpoints", given.robot, lambda robot: _do(given, robot), *ERRORS)


def _do(given: argparse.Namespace, robot: str) -> None:
    client = BreakpointClient(KnowledgeClient(f"{robot}{DEFAULT_KNOWLEDGE_BASE}"), robot)
    if given.before:
        client.set(given.before)
    if given.step:
        print(client.step().said)
    elif given.go_on:
        print(client.go_on())
    elif given.clear:
        print(client.clear())
    else:
        status = rospy.wait_for_message(f"{robot}merlin/status", ExecutorStatus, LIMIT)
        breakpoints, states = client.states.look()
        held = [*([status.held] if status.held else []), *states]
        print(f"held before {', '.join(held)}" if held else "not held")
        for text in [*status.breakpoints, *breakpoints]:
            print(f"  {text}")
