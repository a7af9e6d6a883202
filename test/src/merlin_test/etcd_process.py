# SPDX-License-Identifier: Apache-2.0
"""An etcd of a test's own: on a free port of this machine, in a folder of its own."""

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import List, Optional, Sequence

from merlin_test import LONG
from merlin_test.ports import free_ports, release
from merlin_test.process_signals import hang

DIRECT = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # whatever proxy this machine has


class EtcdProcess:
    """Runs etcd.

    :param arguments: further ones of its command line.
    :param listen: address at which it listens.
    :param certificates: folder of a lab's certificates; None: it works without.
    :raises FileNotFoundError: when etcd is not installed.
    """

    def __init__(
        self, arguments: Sequence[str] = (), certificates: Optional[Path] = None, listen: str = "127.0.0.1"
    ) -> None:
        self._folder = tempfile.mkdtemp(prefix="merlin_etcd_")
        self._arguments = list(arguments)
        self._certificates = certificates
        self._listen = listen
        self._ports = free_ports(3)
        self._process: Optional[subprocess.Popen[bytes]] = None
        self.start()

    @property
    def port(self) -> int:
        """The port for clients."""
        return self._ports[0]

    @property
    def endpoint(self) -> str:
        """Host and port."""
        return f"127.0.0.1:{self._ports[0]}"

    def start(self) -> None:
        """Starts it, with the data that it had."""
        scheme = "http" if self._certificates is None else "https"
        peer = f"http://127.0.0.1:{self._ports[1]}"
        encrypted: List[str] = []
        if self._certificates is not None:
            folder = self._certificates
            encrypted = ["--client-cert-auth", "--trusted-ca-file", str(folder / "ca.pem")]
            encrypted += ["--cert-file", str(folder / "hub.pem"), "--key-file", str(folder / "hub.key")]
        command = [
            *("etcd", "--data-dir", f"{self._folder}/data", "--name", "hub", "--log-level", "error"),
            *("--listen-client-urls", f"{scheme}://{self._listen}:{self.port}"),
            *("--advertise-client-urls", f"{scheme}://{self.endpoint}"),
            *("--listen-peer-urls", peer, "--initial-advertise-peer-urls", peer),
            *("--listen-metrics-urls", f"http://127.0.0.1:{self._ports[2]}"),
            *("--initial-cluster", f"hub={peer}", *encrypted, *self._arguments),
        ]
        with open(f"{self._folder}/log", "ab") as log:
            self._process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
        self._await()

    def hang(self) -> None:
        """Stops it without an end."""
        assert self._process is not None
        hang(self._process.pid)

    def resume(self) -> None:
        """Continues the stopped process."""
        self._signal(signal.SIGCONT)

    def kill(self) -> None:
        """Kills the process, as a power cut does."""
        assert self._process is not None
        self._signal(signal.SIGKILL)
        self._process.wait()

    def put_back(self, snapshot: Path) -> None:
        """Replaces the data of a killed etcd by a snapshot; its cluster keeps its token and so its id.

        :raises subprocess.CalledProcessError: when etcdctl refuses the snapshot.
        """
        folder, peer = f"{self._folder}/data", f"http://127.0.0.1:{self._ports[1]}"
        shutil.rmtree(folder)
        command = ["etcdctl", "snapshot", "restore", str(snapshot), "--data-dir", folder, "--name", "hub"]
        command += ["--initial-cluster", f"hub={peer}", "--initial-advertise-peer-urls", peer]
        subprocess.run(command, env=dict(os.environ, ETCDCTL_API="3"), check=True, capture_output=True)

    def save(self, snapshot: Path) -> None:
        """Writes a snapshot of its data, while it runs.

        :raises subprocess.CalledProcessError: when etcdctl fails.
        """
        command = ["etcdctl", "--endpoints", self.endpoint, "snapshot", "save", str(snapshot)]
        subprocess.run(command, env=dict(os.environ, ETCDCTL_API="3"), check=True, capture_output=True)

    def close(self) -> None:
        """Ends the process and removes its data."""
        if self._process is not None and self._process.poll() is None:
            self.kill()
        shutil.rmtree(self._folder, ignore_errors=True)
        release(self._ports)

    def _signal(self, number: int) -> None:
        assert self._process is not None
        self._process.send_signal(number)

    def _await(self) -> None:
        """Waits until it is healthy: one that is killed before it has elected itself never comes back."""
        assert self._process is not None
        end = time.monotonic() + LONG
        while time.monotonic() < end and self._process.poll() is None:
            with contextlib.suppress(OSError), DIRECT.open(
                f"http://127.0.0.1:{self._ports[2]}/health", timeout=5.0
            ) as answer:
                if b'"true"' in answer.read():
                    return
            time.sleep(0.05)  # etcd sends no event when it is ready
        with open(f"{self._folder}/log", encoding="utf-8", errors="replace") as log:
            raise RuntimeError(f"etcd does not start:\n{log.read()[-2000:]}")
