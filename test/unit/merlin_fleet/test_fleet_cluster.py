# SPDX-License-Identifier: Apache-2.0
"""Three hubs as the page has them: one of them is lost and nothing of the fleet notices; all are put back."""

import functools
import os
import re
import shlex
import shutil
import signal
import subprocess
import uuid
from pathlib import Path
from typing import Iterator, List

import pytest
import roslaunch.arg_dump
from waiting_body import WaitingBody

from merlin_fleet.certificates import Folder, make_certificates
from merlin_fleet.certified import certificate_problem
from merlin_fleet.core.agent import Agent, Rules
from merlin_fleet.core.auction import AuctionTimes
from merlin_fleet.core.records import Profile
from merlin_fleet.core.reporting import Outbox
from merlin_fleet.core.robot_lease import LeaseTimes
from merlin_fleet.fleet_client import FleetClient
from merlin_fleet.fleet_request import FleetRequest
from merlin_fleet.fleet_robot import FleetRobot
from merlin_fleet.hub import EtcdHub
from merlin_test import LONG
from merlin_test.ports import free_ports

pytestmark = pytest.mark.processes

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "fleet.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```ini\n(.*?)```", PAGE, re.DOTALL)
#: A test machine may stand still for many seconds.
RULES = Rules(LeaseTimes(ttl=120.0, renew_every=0.5, stop_time=1.0), AuctionTimes(0.1, 30.0))


