# SPDX-License-Identifier: Apache-2.0
"""Certificates and roles over a real etcd: what a robot can write, how wrong certificates are refused."""

import os
import queue
import re
import shlex
import subprocess
import sys
import threading
import time
import uuid
from pathlib import Path
from typing import Any, Iterator, List, Tuple

import pytest

from merlin_fleet import fleet_client
from merlin_fleet.certificates import Folder, make_certificates
from merlin_fleet.certified import HubError, Tls
from merlin_fleet.commands import fleet_command
from merlin_fleet.commands.fleet_command import main as fleet
from merlin_fleet.commands.keys_command import main
from merlin_fleet.core import records
from merlin_fleet.core.agent import Agent, Rules
from merlin_fleet.core.auction import AuctionTimes
from merlin_fleet.core.records import Claim, Keys, Profile, Report
from merlin_fleet.core.retention import Keeper, Retention
from merlin_fleet.core.robot_lease import LeaseTimes
from merlin_fleet.core.store import Compare, Put, Snapshot, Txn, Unwritten
from merlin_fleet.etcd_messages import HubRefuses
from merlin_fleet.fleet_client import FleetClient, FleetError
from merlin_fleet.fleet_robot import FleetRobot
from merlin_fleet.hub import EtcdHub
from merlin_fleet.hub_watch import Listener
from merlin_fleet.sqlite_outbox import SqliteOutbox
from merlin_test import LONG
from merlin_test.etcd_process import EtcdProcess
from merlin_test.node_path import LEAN
from merlin_test.ports import free_ports

pytestmark = pytest.mark.processes

PAGE = (Path(__file__).resolve().parents[4] / "docs" / "fleet.md").read_text(encoding="utf-8")
KEYS = Keys("lab")
#: A test machine may stand still for many seconds.
RULES = Rules(LeaseTimes(ttl=60.0, renew_every=0.5, stop_time=1.0), AuctionTimes(0.1, 30.0))


class Lab:
    """An etcd with certificates and roles: the robots ann and bob, the client desk."""

    def __init__(self, path: Path) -> None:
        self.folder = Folder(path)
        people = ["--robot", "ann", "--robot", "bob", "--client", "desk"]
        assert main(["make", str(path), "--host", "127.0.0.1", *people]) == 0
        self.etcd = EtcdProcess(certificates=path)
        self.allow("lab")

    def allow(self, fleet: str) -> None:
        given = [str(self.folder.path), "--hub", self.etcd.endpoint, "--fleet", fleet]
        assert main(["allow", *given]) == 0


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    made = Lab(tmp_path_factory.mktemp("lab") / "keys")
    yield made
    made.etcd.close()


@pytest.fixture
def hubs(lab: Lab) -> Iterator[Any]:
    made: List[EtcdHub] = []

    def make(name: str, root: str = KEYS.root) -> EtcdHub:
        made.append(EtcdHub(root, [lab.etcd.endpoint], lab.folder.tls(name), 20.0))
        return made[-1]

    yield make
    for hub in made:
        hub.close()


def every_key(robot: str) -> List[str]:
    """One key of each kind that this robot writes."""
    kinds = (records.CLAIMS, records.ENDS, records.FAILURES, records.LATE, records.FACTS)
    keys = [KEYS.key(kind, robot, "g1") for kind in kinds]
    keys += [KEYS.key(kind, robot) for kind in (records.LIVES, records.BIDS, records.ROBOTS)]
    return [*keys, KEYS.marks("g1") + robot]


@pytest.mark.parametrize("number", range(8))
def test_a_robot_writes_its_own_keys_only(hubs: Any, number: int) -> None:
    ann, own, other = hubs("robot.ann"), every_key("ann")[number], every_key("bob")[number]
    assert ann.transact(Txn((Unwritten(KEYS.marks("g1"), 1 << 40),), (Put(own, "x"),))).done
    with pytest.raises(HubRefuses, match="does not allow it"):
        ann.transact(Txn(puts=(Put(other, "x"),)))
    with pytest.raises(HubRefuses):
        ann.transact(Txn(deletes=(other,)))
    with pytest.raises(HubRefuses):
        ann.transact(Txn(puts=(Put(own, "y"), Put(other, "y"))))  # all or nothing
    assert {item.value for item in hubs("robot.bob").read().items if item.key == own} == {"x"}


