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
from merlin_fleet.core.records import ROBOTS, STATUS, Keys, Profile, Status, encode
from merlin_fleet.core.reporting import Outbox
from merlin_fleet.core.robot_lease import LeaseTimes
from merlin_fleet.core.store import Put, Txn
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


@pytest.mark.parametrize("off", [-3600.0, 3600.0])
def test_a_word_of_a_robot_ages_by_the_clock_of_the_client(etcd: EtcdProcess, off: float) -> None:
    keys, began = Keys("lab"), time.time()
    hub = EtcdHub(keys.root, [etcd.endpoint], timeout=20.0)
    clients = [FleetClient("lab", [etcd.endpoint])]

    def say(kind: str, record: Any) -> None:
        hub.transact(Txn(puts=(Put(keys.key(kind, "ann"), encode(record)),)))

    try:
        assert clients[0].wait_for_hub(LONG)
        say(ROBOTS, Profile("ann", heard=began + off))
        assert clients[0].wait(lambda: clients[0].spoke("ann"), LONG)
        first = clients[0].spoke("ann")
        assert began <= first <= time.time()
        say(STATUS, Status(at=began + off + 1.0))
        assert clients[0].wait(lambda: clients[0].spoke("ann") > first, LONG)
        status = clients[0].spoke("ann")
        assert status <= time.time()
        say(ROBOTS, Profile("ann", ("seen",), heard=began + off + 2.0))
        assert clients[0].wait(lambda: clients[0].robots()[0][0].groups, LONG)
        assert clients[0].spoke("ann") == status, "what is shown is its status"
        clients.append(FleetClient("lab", [etcd.endpoint]))
        assert clients[1].wait_for_hub(LONG)
        assert clients[1].spoke("ann") <= time.time(), "it ages from now on at the latest"
        assert off > 0.0 or clients[1].spoke("ann") == began + off + 1.0, "how old it was is not known"
    finally:
        hub.close()
        for client in clients:
            client.close()