class Cluster:
    """Runs them from the lines of the page, on this machine."""

    def __init__(self, folder: Path) -> None:
        self.certificates = Folder(folder / "keys")
        make_certificates(self.certificates.path, ["127.0.0.1"], ["ann"], ["desk"])
        ports = free_ports(6)
        self.clients, self.peers = ports[:3], ports[3:]
        self.folder = folder
        self.start()

    def start(self) -> None:
        self.processes = [self._start(number) for number in range(3)]

    @property
    def endpoints(self) -> List[str]:
        return [f"127.0.0.1:{port}" for port in self.clients]

    def here(self, text: str, number: int) -> str:
        """A text of the page about the first hub, for this one on this machine."""
        name = f"hub{number + 1}"
        words = [word if "hub1=" in word else word.replace("hub1", name) for word in text.split()]
        text = " ".join(words).replace("/etc/merlin_fleet", str(self.certificates.path))
        text = text.replace("0.0.0.0:2379", f"127.0.0.1:{self.clients[number]}")
        text = text.replace("0.0.0.0:2380", f"127.0.0.1:{self.peers[number]}")
        for other in range(3):
            text = text.replace(f"hub{other + 1}.lab:2379", f"127.0.0.1:{self.clients[other]}")
            text = text.replace(f"hub{other + 1}.lab:2380", f"127.0.0.1:{self.peers[other]}")
        return text

    def _start(self, number: int) -> subprocess.Popen:
        lines = dict(line.split("=", 1) for line in self.here(BLOCKS[0], number).split())
        lines["ETCD_DATA_DIR"] = f"{self.folder}/{number}"
        with (self.folder / f"{number}.log").open("wb") as log:
            return subprocess.Popen(["etcd"], env={**os.environ, **lines}, stdout=log, stderr=log)

    def close(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    made = Cluster(tmp_path)
    client = FleetClient("lab", made.endpoints, made.certificates.tls("client.desk"))
    try:
        assert client.wait_for_hub(LONG), client.missing
        yield made
    finally:
        client.close()
        made.close()


def test_losing_one_of_three_hubs_costs_nothing(cluster: Cluster) -> None:
    body, said = WaitingBody(), []  # type: WaitingBody, List[str]
    client = FleetClient("lab", cluster.endpoints, cluster.certificates.tls("client.desk"))
    agent = Agent("lab", Profile("ann"), uuid.uuid4().hex, Outbox(), RULES)
    hub = EtcdHub(agent.keys.root, cluster.endpoints, cluster.certificates.tls("robot.ann"), 20.0)
    robot = FleetRobot(agent, hub, body, said.append)
    try:
        assert client.wait_for_hub(LONG), client.missing
        robot.start()
        request = client.send("(done a)")
        assert body.began.wait(LONG), said
        connected = hub._turn % 3
        cluster.processes[connected].kill()
        body.ended(True, "SUCCEEDED", "")
        assert request.wait(LONG), client.missing
        assert client.execute("(done b)", timeout=0.0).outcome in ("CANCELLED", "SUCCEEDED")
    finally:
        body.stop = lambda goal, reason: body.ended(False, "CANCELLED", reason)  # type: ignore[method-assign]
        robot.close()
        client.close()


def knows(client: FleetClient, requests: List[FleetRequest]) -> bool:
    return all(client.news(request.id) for request in requests)


def test_the_lines_of_the_page_put_three_hubs_back(cluster: Cluster) -> None:
    save, _, restore = re.findall(r"^etcdctl snapshot .*$", PAGE, re.MULTILINE)
    tls = cluster.certificates.tls("hub")
    env = dict(os.environ, ETCDCTL_API="3", ETCDCTL_ENDPOINTS=cluster.endpoints[0], ETCDCTL_CACERT=tls.ca)
    env.update(ETCDCTL_CERT=tls.certificate, ETCDCTL_KEY=tls.key)

    def run(line: str) -> None:
        command = ["bash", "-c", line]
        done = subprocess.run(
            command, env=env, cwd=cluster.folder, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr

    desk = cluster.certificates.tls("client.desk")
    clients = [FleetClient("lab", [endpoint], desk) for endpoint in cluster.endpoints]
    try:
        before = clients[0].send("(done a)")
        run(save)
        cluster.close()
        for number in range(3):
            folder = cluster.folder / str(number)
            shutil.rmtree(folder)
            run(cluster.here(restore, number).replace("~/.ros/merlin/hub_again", str(folder)))
        cluster.start()
        # Each is asked alone: three hubs that do not know each other would have these goals in one only.
        sent = [client.send("(done b)") for client in clients]
        for client in clients:
            assert client.wait(functools.partial(knows, client, [before, *sent]), LONG), client.missing
    finally:
        for client in clients:
            client.close()


def test_a_robot_cannot_speak_as_a_hub(cluster: Cluster) -> None:
    peer, client = (
        f"127.0.0.1:{cluster.peers[0]}",
        FleetClient("lab", cluster.endpoints, cluster.certificates.tls("client.desk")),
    )
    try:
        assert client.wait_for_hub(LONG), client.missing
    finally:
        client.close()
    assert certificate_problem(peer, cluster.certificates.tls("hub"), LONG) == ""
    assert certificate_problem(peer, cluster.certificates.tls("robot.ann"), LONG) != ""


def test_the_unit_of_a_robot(tmp_path: Path) -> None:
    (line,) = re.findall(r"^ExecStart=(.*)$", BLOCKS[1], re.MULTILINE)
    program, tool, wait, package, file, *arguments = shlex.split(line)
    assert (ROOT / program.partition("/merlin/")[2]).exists()
    assert (tool, wait, package, file) == ("roslaunch", "--wait", "merlin", "fleet.launch")
    known = roslaunch.arg_dump.get_args([str(ROOT / "launch" / "fleet.launch")])
    assert {word.partition(":=")[0] for word in arguments} <= set(known)


def words_of(unit: str, folder: Path, endpoints: List[str]) -> List[str]:
    """The command line of a unit, here."""
    (line,) = re.findall(r"^ExecStart=(.*)$", unit, re.MULTILINE)
    line = line.replace("/home/lab/merlin", str(ROOT)).replace("/etc/merlin_fleet", str(folder))
    hubs = ",".join(f"hub{number}.lab:2379" for number in (1, 2, 3))
    return shlex.split(line.replace(hubs, ",".join(endpoints)).replace("0.0.0.0", "127.0.0.1 --port 0"))


@pytest.mark.parametrize(("number", "what"), [(2, "keep"), (3, "page")])
def test_the_units_of_a_lab(number: int, what: str, cluster: Cluster, tmp_path: Path) -> None:
    words = words_of(BLOCKS[number], cluster.certificates.path, cluster.endpoints)
    assert words[1:5] == ["rosrun", "merlin_fleet", "fleet", what]
    signals = re.findall(r"^KillSignal=(.*)$", BLOCKS[number], re.MULTILINE)
    with (tmp_path / "out").open("wb") as out:
        process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=out, start_new_session=True)
    assert process.stdout is not None
    try:
        begun = process.stdout.readline().decode()  # it ends after 10 s without a hub
        assert begun.endswith("(Ctrl-C ends it)\n"), (tmp_path / "out").read_text()
        process.send_signal(getattr(signal, signals[0]))
        assert process.wait(LONG) in (0, int(re.findall(r"SuccessExitStatus=(.*)", BLOCKS[number])[0]))
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    assert (tmp_path / "out").read_text() == ""