@pytest.mark.parametrize("key", [("goals", "g1"), ("cancels", "g1"), ("about",), ("new", "ann")])
def test_a_robot_sends_no_goals_and_makes_no_fleet(hubs: Any, key: Tuple[str, ...]) -> None:
    with pytest.raises(HubRefuses):
        hubs("robot.ann").transact(Txn(puts=(Put(KEYS.key(*key), "x"),)))


def test_a_lease_of_another_robot_is_not_ended(hubs: Any) -> None:
    ann, bob, key = hubs("robot.ann"), hubs("robot.bob"), KEYS.key("claims", "bob", "leased")
    lease, _ = bob.grant(600.0)
    bob.transact(Txn(puts=(Put(key, "x", lease),)))
    with pytest.raises(HubRefuses):
        ann.revoke(lease)
    bob.revoke(lease)
    assert key not in {item.key for item in ann.read().items}


def test_any_certificate_renews_the_lease_of_a_robot_and_keeps_it_from_ending_it(hubs: Any) -> None:
    ann, bob, key = hubs("robot.ann"), hubs("robot.bob"), KEYS.key("claims", "bob", "renewed")
    lease, ttl = bob.grant(600.0)
    bob.transact(Txn(puts=(Put(key, "x", lease),)))
    assert hubs("client.desk").renew(lease) == ttl
    ann.transact(Txn(puts=(Put(KEYS.key("claims", "ann", "renewed"), "x", lease),)))
    with pytest.raises(HubRefuses):
        bob.revoke(lease)
    bob.transact(Txn(deletes=(key,)))


def test_rights_that_the_hub_has_lost_come_back_with_the_next_allow(lab: Lab, hubs: Any) -> None:
    tls = lab.folder.tls("root")
    etcdctl = ["etcdctl", "--endpoints", lab.etcd.endpoint, "--cacert", tls.ca]
    etcdctl += ["--cert", tls.certificate, "--key", tls.key]
    claims = KEYS.key(records.CLAIMS, "ann", "")
    for words in (
        ["role", "revoke-permission", "--prefix", "merlin.lab.robot.ann", claims],
        ["user", "revoke-role", "robot.bob", "merlin.lab.robot.bob"],
    ):
        command = [*etcdctl, *words]
        subprocess.run(command, env={**os.environ, "ETCDCTL_API": "3"}, check=True, capture_output=True)
    for robot in ("ann", "bob"):
        with pytest.raises(HubRefuses):
            hubs(f"robot.{robot}").transact(Txn(puts=(Put(every_key(robot)[0], "x"),)))
    lab.allow("lab")
    for robot in ("ann", "bob"):
        assert hubs(f"robot.{robot}").transact(Txn(puts=(Put(every_key(robot)[0], "x"),))).done


def test_a_client_writes_goals_and_cancels_only(hubs: Any) -> None:
    desk = hubs("client.desk")
    for kind in ("goals", "cancels"):
        assert desk.transact(Txn((Compare(KEYS.key(kind, "g9"), 0),), (Put(KEYS.key(kind, "g9"), "x"),))).done
    for key in (*every_key("ann"), KEYS.key("about")):
        with pytest.raises(HubRefuses):
            desk.transact(Txn(puts=(Put(key, "x"),)))
    with pytest.raises(HubRefuses):
        hubs("client.desk", "/merlin/other/").read()


class TestBody:
    """Has done each goal at once."""

    __test__ = False

    def cost(self, goal: Any, behind: Any) -> Tuple[float, str]:
        return 1.0, ""

    def begin(self, goal: Any, ended: Any) -> None:
        ended(True, "SUCCEEDED", "")

    def stop(self, goal: str, reason: str) -> None:
        raise AssertionError(reason)


