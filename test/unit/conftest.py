# SPDX-License-Identifier: Apache-2.0
"""A master and nodes of the test's own, as processes that can be killed and stopped."""

import contextlib
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
import xmlrpc.client
from io import BytesIO
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Optional, Set

import pytest

from merlin.local_names import master_uri
from merlin_test import LONG
from merlin_test.node_path import LEAN
from merlin_test.ports import free_ports, release
from merlin_test.process_signals import strike

sys.path.insert(0, str(Path(__file__).resolve().parent))

MASTER = """
import signal, sys
from merlin.master import Master
master = Master(int(sys.argv[1]))
print(master.port, flush=True)
signal.pause()
"""


class Process:
    """A process whose output is read line by line while it runs."""

    def __init__(self, command: List[str], env: Dict[str, str]) -> None:
        self.process = subprocess.Popen(
            command,
            env=env,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.lines: List[str] = []
        self._queue: queue.Queue[Optional[str]] = queue.Queue()
        self._reader = threading.Thread(target=self._read, name="output", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self.process.stdout:
            self._queue.put(line.rstrip("\n"))
        self._queue.put(None)

    def say(self, line: str) -> None:
        """Writes a line to its standard input."""
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def expect(self, text: str, limit: float = LONG) -> str:
        """Waits for a new line that contains the text."""
        end = time.monotonic() + limit
        while True:
            try:
                line = self._queue.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                raise AssertionError(f"no {text!r} within {limit:g} s in:\n{self.output}") from None
            if line is None:
                raise AssertionError(f"ended without {text!r}:\n{self.output}")
            self.lines.append(line)
            if text in line:
                return line

    @property
    def output(self) -> str:
        """What was read so far."""
        return "\n".join(self.lines)

    def send(self, number: int) -> None:
        """Sends a signal; one that stops it has stopped all of its threads when this returns."""
        if self.process.poll() is None:
            strike(self.process.pid, number)

    def end(self, number: int = signal.SIGINT) -> int:
        """Sends a signal, waits for the end and returns the exit code; `output` is complete then."""
        if self.process.poll() is None:
            self.send(number)
        return self.ended()

    def ended(self) -> int:
        """Closes its input, waits for the end, returns the exit code; `output` is complete then."""
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        code = self.process.wait(LONG)
        self._reader.join(LONG)
        while True:
            line = self._queue.get(timeout=LONG)
            if line is None:
                self._queue.put(None)
                return code
            self.lines.append(line)


class MasterProcess:
    """A master that can be killed, stopped and started anew on its port, and what runs on it."""

    def __init__(self, home: Path) -> None:
        self.env = {
            **os.environ,
            "ROS_HOME": str(home),
            "ROS_LOG_DIR": str(home / "log"),
        }
        self.env.pop("ROS_NAMESPACE", None)
        (self._port,) = free_ports(1)  # a master that was killed finds its own free again
        self._spawned: List[Process] = []
        self.start()

    def start(self) -> None:
        """Starts a master that knows nothing; always on the same port."""
        self.env["ROS_MASTER_URI"] = self.uri = master_uri(self._port)
        self.process = self.spawn(sys.executable, "-c", LEAN + MASTER, str(self._port))
        assert self.process.expect("") == str(self._port)
        self.api = xmlrpc.client.ServerProxy(self.uri)

    def kill(self) -> None:
        """Ends the master without warning."""
        self.process.end(signal.SIGKILL)

    def spawn(self, *command: str) -> Process:
        """Starts a process that is ended with the test."""
        process = Process(list(command), self.env)
        self._spawned.append(process)
        return process

    def node(self, code: str, *args: str) -> Process:
        """Starts a node from its source."""
        return self.spawn(sys.executable, "-c", LEAN + code, *args)

    def tool(self, name: str, *words: str) -> Process:
        """Starts a tool of ROS whose module has its name: rostopic, rosservice."""
        return self.node(f"import {name}; {name}.{name}main()", *words)

    def address_of(self, name: str) -> str:
        """The address that the master has for a node; empty: it has none."""
        code, _, uri = self.api.lookupNode("/test", name)
        return str(uri) if code == 1 else ""

    @contextlib.contextmanager
    def subscribed(self, node: str, topic: str) -> Iterator[socket.socket]:
        """A subscriber's connection to a publisher, without a node, past the greetings."""
        from rosgraph import network  # which other tests put off

        with xmlrpc.client.ServerProxy(self.address_of(node)) as publisher:
            _, _, (_, *address) = publisher.requestTopic("/listener", topic, [["TCPROS"]])
        with socket.create_connection(address, LONG) as peer:
            fields = {"callerid": "/listener", "topic": topic, "type": "*", "md5sum": "*"}
            network.write_ros_handshake_header(peer, fields)
            network.read_ros_handshake_header(peer, BytesIO(), 65536)
            yield peer

    def close(self) -> None:
        """Ends everything."""
        for process in reversed(self._spawned):
            if process.process.poll() is None:
                process.process.kill()
            process.process.wait()
        release([self._port])


@pytest.fixture
def master(tmp_path: Path) -> Iterator[MasterProcess]:
    """A master of the test's own."""
    process = MasterProcess(tmp_path)
    yield process
    process.close()


class SimulatedClock:
    """The time of ROS, set by a test."""

    def __init__(self) -> None:
        import rospy  # which other tests put off

        self._ros = rospy

    def set(self, seconds: float) -> None:
        """A tick of the clock; an earlier time than before is a jump back."""
        self._ros.rostime._set_rostime(self._ros.Time.from_sec(seconds))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[SimulatedClock]:
    """A simulated clock, at 100 s."""
    made = SimulatedClock()
    rostime = made._ros.rostime
    monkeypatch.setattr(rostime, "_rostime_initialized", True)
    before = set(threading.enumerate())
    made.set(100.0)
    yield made
    end = time.monotonic() + LONG
    for thread in set(threading.enumerate()) - before:
        if thread.name not in ("timer", "running limits"):  # those of the process stay
            # One that looks at the clock later would find none. Not joined: it may be about to be started.
            while thread in threading.enumerate() and time.monotonic() < end:
                time.sleep(0.001)
    rostime.switch_to_wallclock()


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A robot without ROS, with which the missions of a test talk: :class:`fake_robot.FakeRobot`."""
    from fake_robot import FakeRobot, put_in_place  # it imports ROS, which other tests put off

    made = FakeRobot()
    put_in_place(made, monkeypatch)
    return made


@pytest.fixture
def open_files() -> Callable[[], Set[str]]:
    """Gives the files, sockets and pipes behind the descriptors of this process.

    Their count says less: what an earlier test has left may be closed meanwhile.
    """

    def look() -> Set[str]:
        found: Set[str] = set()
        for number in os.listdir("/proc/self/fd"):
            with contextlib.suppress(FileNotFoundError):  # of the listing itself
                found.add(os.readlink(f"/proc/self/fd/{number}"))
        return found

    return look
