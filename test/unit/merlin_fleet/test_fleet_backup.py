# SPDX-License-Identifier: Apache-2.0
"""A hub that loses what it knew, or a part of it: put back from a backup, or made anew with nothing."""

import os
import pickle
import re
import shutil
import subprocess
import uuid
from pathlib import Path
from typing import Any, Iterator, List

import fleet_world as model
import pytest
from waiting_body import DoesAtOnce

from merlin_fleet.core.agent import REPLACED, Agent, Rules
from merlin_fleet.core.auction import AuctionTimes
from merlin_fleet.core.records import Goal, Profile
from merlin_fleet.core.reporting import Outbox
from merlin_fleet.core.robot_lease import LeaseTimes
from merlin_fleet.core.store import Put, Txn
from merlin_fleet.core.view import FleetView
from merlin_fleet.fleet_client import FleetClient
from merlin_fleet.fleet_request import REMOVED
from merlin_fleet.fleet_robot import FleetRobot
from merlin_fleet.hub import EtcdHub
from merlin_test import LONG
from merlin_test.etcd_process import EtcdProcess
from merlin_test.ports import free_ports

pytestmark = pytest.mark.processes

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "fleet.md").read_text(encoding="utf-8")
#: A test machine may stand still for many seconds.
RULES = Rules(LeaseTimes(ttl=60.0, renew_every=0.5, stop_time=1.0), AuctionTimes(0.1, 30.0))


@pytest.mark.parametrize("finish", [False, True])
@pytest.mark.parametrize("rounds", range(9))
def test_what_a_backup_has_is_done(finish: bool, rounds: int) -> None:
    world = model.World(2, finish=finish)
    for _ in range(4):
        world.act()
    world.send("a")
    for _ in range(rounds):
        world.act()
    backup = pickle.dumps(world.store)
    world.send("b")
    for _ in range(15):
        world.act()
    assert not world.settled()
    world.strike(("hub down",))
    world.act()
    world.store = pickle.loads(backup)
    for robot in world.robots:
        robot.heard = False
    world.strike(("hub up",))
    for _ in range(40):
        world.act()
    view = FleetView.of(model.KEYS, world.store.snapshot())
    assert "a" in view.ends
    assert not view.claims


@pytest.fixture
def etcd() -> Iterator[EtcdProcess]:
    made = EtcdProcess()
    yield made
    made.close()


def test_a_goal_that_the_hub_has_lost_is_not_awaited(etcd: EtcdProcess) -> None:
    client = FleetClient("lab", [etcd.endpoint])
    try:
        for _ in range(5):
            request = client.send("(done a)")
        assert client.wait(lambda: request.news, LONG)
        followed = client.request(request.id)
        etcd.kill()
        shutil.rmtree(Path(etcd._folder) / "data")
        etcd.start()
        for each in (request, followed):
            assert each.wait(LONG)
            assert each.result is not None and each.result.outcome == REMOVED
        assert client.send("(done b)").result is None
    finally:
        client.close()


def put_back_with_the_same_token(etcd: EtcdProcess, snapshot: Path, revision: int, compacted: bool) -> None:
    """Puts the backup into a hub that is down; it passes a revision before robots and clients see it."""
    etcd.put_back(snapshot)
    port = etcd._ports[0]
    (etcd._ports[0],) = free_ports(1)
    etcd.start()
    hub = EtcdHub("/elsewhere/", [etcd.endpoint], timeout=20.0)
    while hub.transact(Txn((), (Put("/elsewhere/key", "value"),))).revision <= revision:
        pass
    hub.close()
    if compacted:
        compact = ["etcdctl", "--endpoints", etcd.endpoint, "compact", str(revision)]
        subprocess.run(compact, env=dict(os.environ, ETCDCTL_API="3"), check=True, capture_output=True)
    etcd.kill()
    etcd._ports[0] = port
    etcd.start()


class RefusesLast(DoesAtOnce):
    """A body that refuses one goal, by which all see that its robot has received it."""

    def cost(self, goal: Goal, behind: Any) -> Any:
        return (None, "not this one") if goal.goals == ("(done c)",) else super().cost(goal, behind)


@pytest.mark.parametrize("compacted", [False, True])
def test_a_backup_is_found_without_a_new_token_and_at_a_later_revision(
    etcd: EtcdProcess, tmp_path: Path, compacted: bool
) -> None:
    client = FleetClient("lab", [etcd.endpoint])
    agent = Agent("lab", Profile("ann"), uuid.uuid4().hex, Outbox(), RULES)
    said: List[str] = []
    hub = EtcdHub(agent.keys.root, [etcd.endpoint], timeout=20.0)
    robot = FleetRobot(agent, hub, RefusesLast(), said.append)
    try:
        robot.start()
        assert client.execute("(done a)", LONG).outcome == "SUCCEEDED"
        known = client.send("(done b)", needs=("wings",))
        assert client.wait(lambda: known.news, LONG)
        etcd.save(tmp_path / "hub.snapshot")
        gone = client.send("(done c)")
        # A robot that has received nothing since the backup loses nothing by it, and has nothing to say.
        assert client.wait(lambda: gone.news and gone.news.refusals.get("ann") == "not this one", LONG)
        etcd.kill()
        put_back_with_the_same_token(etcd, tmp_path / "hub.snapshot", client.revision + 50, compacted)
        assert gone.wait(LONG) and gone.result is not None and gone.result.outcome == REMOVED
        assert client.wait(lambda: known.news and known.result is None, LONG)
        assert client.execute("(done d)", LONG).outcome == "SUCCEEDED"
        assert REPLACED in said or compacted
    finally:
        robot.close()
        client.close()


def test_the_lines_of_the_page_put_a_hub_back(etcd: EtcdProcess, tmp_path: Path) -> None:
    save, restore, _ = re.findall(r"^etcdctl snapshot .*$", PAGE, re.MULTILINE)
    env = dict(os.environ, ETCDCTL_ENDPOINTS=etcd.endpoint, ETCDCTL_API="3", HOME=str(tmp_path))

    def run(line: str) -> None:
        done = subprocess.run(
            ["bash", "-c", line], env=env, cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr

    client = FleetClient("lab", [etcd.endpoint])
    agent = Agent("lab", Profile("ann"), uuid.uuid4().hex, Outbox(), RULES)
    robot = FleetRobot(agent, EtcdHub(agent.keys.root, [etcd.endpoint], timeout=20.0), DoesAtOnce(), print)
    try:
        first = client.send("(done a)")
        run(save)
        robot.start()
        assert first.wait(LONG) and client.execute("(done b)", LONG).outcome == "SUCCEEDED"
        last = client.send("(done c)", needs=("wings",))
        etcd.kill()
        run(restore)
        (folder,) = (tmp_path / ".ros" / "merlin").iterdir()
        shutil.rmtree(Path(etcd._folder) / "data")
        shutil.move(str(folder), f"{etcd._folder}/data")
        etcd.start()
        assert last.wait(LONG) and last.result is not None and last.result.outcome == REMOVED
        assert client.wait(lambda: first.news and first.news.report, LONG)
        assert client.execute("(done d)", LONG).outcome == "SUCCEEDED"
    finally:
        robot.close()
        client.close()
