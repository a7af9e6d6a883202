# SPDX-License-Identifier: Apache-2.0
"""The faults of a fleet: what is done, to which robot or hub, and for how long."""

import signal
import time
from typing import Callable, Dict, NamedTuple

from fleet.setup import FLEET
from fleet.system import Fleet
from merlin_fleet.core.records import Keys

FLEET_NODE = "merlin_fleet"
FOR_EVER = float("inf")  # until every goal has ended


class Fault(NamedTuple):
    """A fault of the campaign."""

    words: str
    begin: Callable[[Fleet, str], None]
    """Gets the robot that it is about; a fault of the hub does not look at it."""
    end: Callable[[Fleet, str], None]
    lasts: float
    takes_over: bool = False
    """Whether another robot has the goals, within 27 s."""


def _cut(fleet: Fleet, robot: str) -> None:
    fleet.network.shape(robot, loss=1.0)


def _lossy(fleet: Fleet, robot: str) -> None:
    fleet.network.shape(robot, loss=0.2, delay=0.2)


def _mend(fleet: Fleet, robot: str) -> None:
    fleet.network.shape(robot)


def _kill(fleet: Fleet, robot: str) -> None:
    fleet.robots[robot].kill()
    fleet.ledger.kill(robot, time.monotonic())


def _start(fleet: Fleet, robot: str) -> None:
    fleet.start(robot)


def _hang(fleet: Fleet, robot: str) -> None:
    fleet.robots[robot].send(signal.SIGSTOP)
    fleet.ledger.hang(robot)


def _resume(fleet: Fleet, robot: str) -> None:
    fleet.ledger.resume(robot, time.monotonic())
    fleet.robots[robot].send(signal.SIGCONT)


def _node(number: int) -> Callable[[Fleet, str], None]:
    return lambda fleet, robot: fleet.robots[robot].send(number, FLEET_NODE)


def _hubs(number: int) -> Callable[[Fleet, str], None]:
    return lambda fleet, robot: fleet.hubs.send(number, fleet.hubs.members)


def _one_hub(fleet: Fleet, robot: str) -> None:
    # Whichever the robots are connected to: all three over many trials.
    fleet.hubs.send(signal.SIGKILL, [int(time.monotonic()) % len(fleet.hubs.members)])


def _start_hubs(fleet: Fleet, robot: str) -> None:
    fleet.hubs.start()


def _revoke(fleet: Fleet, robot: str) -> None:
    fleet.hubs.revoke(Keys(FLEET), robot)


def _cut_and_revoke(fleet: Fleet, robot: str) -> None:
    _cut(fleet, robot)
    _revoke(fleet, robot)


def _fill_hub(fleet: Fleet, robot: str) -> None:
    fleet.hubs.fill()


def _free_hub(fleet: Fleet, robot: str) -> None:
    fleet.hubs.make_room()


def _fill_robot(fleet: Fleet, robot: str) -> None:
    fleet.disks[robot].fill()


def _free_robot(fleet: Fleet, robot: str) -> None:
    fleet.disks[robot].free()


def _nothing(fleet: Fleet, robot: str) -> None:
    pass


FAULTS: Dict[str, Fault] = {
    "none": Fault("nothing", _nothing, _nothing, 0.0),
    "cut_1": Fault("link cut for 1 s", _cut, _mend, 1.0),
    "cut_10": Fault("link cut for 10 s", _cut, _mend, 10.0),
    "cut": Fault("link cut until all is done", _cut, _mend, FOR_EVER, True),
    "lossy": Fault("link loses 20 %, 0.2 s late, for 20 s", _lossy, _mend, 20.0),
    "killed": Fault("robot killed", _kill, _start, FOR_EVER, True),
    "hung_10": Fault("robot hung for 10 s", _hang, _resume, 10.0),
    "hung_30": Fault("robot hung for 30 s", _hang, _resume, 30.0, True),
    "node_killed": Fault("its fleet node killed, and started again", _node(signal.SIGKILL), _nothing, 0.0),
    "node_hung": Fault(
        "its fleet node hung for 30 s", _node(signal.SIGSTOP), _node(signal.SIGCONT), 30.0, True
    ),
    "hub_killed": Fault("all hubs killed, back after 10 s", _hubs(signal.SIGKILL), _start_hubs, 10.0),
    "hub_hung": Fault("all hubs hung for 10 s", _hubs(signal.SIGSTOP), _hubs(signal.SIGCONT), 10.0),
    "one_hub": Fault("one of three hubs killed", _one_hub, _start_hubs, FOR_EVER),
    "revoked": Fault("its lease ended with a copy of its certificate", _revoke, _nothing, 0.0),
    "cut_revoked": Fault(
        "link cut, and its lease ended so, until all is done", _cut_and_revoke, _mend, FOR_EVER, True
    ),
    "hub_disk": Fault("the hubs' database at its quota for 20 s", _fill_hub, _free_hub, 20.0),
    "robot_disk": Fault("the robot's disk full for 20 s", _fill_robot, _free_robot, 20.0),
}
