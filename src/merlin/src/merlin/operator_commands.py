# SPDX-License-Identifier: Apache-2.0
"""The commands `rosrun merlin leave` and `rosrun merlin autonomy`: what is decided about machines."""

import argparse
import getpass

from merlin.breakpoints import ERRORS
from merlin.running import at_robot
from merlin_sm.autonomy import LEVELS
from merlin_sm.breakpoint_client import MachineNodes


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
