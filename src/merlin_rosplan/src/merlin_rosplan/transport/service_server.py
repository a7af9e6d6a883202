"""Services that answer every request, or close its connection; and a door that is not blocked by one client.

rospy reads the greeting of one connection after the other, lets five more wait, and forgets a connection
whose request it cannot decode: the client waits forever.
"""

import contextlib
import socket
import struct
import threading
from typing import Any, Callable, Dict, List, Optional

import rospy
from rospy.exceptions import TransportException, TransportTerminated
from rospy.impl import tcpros_base

#: Connections that may wait to be greeted.
BACKLOG = 256
#: Bytes of a greeting: service or topic, type and the client's name.
MAX_GREETING = 64 * 1024
#: s of wall time for a greeting, and between two pieces of one request.
STALLED = 10.0
#: Bytes of one request: 100 000 items with names of 500 letters each.
MAX_REQUEST = 128 * 1024 * 1024

_LENGTH = struct.Struct("<I")


class _Serving(threading.local):
    """What the calling thread does once the request that it serves is answered; None: it serves none."""

    later: Optional[List[Callable[[], None]]] = None


_serving = _Serving()


def after_answer(call: Callable[[], None]) -> None:
    """Has a function called behind the answer to the request that this thread serves.

    For what a caller must not wait for: a line of a log. At once where the thread serves none.
    """
    if _serving.later is None:
        call()
    else:
        _serving.later.append(call)


class Service(rospy.Service):
    """A service whose connections end with an answer when a request of theirs cannot be decoded."""

    def handle(self, transport: Any, header: Dict[str, str]) -> None:
        """Serves one connection until it ends; called by rospy, in a thread of its own."""
        try:
            persistent = header.get("persistent", "").lower() in ("1", "true")
            while header.get("probe") != "1":
                for request in self._receive(transport):
                    self._answer(transport, request)
                if not persistent:
                    break
        except TransportTerminated:
            pass  # the client has gone, or has said half of a request and nothing since
        except (TransportException, OSError) as error:
            reason = str(error)[:300]
            rospy.logwarn("%s: a request of %s is refused: %s", self.resolved_name, _client(header), reason)
            with contextlib.suppress(TransportException, OSError):
                self._write_service_error(transport, f"the request cannot be read: {reason}")
        finally:
            transport.close()

    def _answer(self, transport: Any, request: Any) -> None:
        later: List[Callable[[], None]] = []
        _serving.later = later
        try:
            self._handle_request(transport, request)
        finally:
            _serving.later = None
            for call in later:
                call()

    def _receive(self, transport: Any) -> List[Any]:
        """Waits for the next request.

        :raises TransportTerminated: the connection is closed, or silent within a request.
        :raises TransportException: the request cannot be decoded, or is too long.
        """
        received, connection = transport.read_buff, transport.socket
        requests: List[Any] = []
        while not requests:
            if received.tell() >= _LENGTH.size:
                (length,) = _LENGTH.unpack_from(received.getbuffer())
                if length > MAX_REQUEST:
                    raise TransportException(f"it has {length} bytes, more than {MAX_REQUEST}")
                try:
                    self.protocol.read_messages(received, requests, connection)
                except Exception as error:  # generated code ends with whatever it stumbles over
                    raise TransportException(str(error)) from error
            if not requests:
                connection.settimeout(STALLED if received.tell() else None)
                transport.stat_bytes += tcpros_base.recv_buff(connection, received, self.protocol.buff_size)
        connection.settimeout(None)
        transport.stat_num_msg += len(requests)
        for request in requests:
            request._connection_header = transport.header
        return requests


def _client(header: Dict[str, str]) -> str:
    return header.get("callerid", "an unnamed client")[:80]


def open_door() -> None:
    """Prepares the socket where rospy listens for topics and services. May be called again.

    Accepted connections inherit TCP_NODELAY: rospy has no option for services, and the end of an answer of
    more than 64 kB would wait 40 ms for the acknowledgement of its beginning.
    """
    server = getattr(tcpros_base._tcpros_server, "tcp_ros_server", None)
    listening = getattr(server, "server_sock", None)
    if server is None or listening is None or isinstance(server.inbound_handler, _Greeter):
        return
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    listening.listen(BACKLOG)
    server.inbound_handler = _Greeter(server.inbound_handler)


class _Greeter:
    """Greets each new connection in a thread of its own, for a limited time."""

    def __init__(self, greet: Callable[[Any, Any], None]) -> None:
        self._greet = greet

    def __call__(self, connection: Any, address: Any) -> None:
        threading.Thread(
            target=self._run, args=(connection, address), name="greeting of a connection", daemon=True
        ).start()

    def _run(self, connection: Any, address: Any) -> None:
        """Waits for the whole greeting before rospy reads it.

        rospy hands the connection to another thread, which sets time-outs of its own: none may be set here
        once that has begun.
        """
        try:
            connection.settimeout(None)
            _limit_receiving(connection, STALLED)
            whole = self._greeting_is_there(connection)
            _limit_receiving(connection, 0.0)
        except OSError:
            whole = False
        if whole:
            self._greet(connection, address)
        else:
            connection.close()  # rospy would log a greeting of any length

    def _greeting_is_there(self, connection: Any) -> bool:
        peek = socket.MSG_PEEK | socket.MSG_WAITALL
        start = connection.recv(_LENGTH.size, peek)
        if len(start) < _LENGTH.size:
            return False
        length = _LENGTH.size + _LENGTH.unpack(start)[0]
        return length <= MAX_GREETING and len(connection.recv(length, peek)) == length


def _limit_receiving(connection: Any, seconds: float) -> None:
    """Limits each wait for bytes in the kernel; 0 means no limit."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", int(seconds), 0))
