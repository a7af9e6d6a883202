# SPDX-License-Identifier: Apache-2.0
"""The process that makes pictures: ``main`` serves one simulator until that one ends, however it ends.

It has no connections of ROS. Shots (:class:`.shot.Shot`) come over a socket; their pixels go into memory that
both processes share, and the number of bytes, or the text of an error, is sent back.
"""

import contextlib
import mmap
import os
import signal
import socket
import sys

from merlin_ros.processes.child_process import parent, receive, send
from merlin_ros.processes.process_priority import inherit_priority


def main() -> None:
    """Entry point of the process; its last argument is the shared memory."""
    memory = int(sys.argv[-3])
    # The simulator says when to end, not a terminal; a SIGTERM means this process alone.
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    channel = parent(dies_with_thread=True)
    inherit_priority()  # the simulator yields to the robots' software
    with channel, contextlib.suppress(EOFError, OSError):
        _serve(channel, memory)
    os._exit(0)


def _serve(channel: socket.socket, memory: int) -> None:
    try:
        from merlin_sim.rendering.picture_engine import PictureEngine  # takes its time

        engine = PictureEngine()
    except (ImportError, RuntimeError) as error:  # the library is missing, or a part of it
        send(channel, str(error))
        return
    send(channel, None)  # ready
    while True:
        shot = receive(channel)
        try:
            length = _share(engine.expose(shot).tobytes(), memory)
        except Exception as error:  # the client gets it; the next shot brings everything again
            engine.close()
            send(channel, f"{type(error).__name__}: {error}")
            continue
        send(channel, length)


def _share(pixels: bytes, memory: int) -> int:
    if os.fstat(memory).st_size < len(pixels):
        os.ftruncate(memory, len(pixels))
    with mmap.mmap(memory, len(pixels)) as shared:
        shared[:] = pixels
    return len(pixels)
