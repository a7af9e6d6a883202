# SPDX-License-Identifier: Apache-2.0
"""The service proxy of MERLIN: persistent, shared between threads, aware of a server that restarted."""

import ast
import contextlib
import math
import select
import socket
import threading
import time
from typing import Any, Callable, Optional, TypeVar

import rosgraph
import rospy
from rosgraph.network import write_ros_handshake_header
from rospy.exceptions import ROSException, TransportException
from rospy.impl.tcpros_base import TCPROSTransport

from merlin_ros.alarms import Alarm, call_later
from merlin_ros.call_scope import CallScope, current_scope
from merlin_ros.deadline import Deadline
from merlin_ros.master.master_link import ERRORS, lookup_service, lost

#: Longest wait for a server to take a connection, s of wall time: a hung one never does.
CONNECT_LIMIT = 5.0
RETURN_LIMIT = 30.0  # s of running time for a server that died to come back
RETRY = 0.3  # s of wall time between two attempts to reach it

T = TypeVar("T")


class ServiceError(rospy.ServiceException):
    """A call that gave no answer; the text is a sentence that names the service and says why."""


class ServiceUnavailable(ServiceError):
    """No answer came: the service does not exist, or its process died. It may return."""


class _Client(rospy.ServiceProxy):
    """rospy's proxy, with a look-up that ends when the master hangs, and connecting when the server does."""

    connect_limit = CONNECT_LIMIT
    found = ""  # where the service is, for the next call, when that is known
    connecting: Optional[TCPROSTransport] = None
    scope: CallScope = current_scope()
    given_up = False  # the call's time limit has passed, maybe before there was a socket to wake
    transport: Any

    def call(self, *args: Any, **fields: Any) -> Any:
        """Calls the service; see rospy."""
        if self.transport is None:
            host, port = rospy.core.parse_rosrpc_uri(self._get_service_uri(None))
            transport = TCPROSTransport(self.protocol, self.resolved_name)
            transport.buff_size = self.buff_size
            # rospy takes the socket's timeout away before it reads the server's header.
            limit = call_later(self.connect_limit, lambda: _wake(transport))
            self.connecting = transport
            try:
                if self.scope.ended or self.given_up:  # while it was looked up
                    raise TransportException("given up")
                transport.connect(host, port, self.uri, timeout=self.connect_limit)
            except TransportException:
                transport.close()
                raise
            finally:
                limit.cancel()
            self.transport, self.connecting = transport, None
            if self.scope.ended or self.given_up:  # before there was a socket to wake
                raise TransportException("given up")
        return super().call(*args, **fields)

    def _get_service_uri(self, _: Any) -> str:
        found, self.found = self.found, ""
        try:
            self.uri = found or lookup_service(self.resolved_name)
        except rosgraph.MasterError:
            raise rospy.ServiceException(f"nothing offers {self.resolved_name}") from None
        except ERRORS as error:
            raise rospy.ServiceException(f"cannot look it up: {error}") from error
        return self.uri


