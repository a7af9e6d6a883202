"""Values over a socket between the simulator and the process that makes its pictures."""

import pickle
import socket
import struct
from typing import Any

_LENGTH = struct.Struct("<Q")


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
