# SPDX-License-Identifier: Apache-2.0
"""`rosrun merlin_fleet fleet keep`: removes ended goals where robots lack the rights for it."""

import argparse
import contextlib
import os
import select
import signal
import sys
from typing import Iterator

from merlin_fleet.core.retention import Keeper, Retention
from merlin_fleet.fleet_client import FleetClient, FleetError
from merlin_ros.processes.option_number import option_number

KEPT = Retention()
LOOK = 60.0  # s between two looks; each removes what is due


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "--hours",
        type=option_number("a number from 0 on", 0.0),
        default=KEPT.hours,
        help="kept after a goal's end (%(default)g); 0: any time",
    )
    parser.add_argument(
        "--goals", type=_count, default=KEPT.goals, help="the last ones kept (%(default)d); 0: any number"
    )


def keep(client: FleetClient, given: argparse.Namespace) -> int:
    """Removes what is not kept, until Ctrl-C; returns the exit code.

    :raises FleetError: when the hub does not allow it, or nothing is ever to be removed.
    """
    if not (given.hours or given.goals):
        raise FleetError("with --hours 0 and --goals 0 every goal is kept")
    keeper = Keeper(KEPT._replace(hours=given.hours, goals=given.goals))
    said = ""
    try:
        with _signals() as signals:
            print(f"removes old goals of the fleet '{client.fleet}'  (Ctrl-C ends it)", flush=True)
            while True:
                missing = client.missing
                if missing != said:
                    print(f"fleet keep: {missing or 'the hub is there again'}", file=sys.stderr, flush=True)
                    said = missing
                removed = client.remove_ended(keeper)
                if removed:
                    print(f"removed {removed} ended goals", flush=True)
                _pause(signals, LOOK)
    except KeyboardInterrupt:
        return 0


@contextlib.contextmanager
def _signals() -> Iterator[int]:
    """A descriptor that can be read once a signal has come, also one that came before the wait."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    before = signal.set_wakeup_fd(writing)
    try:
        yield reading
    finally:
        signal.set_wakeup_fd(before)
        os.close(reading)
        os.close(writing)


def _pause(signals: int, seconds: float) -> None:
    """Waits for a time or a signal: goals get old without an event."""
    if select.select([signals], [], [], seconds)[0]:
        os.read(signals, 64)


def _count(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 0 on")
    return int(text)