class ServiceProxy:
    """Calls one service over a connection that is kept.

    rospy's persistent proxy has no lock and keeps a connection that has died; this one has a lock, sees a
    connection that the server closed *before* it sends a request, and connects again. A request is never sent
    twice: a failure after sending is reported. A call ends early with the
    :class:`~merlin_ros.call_scope.CallScope` that it is made in.

    :param name: of the service, relative names allowed.
    :param service_class: the generated service type.
    :param timeout: longest wait for an answer, s of wall time in which this process is not stalled; None: as
        long as it takes.
    :param patience: longest wait of the first call for the service to be offered, s of wall time: a client
        that is started together with the server may call at once.
    """

    def __init__(
        self, name: str, service_class: type, timeout: Optional[float] = None, patience: float = 0.0
    ) -> None:
        self.name = rospy.resolve_name(name)
        self._service_class = service_class
        self._timeout = timeout
        self._patience = patience
        self._free = threading.Condition()  # guards _user: one call at a time uses the proxy
        self._user: Optional[CallScope] = None
        self._proxy: Optional[_Client] = None
        self._nodelay = False

    def __call__(self, *args: Any, **fields: Any) -> Any:
        """Calls the service with a request, or with the request's fields.

        :raises ServiceError: when there is no answer.
        """
        scope = current_scope()
        with scope.calling(lambda: self._wake(scope)):
            if not self._occupy(scope):
                raise ServiceUnavailable(f"service {self.name} does not answer: others wait for it too")
            try:
                return self._call(scope, *args, **fields)
            finally:
                self._leave()

    def _call(self, scope: CallScope, *args: Any, **fields: Any) -> Any:
        begin = time.monotonic()
        patience, self._patience = self._patience, 0.0
        # Without a master nothing new is found, however long one waits.
        found = self._find(patience, lambda: scope.ended or lost.is_set()) if patience else ""
        limit = None
        try:
            proxy = self._connection()
            proxy.scope, proxy.given_up, proxy.found = scope, False, found
            if scope.ended:
                raise TransportException("given up")
            if self._timeout is not None:
                limit = call_later(self._timeout, lambda: self._give_up(proxy))
            return proxy(*args, **fields)
        except (rospy.ServiceException, ROSException, TransportException, OSError) as error:
            self._close()
            if "responded with an error" in str(error):
                raise ServiceError(f"service {self.name} failed: {_reason(str(error))}") from error
            waited = time.monotonic() - begin
            why = f"given up after {waited:.1f} s" if scope.ended else self._why(error, limit)
            raise ServiceUnavailable(f"service {self.name} does not answer: {why}") from error
        except BaseException:  # a request that cannot be written: half of it would go in front of the next
            self._close()
            raise
        finally:
            if limit is not None:
                limit.cancel()

    def wait(self, timeout: Optional[float] = None) -> bool:
        """Waits until the service is offered.

        :param timeout: s of wall time; None: until ROS shuts down.
        :return: whether it is offered.
        """
        return bool(self._find(timeout, lambda: False))

    def _find(self, timeout: Optional[float], given_up: Callable[[], bool]) -> str:
        """Where the service is, as soon as it is offered; empty: it is not in time."""
        begin = time.monotonic()
        end = math.inf if timeout is None else begin + timeout
        while not rospy.is_shutdown() and not given_up():
            found, now = self._look(), time.monotonic()
            if found or now >= end:
                return found
            # The master does not announce a new service; the proxy asks again, at start-up only.
            time.sleep(min(max(0.02, 0.1 * (now - begin)), 0.2, end - now))
        return ""

    def offered(self) -> bool:
        """Whether the master knows the service; that of a server that is busy or hangs is offered too.

        :raises ServiceUnavailable: when the master gives no answer.
        """
        try:
            lookup_service(self.name)
        except rosgraph.MasterError:
            return False
        except ERRORS as error:
            raise ServiceUnavailable(
                f"whether there is a service {self.name} is not known: {error}"
            ) from error
        return True

    def available(self) -> bool:
        """Whether the master knows the service and its server accepts connections."""
        return bool(self._look())

    def _look(self) -> str:
        try:
            uri = lookup_service(self.name)
            host, port = rospy.core.parse_rosrpc_uri(uri)
            with socket.create_connection((host, port), timeout=1.0) as connection:
                header = {"probe": "1", "md5sum": "*", "callerid": rospy.get_name(), "service": self.name}
                write_ros_handshake_header(connection, header)
                return uri
        except ERRORS:
            return ""

    @property
    def connected(self) -> bool:
        """Whether the server that answered last is still there: its connection is open, and nothing comes."""
        proxy = self._proxy
        try:
            return proxy is not None and self._alive(proxy)
        except (OSError, ValueError):  # another thread closes it
            return False

    def close(self) -> None:
        """Closes the connection; the next call opens another. Waits for a call under way."""
        scope = CallScope()  # of its own: one that has ended would not wait
        self._occupy(scope)
        self._close()
        self._leave()

    def _occupy(self, scope: CallScope) -> bool:
        """Waits until the proxy is free, and takes it; False when the scope ends before."""
        with self._free:
            self._free.wait_for(lambda: self._user is None or scope.ended)
            if self._user is not None:
                return False
            self._user = scope
            return True

    def _leave(self) -> None:
        with self._free:
            self._user = None
            self._free.notify_all()

    def _wake(self, scope: CallScope) -> None:
        """Wakes the thread of a scope that has ended, wherever it waits, and no other one."""
        with self._free:
            self._free.notify_all()
            if self._user is scope and self._proxy is not None:
                self._give_up(self._proxy)

    def _why(self, error: Exception, limit: Optional[Alarm]) -> str:
        """A sentence for a failed call: `[Errno 111]` does not name the node to restart."""
        if limit is not None and not limit.waits:
            return f"no answer within {self._timeout:g} s"
        text = str(error)
        if "timed out" in text:
            return "its node hangs: it takes no connection"
        if "md5sum" in text:  # rospy and roscpp have no more than that word in common
            return f"it is of another type than {getattr(self._service_class, '_type', '')}"
        if isinstance(error, ConnectionRefusedError) or "refused" in text or "unavailable" in text:
            return "its node does not run"
        if isinstance(error, (TransportException, OSError)) or "transport error" in text:
            return "its node has ended, or broke the connection"
        return text

    def _connection(self) -> _Client:
        if self._proxy is not None and not self._alive(self._proxy):
            self._close()
        if self._proxy is None:
            self._proxy = _Client(self.name, self._service_class, persistent=True)
            if self._timeout is not None:
                self._proxy.connect_limit = min(self._timeout, CONNECT_LIMIT)
        elif not self._nodelay:
            # A request of several segments would wait for the acknowledgement of the first.
            self._proxy.transport.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._nodelay = True
        return self._proxy

    @staticmethod
    def _give_up(proxy: _Client) -> None:
        proxy.given_up = True
        connecting = proxy.connecting  # first: what is connected meanwhile is found in the other one
        transport = proxy.transport or connecting
        if transport is not None:
            _wake(transport)

    @staticmethod
    def _alive(proxy: rospy.ServiceProxy) -> bool:
        transport = proxy.transport
        if transport is None or transport.socket is None:
            return False
        # Between calls nothing may be readable; readable means the peer has closed (or broken the protocol).
        poll = select.poll()
        poll.register(transport.socket, select.POLLIN)
        return not poll.poll(0)

    def _close(self) -> None:
        if self._proxy is not None:
            self._proxy.close()
            self._proxy = None
            self._nodelay = False


