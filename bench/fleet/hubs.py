# SPDX-License-Identifier: Apache-2.0
"""The hub of a campaign: three etcds that are one, any of which can be killed and come back."""

import contextlib
import itertools
import shutil
import signal
import subprocess
import time
from pathlib import Path
from typing import List, Sequence

from merlin_fleet.certificates import ADMINISTRATOR, ROBOT, Folder, user
from merlin_fleet.core.records import LIVES, Keys
from merlin_fleet.core.store import Put, Txn
from merlin_fleet.etcd_messages import DEACTIVATE, HubFull, LeaseUnknown, message
from merlin_fleet.hub import EtcdHub
from merlin_test.etcd_process import DIRECT
from merlin_test.ports import free_ports

BEGIN = 60.0  # s for them to be healthy
ETCD = "etcd"
QUOTA = 16 << 20  # bytes of the database: enough for a campaign
FILLER = "x" * 500_000


class Hubs:
    """Starts them.

    :param certificates: folder of a lab's certificates.
    :param folder: of their data and logs; its disk may get full.
    :raises RuntimeError: when they do not begin.
    """

    def __init__(self, certificates: Path, folder: Path, count: int = 3) -> None:
        self._certificates = certificates
        self._folder = folder
        ports = free_ports(3 * count)
        self.ports, self._peers, self._health = ports[:count], ports[count : 2 * count], ports[2 * count :]
        self._processes = [self._start(number) for number in range(count)]
        self._await()

    @property
    def members(self) -> Sequence[int]:
        """Their numbers."""
        return range(len(self.ports))

    def send(self, number: int, members: Sequence[int]) -> None:
        """Sends a signal to some of them; those that have ended are left out."""
        for member in members:
            if self._processes[member].poll() is None:
                self._processes[member].send_signal(number)
                if number == signal.SIGKILL:
                    self._processes[member].wait()

    def start(self) -> None:
        """Starts those that have ended, with the data that they had, and waits until all are well."""
        for member, process in enumerate(self._processes):
            if process.poll() is not None:
                self._processes[member] = self._start(member)
        self._await()

    def fill(self) -> None:
        """Writes one key again and again, until the quota is reached."""
        with contextlib.closing(self._administrator(self.ports)) as hub, contextlib.suppress(HubFull):
            for number in itertools.count():
                hub.transact(Txn(puts=(Put("/filler", f"{number}{FILLER}"),)))

    def make_room(self) -> None:
        """Does what the lines of the page do (docs/fleet.md, "When the hub is full")."""
        with contextlib.closing(self._administrator(self.ports)) as hub:
            revision = hub.transact(Txn()).revision
            hub.ask("KV/Compact", message("CompactionRequest", revision=revision, physical=True))
            for port in self.ports:
                with contextlib.closing(self._administrator([port])) as one:
                    one.ask("Maintenance/Defragment", message("DefragmentRequest"))
            for alarm in hub.ask("Maintenance/Alarm", message("AlarmRequest")).alarms:
                off = message("AlarmRequest", action=DEACTIVATE, memberID=alarm.memberID, alarm=alarm.alarm)
                hub.ask("Maintenance/Alarm", off)

    def revoke(self, keys: Keys, robot: str) -> None:
        """Ends the lease of a robot that is joined, with a copy of the robot's own certificate."""
        life = message("RangeRequest", key=keys.key(LIVES, robot).encode())
        with contextlib.closing(self._as(user(ROBOT, robot), self.ports)) as hub:
            for found in hub.ask("KV/Range", life).kvs:
                with contextlib.suppress(LeaseUnknown):  # it has just ended itself
                    hub.revoke(found.lease)

    def _administrator(self, ports: Sequence[int]) -> EtcdHub:
        return self._as(ADMINISTRATOR, ports)

    def _as(self, name: str, ports: Sequence[int]) -> EtcdHub:
        tls = Folder(self._certificates).tls(name)
        return EtcdHub("/filler", [f"127.0.0.1:{port}" for port in ports], tls, BEGIN)

    def close(self) -> None:
        """Ends them and removes their data."""
        self.send(signal.SIGKILL, self.members)
        for member in self.members:
            shutil.rmtree(self._folder / f"hub{member}", ignore_errors=True)

    def _start(self, member: int) -> "subprocess.Popen[bytes]":
        keys = self._certificates
        client = f"https://0.0.0.0:{self.ports[member]}"
        peers = [f"http://127.0.0.1:{port}" for port in self._peers]
        cluster = ",".join(f"hub{number}={peer}" for number, peer in enumerate(peers))
        command: List[str] = [
            *(ETCD, "--name", f"hub{member}", "--data-dir", str(self._folder / f"hub{member}")),
            *("--listen-client-urls", client, "--log-level", "error", "--client-cert-auth"),
            *("--advertise-client-urls", f"https://127.0.0.1:{self.ports[member]}"),
            *("--trusted-ca-file", str(keys / "ca.pem"), "--cert-file", str(keys / "hub.pem")),
            *("--key-file", str(keys / "hub.key"), "--initial-cluster", cluster),
            *("--listen-peer-urls", peers[member], "--initial-advertise-peer-urls", peers[member]),
            *("--listen-metrics-urls", f"http://127.0.0.1:{self._health[member]}"),
            *("--quota-backend-bytes", str(QUOTA)),
        ]
        with (keys.parent / f"hub{member}.log").open("ab") as log:
            return subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)

    def _await(self) -> None:
        end = time.monotonic() + BEGIN
        missing = list(self.members)
        while missing and time.monotonic() < end:
            missing = [member for member in missing if not self._healthy(member)]
            time.sleep(0.05)  # etcd sends no event when they are
        if missing:
            raise RuntimeError(f"hub{missing[0]} does not begin; see {self._certificates.parent}")

    def _healthy(self, member: int) -> bool:
        with contextlib.suppress(OSError), DIRECT.open(
            f"http://127.0.0.1:{self._health[member]}/health", timeout=5.0
        ) as answer:
            return b'"true"' in answer.read()
        return False
