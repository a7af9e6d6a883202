# SPDX-License-Identifier: Apache-2.0
"""A hub that is full: what runs goes on, nothing is lost, and it is said what makes room."""

import os
import queue
import re
import subprocess
import threading
import uuid
from pathlib import Path
from typing import Iterator

import pytest
from waiting_body import WaitingBody

from merlin_fleet.core import records
from merlin_fleet.core.agent import Agent, Rules
from merlin_fleet.core.auction import AuctionTimes
from merlin_fleet.core.records import Keys, Profile
from merlin_fleet.core.reporting import Outbox
from merlin_fleet.core.robot_lease import LeaseTimes
from merlin_fleet.core.store import Put, Txn
from merlin_fleet.etcd_messages import DEACTIVATE, HubFull, message
from merlin_fleet.fleet_client import FleetClient, FleetError
from merlin_fleet.fleet_robot import FleetRobot, FleetStatus
from merlin_fleet.hub import EtcdHub
from merlin_test import LONG
from merlin_test.etcd_process import EtcdProcess

pytestmark = pytest.mark.processes

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "fleet.md").read_text(encoding="utf-8")
KEYS = Keys("lab")
QUOTA = 8 << 20
ACTIVATE, CORRUPT = 1, 2  # in etcd: an action with an alarm, and an alarm
#: A test machine may stand still for many seconds.
RULES = Rules(LeaseTimes(ttl=60.0, renew_every=0.5, stop_time=1.0), AuctionTimes(0.1, 30.0), retry=0.2)


@pytest.fixture
def etcd() -> Iterator[EtcdProcess]:
    made = EtcdProcess(["--quota-backend-bytes", str(QUOTA)])
    yield made
    made.close()


def fill(hub: EtcdHub) -> None:
    """Writes one key again and again: the hub keeps what it was."""
    with pytest.raises(HubFull):
        while True:
            hub.transact(Txn(puts=(Put("/other/key", "x" * 500_000),)))


def heard(said: "queue.Queue[str]", what: str) -> str:
    """Waits until a robot says what begins so."""
    text = ""
    while not text.startswith(what):  # a machine that stands still may lose the hub for a moment
        text = said.get(timeout=LONG)
    return text


def make_room(etcd: EtcdProcess) -> None:
    """Does what the page says."""
    lines = re.findall(r"^etcdctl (?!snapshot).*$", PAGE, re.MULTILINE)
    assert [line.split()[1] for line in lines] == ["compact", "defrag", "alarm"]
    env = dict(os.environ, ETCDCTL_ENDPOINTS=etcd.endpoint)
    for line in lines:
        done = subprocess.run(["bash", "-c", line], env=env, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{line}: {done.stderr}"


def test_nothing_is_lost_while_the_hub_is_full(etcd: EtcdProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    body, outbox = WaitingBody(), Outbox()
    said: queue.Queue[str] = queue.Queue()
    statuses: queue.Queue[FleetStatus] = queue.Queue()
    hub = EtcdHub(KEYS.root, [etcd.endpoint], timeout=20.0)
    client = FleetClient("lab", [etcd.endpoint])
    agent = Agent("lab", Profile("ann"), uuid.uuid4().hex, outbox, RULES)
    robot = FleetRobot(
        agent, EtcdHub(KEYS.root, [etcd.endpoint], timeout=20.0), body, said.put, on_status=statuses.put
    )
    try:
        robot.start()
        request = client.send("(done a)")
        assert body.began.wait(LONG)
        fill(hub)
        body.ended(True, "SUCCEEDED", "")
        words = heard(said, "the hub is full and takes no changes")
        for what in ("etcdctl compact", "etcdctl defrag", "etcdctl alarm disarm"):
            assert what in words
        while statuses.get(timeout=LONG).refused != words:
            continue
        assert [report.goal for report, _ in outbox.reports()] == [request.id]
        assert agent.robot_lease.holds(agent.now), "its lease is renewed"
        monkeypatch.setattr("merlin_fleet.fleet_client.LIMIT", 2.0)
        with pytest.raises(FleetError, match="not known: the hub is full and takes no changes"):
            client.send("(done b)")
        assert request.result is None
        make_room(etcd)
        assert request.wait(LONG)
        assert request.result is not None and request.result.outcome == "SUCCEEDED"
        heard(said, "the hub takes changes again")
        while statuses.get(timeout=LONG).refused:
            continue
    finally:
        robot.close()
        client.close()
        hub.close()
    assert not outbox.reports()


def test_a_robot_that_finds_a_full_hub_says_so_and_joins_later(etcd: EtcdProcess) -> None:
    said: queue.Queue[str] = queue.Queue()
    hub = EtcdHub(KEYS.root, [etcd.endpoint], timeout=20.0)
    hub.transact(Txn(puts=(Put(KEYS.key(records.ABOUT), records.encode_about("x")),)))
    fill(hub)
    agent = Agent("lab", Profile("ann"), uuid.uuid4().hex, Outbox(), RULES)
    joined = threading.Event()

    def tell(status: FleetStatus) -> None:
        if status.joined:
            joined.set()

    robot = FleetRobot(
        agent, EtcdHub(KEYS.root, [etcd.endpoint], timeout=20.0), WaitingBody(), said.put, on_status=tell
    )
    try:
        robot.start()
        heard(said, "the hub is full and takes no changes")
        make_room(etcd)
        assert joined.wait(LONG)
    finally:
        robot.close()
        hub.close()


def test_a_hub_that_refuses_for_another_reason_is_reported_once(etcd: EtcdProcess) -> None:
    said: queue.Queue[str] = queue.Queue()
    body = WaitingBody()
    hub = EtcdHub(KEYS.root, [etcd.endpoint], timeout=20.0)
    client = FleetClient("lab", [etcd.endpoint])
    agent = Agent("lab", Profile("ann"), uuid.uuid4().hex, Outbox(), RULES)
    robot = FleetRobot(agent, EtcdHub(KEYS.root, [etcd.endpoint], timeout=20.0), body, said.put)
    member = hub.ask("KV/Range", message("RangeRequest", key=b"/")).header.member_id
    alarm = {"memberID": member, "alarm": CORRUPT}
    try:
        robot.start()
        request = client.send("(done a)")
        assert body.began.wait(LONG)
        hub.ask("Maintenance/Alarm", message("AlarmRequest", action=ACTIVATE, **alarm))
        body.ended(True, "SUCCEEDED", "")
        assert heard(said, "etcd refuses") == "etcd refuses: etcdserver: corrupt cluster"
        hub.ask("Maintenance/Alarm", message("AlarmRequest", action=DEACTIVATE, **alarm))
        assert request.wait(LONG)
    finally:
        robot.close()
        client.close()
        hub.close()
    assert not [text for text in said.queue if text.startswith("etcd refuses")]
