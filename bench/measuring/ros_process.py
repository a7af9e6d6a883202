# SPDX-License-Identifier: Apache-2.0
"""ROS processes for benchmarks: a private master on a free port and nodes, all of them ended on exit."""

import contextlib
import os
import signal
import socket
import subprocess
import tempfile
import time
import xmlrpc.client
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional

START_LIMIT = 90.0  # s of wall time for a process to be up; a busy machine is slow, not wrong
STOP_LIMIT = 25.0  # s of wall time between SIGINT and SIGKILL; roslaunch gives a node 15 s, then 2


def free_port() -> int:
    """A TCP port on which no process listens now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class RosMaster:
    """A private ROS master. Making one sets ROS_MASTER_URI for this process and the nodes it starts.

    Use it as a context manager: leaving it ends the nodes and the master.

    :raises RuntimeError: the master does not come up.
    """

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="merlin_bench_")
        self._processes: List[subprocess.Popen[bytes]] = []
        self.uri = f"http://127.0.0.1:{free_port()}"
        self._env = dict(
            os.environ, ROS_MASTER_URI=self.uri, ROS_HOME=self._folder.name, ROS_LOG_DIR=self._folder.name
        )
        os.environ.update(ROS_MASTER_URI=self.uri, ROS_LOG_DIR=self._folder.name)
        self._proxy = xmlrpc.client.ServerProxy(self.uri)
        self._start("rosmaster", ["rosmaster", "--core", "-p", self.uri.rsplit(":", 1)[1]])
        self._wait("the master", lambda: self._proxy.getPid("/bench"))

    def __enter__(self) -> "RosMaster":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def set_params(self, params: Mapping[str, Any]) -> None:
        """Sets parameters by their global names."""
        for name, value in params.items():
            self._proxy.setParam("/bench", name, value)

    def node(
        self,
        package: str,
        executable: str,
        name: str,
        params: Optional[Mapping[str, Any]] = None,
        *remaps: str,
    ) -> "subprocess.Popen[bytes]":
        """Starts a node; parameters are private ones. Its output is in `output(name)`."""
        self.set_params({f"/{name}/{key}": value for key, value in (params or {}).items()})
        return self._start(name, ["rosrun", package, executable, f"__name:={name}", *remaps])

    def launch(self, file: Path, **args: Any) -> "subprocess.Popen[bytes]":
        """Starts a launch file on this master. Its output is in `output("launch")`."""
        arguments = [f"{name}:={value}" for name, value in args.items()]
        return self._start("launch", ["roslaunch", str(file), *arguments])

    def wait_for_service(self, name: str) -> None:
        """Waits until a service is registered.

        :raises RuntimeError: it is not after 90 s, or a process has died.
        """
        self._wait(f"the service {name}", lambda: self._proxy.lookupService("/bench", name))

    def output(self, name: str) -> str:
        """What a node has printed so far."""
        return (Path(self._folder.name) / f"{name}.out").read_text(errors="replace")

    def stop(self) -> None:
        """Ends all processes, the master last."""
        for process in reversed(self._processes):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(STOP_LIMIT)
            except subprocess.TimeoutExpired:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        self._processes.clear()
        self._folder.cleanup()

    def _start(self, name: str, command: List[str]) -> "subprocess.Popen[bytes]":
        with open(Path(self._folder.name) / f"{name}.out", "w") as output:
            process = subprocess.Popen(
                command,
                env=self._env,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self._processes.append(process)
        return process

    def _wait(self, what: str, ask_master: Callable[[], Any]) -> None:
        end = time.monotonic() + START_LIMIT
        while time.monotonic() < end:
            with contextlib.suppress(OSError, xmlrpc.client.Error):
                if ask_master()[0] == 1:  # code, text, value
                    return
            dead = [process.args for process in self._processes if process.poll() is not None]
            if dead:
                raise RuntimeError(f"{dead[0]!r} ended while waiting for {what}")
            time.sleep(0.02)
        raise RuntimeError(f"{what} is not up after {START_LIMIT:.0f} s")


@contextlib.contextmanager
def knowledge_base(
    domain: Path, params: Optional[Dict[str, Any]] = None, name: str = "rosplan_knowledge_base"
) -> Iterator[RosMaster]:
    """A master with a knowledge base on it."""
    with RosMaster() as master:
        master.node("merlin_rosplan", "knowledge_base", name, {"domain_path": str(domain), **(params or {})})
        master.wait_for_service(f"/{name}/apply_effects")
        yield master
