# SPDX-License-Identifier: Apache-2.0
"""A child process that works for this one: its start, values in both directions, its end."""

import contextlib
import os
import pickle
import signal
import socket
import struct
import subprocess
import sys
from typing import Any, Mapping, Optional, Sequence

from merlin_ros.processes.process_tree import end_with

_LENGTH = struct.Struct("<Q")


class ChildProcess:
    """Runs the function ``main`` of a module in a process of its own; :func:`parent` is its first call there.

    The process has the modules of this one, wherever they come from, and a session of its own, where no
    Ctrl-C reaches it. The socket closes when this process ends, however it ends; the child has to end then.

    :param module: full name.
    :param arguments: words of its command line.
    :param descriptors: that it inherits.
    :param environment: None: that of this process.
    :raises OSError: it cannot be started.
    :ivar channel: the socket to it.
    """

    def __init__(
        self,
        module: str,
        *arguments: str,
        descriptors: Sequence[int] = (),
        environment: Optional[Mapping[str, str]] = None,
    ) -> None:
        # Not by PYTHONPATH: what the child starts would inherit that.
        program = f"import sys; sys.path[:] = {sys.path!r}; from {module} import main; main()"
        self.channel, theirs = socket.socketpair()
        self.channel.settimeout(None)  # rospy sets one for all sockets
        with contextlib.ExitStack() as unless_begun, theirs:
            unless_begun.callback(self.channel.close)
            ends = (str(theirs.fileno()), str(os.getpid()))
            self._process = subprocess.Popen(
                [sys.executable, "-c", program, *arguments, *ends],
                pass_fds=(theirs.fileno(), *descriptors),
                env=environment,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
            unless_begun.pop_all()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it has not ended; its socket closes before that can be seen."""
        return self._process.poll() is None

    def wait(self, limit: float) -> bool:
        """Waits for its end, at most ``limit`` s of wall time; returns whether it has ended."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(limit)
        return not self.alive

    def interrupt(self) -> None:
        """Ends a wait for a value, from another thread."""
        with contextlib.suppress(OSError):  # closed on the other side
            self.channel.shutdown(socket.SHUT_RDWR)

    def kill(self) -> int:
        """Kills it, also one that hangs.

        :return: its exit code; negative: the signal that ended it.
        """
        self._process.kill()
        code = self._process.wait()
        self.channel.close()
        return code


def parent(dies_with_thread: bool = False) -> socket.socket:
    """In the child: the socket to the process that started it.

    :param dies_with_thread: whether the kernel kills the child when the thread that started it ends. A closed
        socket says the same, but a process that was stopped does not notice.
    """
    descriptor, starter = map(int, sys.argv[-2:])
    if dies_with_thread and not end_with(starter, signal.SIGKILL):
        os._exit(0)
    channel = socket.socket(fileno=descriptor)
    channel.setblocking(True)  # it is not, where the starter has a default time limit for sockets
    return channel


def send(channel: socket.socket, value: Any) -> None:
    """Sends a value to the other end, which runs the same code.

    :raises OSError: it does not listen.
    """
    data = pickle.dumps(value, protocol=4)
    channel.sendall(_LENGTH.pack(len(data)) + data)


def receive(channel: socket.socket) -> Any:
    """Waits for a value.

    :raises EOFError: the other end is closed.
    :raises OSError: nothing came within the socket's time limit, or it is closed here.
    """
    (length,) = _LENGTH.unpack(_exactly(channel, _LENGTH.size))
    return pickle.loads(_exactly(channel, length))


def _exactly(channel: socket.socket, length: int) -> bytes:
    received = bytearray()
    while len(received) < length:
        part = channel.recv(length - len(received))
        if not part:
            raise EOFError
        received += part
    return bytes(received)
