# SPDX-License-Identifier: Apache-2.0
"""A connection that is closed while it greets costs nothing more."""

import contextlib
import socket
import threading
from typing import Any

import pytest
from rospy.exceptions import TransportException
from rospy.impl import tcpros_base
from rospy.impl.tcpros_service import TCPROSServiceClient
from std_srvs.srv import Empty

from merlin_ros.ports import tcpros_port
from merlin_test import LONG


class Closing(socket.socket):
    """Another thread closes it just after its descriptor was read, or before it is used."""

    read = 0

    def fileno(self) -> int:
        number = super().fileno()
        self.read += 1
        if self.read > 1:  # the transport reads it when it gets the socket
            self.close()
        return number

    def setblocking(self, flag: bool) -> None:
        self.close()
        super().setblocking(flag)


def test_a_greeting_on_a_connection_that_is_closed_meanwhile_ends(monkeypatch: Any) -> None:
    monkeypatch.setattr(tcpros_base, "TCPServer", tcpros_base.TCPServer)
    monkeypatch.setattr(tcpros_base.TCPROSTransport, "write_header", tcpros_base.TCPROSTransport.write_header)
    tcpros_port.use_entrance()
    with socket.create_server(("127.0.0.1", 0)) as server, Closing() as own:
        own.connect(server.getsockname())
        transport = tcpros_base.TCPROSTransport(TCPROSServiceClient("/test", Empty), "/test")
        transport.set_socket(own, "peer")

        def greet() -> None:
            with contextlib.suppress(OSError, TransportException):
                transport.write_header()

        greets = threading.Thread(target=greet, daemon=True)
        greets.start()
        greets.join(LONG)
        assert not greets.is_alive()


TALKER = """
import rospy
from std_msgs.msg import Empty

rospy.init_node("talker")
words = rospy.Publisher("/words", Empty, queue_size=1)
print("ready", flush=True)
rospy.spin()
"""


@pytest.mark.processes
def test_a_call_that_is_meant_for_another_node_keeps_none_from_a_test(master: Any) -> None:
    """The port of a node that was killed may be the next one's, and a master calls it without a limit."""
    master.node(TALKER).expect("ready")
    with master.subscribed("/talker", "/words") as peer:
        address = peer.getpeername()
    with socket.create_connection(address, LONG) as stale:
        stale.sendall(b"POST /RPC2 HTTP/1.1\r\nContent-Length: 400\r\n\r\n")
        with master.subscribed("/talker", "/words"):
            pass