def robot_of(
    lab: Lab, name: str, fleet_name: str, certificate: str, outbox: Any, rules: Rules = RULES
) -> Tuple[FleetRobot, Any]:
    said: queue.Queue[str] = queue.Queue()
    agent = Agent(fleet_name, Profile(name), uuid.uuid4().hex, outbox, rules, fleet_id=outbox.fleet_id)
    hub = EtcdHub(agent.keys.root, [lab.etcd.endpoint], lab.folder.tls(certificate), 20.0)
    robot = FleetRobot(agent, hub, TestBody(), said.put, note_fleet=outbox.note_fleet)
    robot.start()
    return robot, said


def test_robots_and_clients_work_with_their_rights(
    lab: Lab, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    lab.allow("real")
    given = ["--hub", lab.etcd.endpoint, "--fleet", "real"]
    tls = lab.folder.tls("client.desk")
    given += ["--ca", tls.ca, "--certificate", tls.certificate, "--key", tls.key]
    robots = [
        robot_of(lab, name, "real", f"robot.{name}", SqliteOutbox(f"{tmp_path}/{name}"))
        for name in ["ann", "bob"]
    ]
    try:
        assert fleet(["send", *given, "--follow", "(done a)"]) == 0
        assert fleet(["send", *given, "--follow", "--finish", "(done b)"]) == 0
        assert fleet(["send", *given, "--follow", "--begin-by", "0.5", "--needs", "wings", "(done c)"]) == 1
    finally:
        for robot, _ in robots:
            robot.close()
    assert all(said.empty() for _, said in robots)
    assert "MISSED by " in capsys.readouterr().out


def test_a_hub_with_certificates_tells_its_time(lab: Lab) -> None:
    hub = EtcdHub(Keys("real").root, [lab.etcd.endpoint], lab.folder.tls("client.desk"), 20.0)
    assert abs(hub.time() - time.time()) < LONG
    hub.close()


def test_a_robot_with_the_certificate_of_another_one_says_so_once(lab: Lab, tmp_path: Path) -> None:
    lab.allow("real")
    outbox = SqliteOutbox(f"{tmp_path}/outbox")
    outbox.add(Report("g1", "ann", 5, "SUCCEEDED", "", 1.0), True)
    robot, said = robot_of(lab, "ann", "real", "robot.bob", outbox)
    try:
        assert "is it that of the robot 'ann', made for the fleet 'real'?" in said.get(timeout=LONG)
    finally:
        robot.close()
    assert [report.goal for report, _ in outbox.reports()] == ["g1"]
    assert said.empty()


def test_a_hub_that_begins_with_nothing_is_of_the_same_fleet_after_allow(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "keys")
    try:
        for _ in range(2):
            robot, said = robot_of(lab, "ann", "lab", "robot.ann", SqliteOutbox(f"{tmp_path}/outbox"))
            client = FleetClient("lab", [lab.etcd.endpoint], lab.folder.tls("client.desk"))
            try:
                request = client.send("(done a)")
                assert request.wait(LONG), list(said.queue)
            finally:
                robot.close()
                client.close()
            assert said.empty()
            lab.etcd.close()
            lab.etcd = EtcdProcess(certificates=lab.folder.path)
            lab.allow("lab")
    finally:
        lab.etcd.close()


def test_a_client_removes_ended_goals_as_robots_may_not(lab: Lab, tmp_path: Path) -> None:
    lab.allow("kept")
    keep = Retention(hours=1e-9, goals=0, grace=0.0)
    rules = RULES._replace(keep=keep, clean_every=0.2)
    client = FleetClient("kept", [lab.etcd.endpoint], lab.folder.tls("client.desk"))
    hub = EtcdHub(Keys("kept").root, [lab.etcd.endpoint], lab.folder.tls("client.desk"), 20.0)
    robot, said = robot_of(lab, "ann", "kept", "robot.ann", SqliteOutbox(f"{tmp_path}/outbox"), rules)
    try:
        request = client.send("(done a)")
        assert request.wait(LONG)
        assert "this robot removes no ended goals: the hub does not allow it" in said.get(timeout=LONG)
        keeper, end = Keeper(keep), time.monotonic() + LONG
        # The client removes the goal, and then the robot its own records of it.
        while any(request.id in item.key.split("/") for item in hub.read().items):
            client.remove_ended(keeper)
            assert time.monotonic() < end
            time.sleep(0.1)  # etcd sends no event for a removed user
    finally:
        robot.close()
        client.close()
        hub.close()
    assert said.empty()


class Heard(Listener):
    """Keeps why it was disconnected, and whether it was ever connected."""

    def __init__(self) -> None:
        self.reasons: queue.Queue[str] = queue.Queue()
        self.connected = threading.Event()

    def on_connected(self, snapshot: Snapshot) -> None:
        self.connected.set()

    def on_disconnected(self, reason: str) -> None:
        self.reasons.put(reason)


def test_certificates_of_another_lab_are_named(lab: Lab, tmp_path: Path) -> None:
    make_certificates(tmp_path, ["127.0.0.1"], ["ann"], [])
    foreign, own = Folder(tmp_path).tls("robot.ann"), lab.folder.tls("robot.ann")
    for tls, message in (
        (foreign, "the hub's certificate is not one for 127.0.0.1 that"),
        (foreign._replace(ca=own.ca), "the hub does not take the certificate"),
    ):
        hub, heard = EtcdHub(KEYS.root, [lab.etcd.endpoint], tls, 20.0), Heard()
        hub.follow(heard)
        try:
            assert heard.reasons.get(timeout=LONG).startswith(message)
        finally:
            hub.close()
    with pytest.raises(HubError, match="cannot be read or do not fit"):
        EtcdHub(KEYS.root, [lab.etcd.endpoint], own._replace(key=foreign.key))
    with pytest.raises(HubError, match="cannot be read or do not fit"):
        EtcdHub(KEYS.root, [lab.etcd.endpoint], Tls("/nowhere", own.certificate, own.key))


def test_a_certificate_whose_time_is_over_is_named_and_the_next_one_taken(lab: Lab, tmp_path: Path) -> None:
    for name in ("ca.pem", "ca.key", "hub.pem", "hub.key", "root.pem", "root.key"):
        (tmp_path / name).write_bytes((lab.folder.path / name).read_bytes())
    make_certificates(tmp_path, [], ["ann"], [])
    request = "openssl req -new -key robot.ann.key -subj /CN=robot.ann -out csr"
    signed = "openssl x509 -req -in csr -out robot.ann.pem -CA ca.pem -CAkey ca.key -set_serial 7 -days -1"
    for line in (request, signed):
        subprocess.run(shlex.split(line), cwd=tmp_path, check=True, capture_output=True)
    tls = Folder(tmp_path).tls("robot.ann")
    given = ["--hub", lab.etcd.endpoint, "--ca", tls.ca, "--certificate", tls.certificate, "--key", tls.key]
    program = "from merlin_fleet.commands.fleet_command import main; exit(main())"
    command = [sys.executable, "-c", LEAN + program]
    listed = subprocess.run([*command, "list", *given], capture_output=True, text=True, check=False)
    assert (listed.returncode, listed.stderr.count("\n")) == (2, 1), listed.stderr
    assert "the hub does not take the certificate" in listed.stderr
    hub, heard = EtcdHub(KEYS.root, [lab.etcd.endpoint], tls, 20.0), Heard()
    hub.follow(heard)
    try:
        reason = heard.reasons.get(timeout=LONG)
        assert not heard.connected.is_set()
        for part in ("pem", "key"):
            (tmp_path / f"robot.ann.{part}").unlink()
        assert make_certificates(tmp_path, [], ["ann"], []) == ["robot.ann"]
        assert heard.connected.wait(LONG)
    finally:
        hub.close()
    assert reason.startswith(f"the hub does not take the certificate {tmp_path}/robot.ann.pem: ")
    assert "or its time is over" in reason


def test_a_certificate_without_rights_is_reported(
    lab: Lab, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_certificates(lab.folder.path, [], [], ["guest"])
    tls = lab.folder.tls("client.guest")
    given = ["--hub", lab.etcd.endpoint, "--fleet", "lab", "--ca", tls.ca]
    given += ["--certificate", tls.certificate, "--key", tls.key]
    try:
        with monkeypatch.context() as hasty:
            hasty.setattr(fleet_command, "LIMIT", 10.0)  # which it waits for the right to come
            assert fleet(["list", *given]) == 2
        assert "the hub does not allow it to this certificate" in capsys.readouterr().err
        lab.allow("lab")
        assert fleet(["list", *given]) == 0
        client = FleetClient("lab", [lab.etcd.endpoint], tls)
        assert client.wait_for_hub(LONG)
        remove = [str(lab.folder.path), "client.guest", "--hub", lab.etcd.endpoint]
        assert main(["remove", *remove]) == 0
        monkeypatch.setattr(fleet_client, "LIMIT", 1.0)  # it tries again until then
        with pytest.raises(FleetError):
            client.send("(done a)")
        capsys.readouterr()
        lab.allow("lab")  # as after each `make`
        assert "client.guest was removed and gets none" in capsys.readouterr().out
        with pytest.raises(FleetError):
            client.send("(done a)")
        client.close()
    finally:
        for end in ("pem", "key", "removed"):
            (lab.folder.path / f"client.guest.{end}").unlink()


def test_a_claim_needs_that_no_mark_is_newer(hubs: Any) -> None:
    ann, bob = hubs("robot.ann"), hubs("robot.bob")
    seen = ann.read().revision

    def claim(hub: EtcdHub, name: str, since: int) -> bool:
        puts = (
            Put(KEYS.key("claims", name, "g2"), records.encode(Claim(name, "x"))),
            Put(KEYS.marks("g2") + name, "x"),
        )
        return hub.transact(Txn((Unwritten(KEYS.marks("g2"), since),), puts)).done

    assert claim(ann, "ann", seen)
    assert not claim(bob, "bob", seen)
    assert claim(bob, "bob", bob.read().revision)


def test_the_commands_of_the_page(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("merlin_fleet.commands.page_command.wait_for_end", lambda key: None)
    monkeypatch.setattr("merlin_fleet.commands.keep_command._pause", interrupted)
    port, peer = free_ports(2)

    def lines(command: str) -> List[List[str]]:
        found = re.findall(rf"^{command} (.*)$", PAGE, re.MULTILINE)
        here = (line.replace("~", str(tmp_path)).replace("hub.lab", "127.0.0.1") for line in found)
        return [shlex.split(line.replace("0.0.0.0", "127.0.0.1").replace("2379", str(port))) for line in here]

    make, allow, remove = lines("rosrun merlin_fleet keys")
    assert main(make) == 0
    (hub,) = (words for words in lines("etcd") if "--client-cert-auth" in words)
    peers = ["--listen-peer-urls", f"http://127.0.0.1:{peer}"]  # another one may have the usual port
    process = subprocess.Popen(["etcd", *hub, *peers], stdout=subprocess.DEVNULL, stderr=subprocess.STDOUT)
    try:
        until_it_answers(Folder(tmp_path / "fleet_keys"), f"127.0.0.1:{port}")
        assert main(allow) == 0
        with_certificates = [words for words in lines("rosrun merlin_fleet fleet") if "--ca" in words]
        assert [words[0] for words in with_certificates] == ["list", "keep", "forget", "page"]
        forget = with_certificates[2]
        heard_of(forget[1], Folder(tmp_path / "fleet_keys"), f"127.0.0.1:{port}")
        assert fleet([word.replace("root.", "client.desk.") for word in forget]) == 2
        assert re.search(r"fleet forget: the hub does not allow it .*; use root's", capsys.readouterr().err)
        for words in with_certificates:
            assert fleet(words) == 0
        assert main(remove) == 0
        assert main(remove) == 2
    finally:
        process.kill()
        process.wait()
    assert "user name not found" in capsys.readouterr().err


def heard_of(robot: str, folder: Folder, endpoint: str) -> None:
    """A robot was once in the fleet."""
    keys = Keys("fleet")
    hub = EtcdHub(keys.root, [endpoint], folder.tls("root"), 20.0)
    hub.transact(Txn(puts=(Put(keys.key(records.ROBOTS, robot), records.encode(records.Profile(robot))),)))
    hub.close()


def interrupted(signals: int, seconds: float) -> None:
    raise KeyboardInterrupt


def until_it_answers(folder: Folder, endpoint: str) -> None:
    client = FleetClient("lab", [endpoint], folder.tls("root"))
    try:
        assert client.wait_for_hub(LONG), client.missing
    finally:
        client.close()
