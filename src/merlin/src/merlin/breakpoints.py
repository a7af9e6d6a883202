# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin breakpoints`: holds before actions, goals and states, and continues them."""

import argparse
import os
import sys
from typing import Callable, Optional

import rospy
from merlin_msgs.msg import ExecutorStatus

from merlin.launch_request import LaunchError
from merlin.running import choose
from merlin.send import EXIT_MISTAKES, executors
from merlin_pddl.breakpoints import BreakpointError
from merlin_planning.knowledge_client import DEFAULT_KNOWLEDGE_BASE, KnowledgeClient
from merlin_ros.node import init_node
from merlin_sm.breakpoint_client import BreakpointClient

LIMIT = 10.0  # s for the Executor's status


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
    return at_robot("merlin breakpoints", given.robot, lambda robot: _do(given, robot))


def at_robot(name: str, robot: Optional[str], do: Callable[[str], None]) -> int:
    """Runs a function as a node beside the running robot; returns the exit code, 2 when it was not done.

    :param name: of the command.
    :param robot: its namespace; None: the only one.
    :param do: takes its namespace, with a slash at its end.
    """
    try:
        uri, found = choose(lambda nodes, services: executors(nodes, robot), "an Executor")
    except LaunchError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return EXIT_MISTAKES
    if len(found) > 1:
        names = ", ".join(each.rpartition("/")[0] for each in found)
        print(f"{name}: there are several robots; choose one, --robot: {names}", file=sys.stderr)
        return EXIT_MISTAKES
    os.environ["ROS_MASTER_URI"] = uri
    sys.argv[1:] = []  # the arguments are not those of a node
    init_node(name.replace(" ", "_"), anonymous=True)
    try:
        do(f"{found[0].rpartition('/')[0]}/")
    except (BreakpointError, rospy.ROSException) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return EXIT_MISTAKES
    finally:
        rospy.signal_shutdown("done")
    return 0


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
