# SPDX-License-Identifier: Apache-2.0
"""The port of a node's topics and services, with an entrance that no client blocks, and greetings that end.

rospy reads the greetings of connections one after the other, in the thread that takes them. It waits for
each as long as it takes, lets five more wait, and takes none any more after an error. Its own
greeting of a connection that another thread closes meanwhile keeps a processor busy for ever.
"""

import socket
import struct
from typing import Any, Callable, Optional

from rosgraph.network import write_ros_handshake_header
from rospy.impl import tcpros_base

from merlin_ros.ports.entrance import Entrance
from merlin_ros.work.threads import start_thread

_LENGTH = struct.Struct("<I")
_PROBE_FIELD = b"merlin_probe=1"
#: A greeting that the port itself answers, with one byte.
PROBE = _LENGTH.pack(_LENGTH.size + len(_PROBE_FIELD)) + _LENGTH.pack(len(_PROBE_FIELD)) + _PROBE_FIELD


def use_entrance() -> None:
    """Gives this process an entrance for topics and services; before `rospy.init_node`."""
    tcpros_base.TCPServer = _Server
    tcpros_base.TCPROSTransport.write_header = _write_header


def _write_header(transport: Any) -> None:
    """Greets without rospy's look at the descriptor, which is that of no connection when it was closed."""
    connection, protocol = transport.socket, transport.protocol
    if connection is not None and protocol is not None:
        connection.setblocking(True)
        transport.stat_bytes += write_ros_handshake_header(connection, protocol.get_header_fields())


def greeting_length(said: bytes) -> Optional[int]:
    """Bytes of a TCPROS greeting; None: its length has not come."""
    return _LENGTH.size + _LENGTH.unpack_from(said)[0] if len(said) >= _LENGTH.size else None


class _Server(tcpros_base.TCPServer):
    def __init__(self, inbound_handler: Callable[[Any, Any], None], port: int = 0) -> None:
        super().__init__(inbound_handler, port)
        # Connections inherit it. rospy has no option for services, and the end of an answer of more than
        # 64 kB would wait 40 ms for the acknowledgement of its beginning.
        self.server_sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._entrance = Entrance(self.server_sock, "TCPROS", greeting_length, self._greet)

    def start(self) -> None:
        start_thread("TCPROS", self._entrance.run)

    def shutdown(self) -> None:
        self.is_shutdown = True
        self._entrance.close()

    def _greet(self, connection: socket.socket, address: Any) -> None:
        try:
            probe = connection.recv(len(PROBE), socket.MSG_PEEK) == PROBE
            if probe:
                connection.sendall(b"\0")
        except OSError:
            probe = True  # its client has gone
        if probe:
            connection.close()
        else:
            self.inbound_handler(connection, address)
