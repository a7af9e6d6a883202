# SPDX-License-Identifier: Apache-2.0
"""Services that answer every request, or close its connection.

rospy forgets a connection whose request it cannot decode: the client waits forever.
"""

import contextlib
import os
import select
import struct
import threading
from typing import Any, Callable, Dict, Iterator, List, Optional

import rospy
from rospy.exceptions import TransportException, TransportTerminated
from rospy.impl import tcpros_base

from merlin_ros.ports.entrance import STALLED
from merlin_ros.work.threads import start_thread

#: Bytes of one request: 100 000 items with names of 500 letters each.
MAX_REQUEST = 128 * 1024 * 1024

_LENGTH = struct.Struct("<I")


class _Serving(threading.local):
    """What the calling thread serves.

    :ivar later: what it does once the request is answered; None: it serves none.
    :ivar connection: socket of its client; None: it has none.
    """

    later: Optional[List[Callable[[], None]]] = None
    connection: Any = None


_serving = _Serving()


def after_answer(call: Callable[[], None]) -> None:
    """Has a function called behind the answer to the request that this thread serves.

    For what a caller must not wait for: a line of a log. At once where the thread serves none.
    """
    if _serving.later is None:
        call()
    else:
        _serving.later.append(call)


@contextlib.contextmanager
def while_wanted(gone: Callable[[], object]) -> Iterator[None]:
    """Within it, a function is called when the client of this request closes its connection.

    For long work, which the function ends, as its answer is not read any more.

    :param gone: called in another thread.
    """
    if _serving.connection is None:  # no request is served
        yield
        return
    ended, end = os.pipe()
    try:
        thread = start_thread("client of a long call", _watch_client, _serving.connection, ended, gone)
    except RuntimeError:
        os.close(ended)
        os.close(end)
        raise
    try:
        yield
    finally:
        os.close(end)
        thread.join()


def _watch_client(connection: Any, ended: int, gone: Callable[[], object]) -> None:
    watch = select.poll()
    watch.register(connection, select.POLLRDHUP)
    watch.register(ended, 0)  # its other end is closed
    try:
        if ended not in [number for number, _ in watch.poll()]:
            gone()
    finally:
        os.close(ended)


def use_for_all() -> None:
    """Makes each later ``rospy.Service(…)`` of this process a :class:`Service`."""
    rospy.Service = Service


class Unanswered(BaseException):
    """Raised by a handler that must not answer: its client finds the connection closed, as of a dead node.

    Not an Exception, which rospy would answer with its text.
    """


class Service(rospy.Service):
    """A service whose connections end with an answer when a request of theirs cannot be decoded."""

    def handle(self, transport: Any, header: Dict[str, str]) -> None:
        """Serves one connection until it ends; called by rospy, in a thread of its own."""
        _serving.connection = transport.socket
        try:
            persistent = header.get("persistent", "").lower() in ("1", "true")
            while header.get("probe") != "1":
                for request in self._receive(transport):
                    self._answer(transport, request)
                if not persistent:
                    break
        except (TransportTerminated, Unanswered):
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
