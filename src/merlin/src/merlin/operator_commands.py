# SPDX-License-Identifier: Apache-2.0
"""The commands `rosrun merlin breakpoints`, `leave` and `autonomy`: holds and outcomes of what runs."""

import argparse
import getpass

import rospy
from merlin_msgs.msg import ExecutorStatus

from merlin.running import at_robot
from merlin_pddl.breakpoints import BreakpointError
from merlin_planning.knowledge_client import DEFAULT_KNOWLEDGE_BASE, KnowledgeClient
from merlin_sm.autonomy import LEVELS
from merlin_sm.breakpoint_client import BreakpointClient, MachineNodes

LIMIT = 10.0  # s for the Executor's status
ERRORS = (BreakpointError, rospy.ROSException)


def breakpoints() -> int:
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
    _add_robot(parser)
    given = parser.parse_args()
    return at_robot("merlin breakpoints", given.robot, lambda robot: _breakpoints(given, robot), *ERRORS)


def _breakpoints(given: argparse.Namespace, robot: str) -> None:
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
        texts, states = client.states.look()
        held = [*([status.held] if status.held else []), *states]
        print(f"held before {', '.join(held)}" if held else "not held")
        for text in [*status.breakpoints, *texts]:
            print(f"  {text}")


def leave() -> int:
    """Makes a state end with an outcome; returns the exit code, 2 when that failed."""
    parser = argparse.ArgumentParser(
        prog="rosrun merlin leave",
        description="Has a state of a machine left with an outcome; without one, confirms what waits.",
    )
    parser.add_argument("state", help="that runs, is held or waits: NAVIGATE/DRIVE")
    parser.add_argument("outcome", nargs="?", default="", help="that the state has registered")
    _add_robot(parser)
    given = parser.parse_args()
    by = f"{_user()} on a terminal"

    def do(robot: str) -> None:
        print(MachineNodes(robot).leave(given.state, given.outcome, by))

    return at_robot("merlin leave", given.robot, do, *ERRORS)


def autonomy() -> int:
    """Sets the autonomy level; returns the exit code, 2 when it was not done."""
    parser = argparse.ArgumentParser(
        prog="rosrun merlin autonomy",
        description="Sets up to which autonomy level the machines of a robot leave states by themselves.",
    )
    parser.add_argument("level", choices=LEVELS)
    _add_robot(parser)
    given = parser.parse_args()

    def do(robot: str) -> None:
        MachineNodes(robot).set_autonomy(given.level)
        print(f"The autonomy level is {given.level}.")

    return at_robot("merlin autonomy", given.robot, do, *ERRORS)


def _add_robot(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", help="namespace of the robot, where there are several")


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container may have no names of users
        return "a user"
