# SPDX-License-Identifier: Apache-2.0
"""A robot or a client over a real etcd whose clock is far from the hub's."""

import re
import time
import uuid
from typing import Any, Iterator, List

import pytest
from waiting_body import DoesAtOnce

from merlin_fleet import fleet_client, fleet_robot
from merlin_fleet.commands.fleet_command import main, words
from merlin_fleet.core.agent import Agent, Rules
from merlin_fleet.core.auction import AuctionTimes
from merlin_fleet.core.records import Profile
from merlin_fleet.core.reporting import Outbox
from merlin_fleet.core.robot_lease import LeaseTimes
from merlin_fleet.fleet_client import FleetClient
from merlin_fleet.fleet_robot import FleetRobot, FleetStatus
from merlin_fleet.hub import EtcdHub
from merlin_test import LONG
from merlin_test.etcd_process import EtcdProcess

pytestmark = pytest.mark.processes

#: A test machine may stand still for many seconds.
RULES = Rules(LeaseTimes(ttl=60.0, renew_every=0.5, stop_time=1.0), AuctionTimes(0.1, 30.0))


@pytest.fixture
def etcd() -> Iterator[EtcdProcess]:
    made = EtcdProcess()
    yield made
    made.close()


class WrongClock:
    """The module `time` of a machine whose clock is off; gRPC keeps the right one."""

    def __init__(self, off: float) -> None:
        self._off = off

    def __getattr__(self, name: str) -> Any:
        return (lambda: time.time() + self._off) if name == "time" else getattr(time, name)


@pytest.mark.parametrize(("off", "where"), [(-3600.0, "behind"), (3600.0, "ahead of")])
def test_a_deadline_by_a_wrong_clock_is_refused(
    etcd: EtcdProcess,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
    off: float,
    where: str,
) -> None:
    monkeypatch.setattr(fleet_client, "time", WrongClock(off))
    assert main(["send", "--hub", etcd.endpoint, "(done a)", "--begin-by", "600"]) == 2
    said = f"fleet send: the clock of this machine is 3[56]\\d\\d s {where} the hub's: .*\n"
    assert re.fullmatch(said, capsys.readouterr().err)
    assert main(["send", "--hub", etcd.endpoint, "(done a)"]) == 0


def test_a_robot_with_a_wrong_clock_says_so_and_the_goal_waits(
    etcd: EtcdProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = FleetClient("lab", [etcd.endpoint])
    goal = client.send("(done a)", begin_by=6000.0)
    monkeypatch.setattr(fleet_robot, "time", WrongClock(7200.0))
    statuses: List[FleetStatus] = []
    agent = Agent("lab", Profile("r1"), uuid.uuid4().hex, Outbox(), RULES)
    hub = EtcdHub(agent.keys.root, [etcd.endpoint], timeout=20.0)
    robot = FleetRobot(agent, hub, DoesAtOnce(), print, on_status=statuses.append)
    robot.start()
    try:
        why = "its clock is ahead of the hub's"
        assert client.wait(lambda: goal.news and goal.news.refusals.get("r1") == why, LONG)
        assert goal.result is None
        assert statuses[-1].clock.endswith(" s ahead of the hub's")
        assert goal.news is not None and "no robot that is joined can do it" in words(goal.news)
        monkeypatch.undo()
        assert goal.wait(LONG)
        assert goal.result is not None and goal.result.outcome == "SUCCEEDED"
    finally:
        robot.close()
        client.close()
