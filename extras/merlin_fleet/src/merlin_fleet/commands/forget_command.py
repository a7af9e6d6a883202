# SPDX-License-Identifier: Apache-2.0
"""`rosrun merlin_fleet fleet forget`: removes what a robot has left that never comes back."""

import argparse
import sys
from typing import Iterable

from merlin_fleet.core.clock import moment
from merlin_fleet.fleet_client import FleetClient, FleetError
from merlin_fleet.forgetting import Leavings

VOUCH = "never-comes-back"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("robot", help="its name")
    parser.add_argument(
        f"--{VOUCH}",
        action="store_true",
        help="the robot does nothing any more: its goals to finish go to other robots",
    )


def forget(client: FleetClient, given: argparse.Namespace) -> int:
    """Removes what a robot has left, and says what that was; returns the exit code.

    :raises FleetError: when the robot is in the fleet, is not known, or may still execute a goal.
    """
    left = client.leavings(given.robot)
    if left.joined:
        raise FleetError(f"the robot '{left.robot}' is in the fleet '{client.fleet}'; nothing was removed")
    if not left.known:
        raise FleetError(f"no robot '{left.robot}' has ever joined the fleet '{client.fleet}'")
    if left.owned and not given.never_comes_back:
        raise FleetError(
            f"{left.robot} owns goals to finish, and may still execute them: {', '.join(left.owned)}. "
            f"When it is switched off for good, or its MERLIN is, repeat this with --{VOUCH}: "
            "other robots get them then. `fleet cancel` before that ends them"
        )
    if left.owned:
        print(
            f"fleet forget: warning: should {left.robot} still execute {', '.join(left.owned)}, two robots "
            "do it at once until it hears of the hub; then it stops, and its end counts as late",
            file=sys.stderr,
            flush=True,
        )
    client.forget(left)
    for line in _removed(left):
        print(line)
    return 0


def _removed(left: Leavings) -> Iterable[str]:
    heard = moment(left.heard) if left.heard else "not known when"
    yield f"{left.robot} is forgotten (last seen: {heard})"
    opened = [goal for goal in left.owned if goal not in left.cancelled]
    if opened:
        yield f"open again: {', '.join(opened)}"
    if left.cancelled:
        yield f"over, as they were cancelled: {', '.join(left.cancelled)}"
    if left.only:
        yield f"only {left.robot} may do these, they wait: {', '.join(goal.id for goal in left.only)}"
    yield (
        f"removed: records of {len(left.gone)} goals that are gone, "
        f"{len(left.late)} late reports, facts of {len(left.facts)} predicates"
    )
    if left.kept:
        yield (
            f"kept: how it did {len(left.kept)} goals that the fleet still keeps; "
            "repeat this when those are removed"
        )
