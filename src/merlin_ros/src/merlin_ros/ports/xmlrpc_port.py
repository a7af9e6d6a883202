# SPDX-License-Identifier: Apache-2.0
"""The XML-RPC server of a node, a master or a launch, with an entrance that no client blocks."""

import re
import threading
from typing import Any, Optional

import rosgraph.xmlrpc

from merlin_ros.ports.entrance import LONGEST, Entrance

#: s of wall time for which a client may keep a connection and ask nothing; rospy's own limit.
IDLE = 60.0

_LENGTH = re.compile(rb"\r\ncontent-length:\s*(\d{1,18})", re.IGNORECASE)
#: A question that costs little. The answer is that there is no such method.
PROBE = b"HEAD / HTTP/1.0\r\n\r\n"


def use_entrance() -> None:
    """Gives all later XML-RPC servers of the process an entrance. May be called again."""
    rosgraph.xmlrpc.ThreadingXMLRPCServer = _Server
    node = rosgraph.xmlrpc.XmlRpcNode
    closes = node.shutdown
    if closes.__module__ == __name__:
        return

    def shutdown(self: rosgraph.xmlrpc.XmlRpcNode, reason: str) -> None:
        # rosgraph only closes the socket, without a word to the thread that waits at it.
        self.is_shutdown = True
        if self.server is not None:
            self.server.shutdown()
        closes(self, reason)

    node.shutdown = shutdown


def request_length(said: bytes) -> Optional[int]:
    """Bytes of an HTTP request, as far as they are waited for; None: its header is not complete."""
    header = said.find(b"\r\n\r\n") + 4
    if header < 4:
        return None
    found = _LENGTH.search(said, 0, header)
    length = header + (int(found.group(1)) if found else 0)
    return length if length <= LONGEST else header  # the server reads the rest


class _Handler(rosgraph.xmlrpc.SilenceableXMLRPCRequestHandler):
    timeout = IDLE


class _Server(rosgraph.xmlrpc.ThreadingXMLRPCServer):
    def __init__(self, address: Any, log_requests: int = 1) -> None:
        super().__init__(address, log_requests)
        self.RequestHandlerClass = _Handler
        self._entrance = Entrance(self.socket, "XML-RPC", request_length, self.process_request_thread)

    def serve_forever(self, poll_interval: float = 0.5) -> None:
        threading.current_thread().name = "XML-RPC"
        self._entrance.run()

    def shutdown(self) -> None:
        self._entrance.close()