def when_back(
    call: Callable[[], T],
    limit: float = RETURN_LIMIT,
    on_gone: Callable[[], object] = lambda: None,
    given_up: Optional[threading.Event] = None,
) -> T:
    """Calls a service; one that does not answer is called again until it is back.

    :param call: repeats nothing that was done already.
    :param limit: s of running time.
    :param on_gone: called once when it does not answer, unless that is the last attempt.
    :param given_up: ends the wait when it is set.
    :raises ServiceUnavailable: when it does not come back.
    """
    deadline = Deadline(limit)
    pause, warned = given_up or threading.Event(), False
    while True:
        try:
            return call()
        except ServiceUnavailable:
            # The master gives no event when a service is offered again.
            if deadline.expired or pause.wait(0.0):
                raise
            if not warned:
                on_gone()
            warned = True
            if pause.wait(min(RETRY, deadline.remaining() + 0.01)):
                raise


def _wake(transport: TCPROSTransport) -> None:
    """Ends the wait of the thread that reads from a connection; closing the socket would not."""
    with contextlib.suppress(OSError, AttributeError):
        transport.socket.shutdown(socket.SHUT_RDWR)


def _reason(text: str) -> str:
    """The server's own words in rospy's report of them, which shows them as the bytes that came."""
    said = text.split("responded with an error:", 1)[-1].strip()
    with contextlib.suppress(Exception):  # a foreign server's words may be too deep for Python's parser
        value = ast.literal_eval(said)
        said = value.decode(errors="replace") if isinstance(value, bytes) else said
    for opening in ("service cannot process request:", "error processing request:"):
        said = said[len(opening) :] if said.startswith(opening) else said
    return said.strip() or "no reason given"
