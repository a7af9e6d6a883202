"""The service proxy of MERLIN: persistent, shared between threads, aware of a server that restarted."""

import ast
import contextlib
import select
import socket
import threading
import time
from typing import Any, Optional

import rosgraph
import rospy
from rosgraph.network import write_ros_handshake_header
from rospy.exceptions import ROSException, TransportException


class ServiceError(rospy.ServiceException):
    """A call that gave no answer; the text is a sentence that names the service and says why."""


class ServiceProxy:
    """Calls one service over a connection that is kept.

    rospy's persistent proxy has no lock and keeps a connection that has died; this one has a lock, sees a
    connection that the server closed *before* it sends a request, and connects again. A request is never sent
    twice: a failure after sending is reported.

    :param name: of the service, relative names allowed.
    :param service_class: the generated service type.
    :param timeout: longest wait for an answer, s of wall time; None: as long as it takes.
    :param patience: longest wait of the first call for the service to be offered, s of wall time: whoever is
        started together with the server may call at once.
    """

    def __init__(
        self, name: str, service_class: type, timeout: Optional[float] = None, patience: float = 0.0
    ) -> None:
        self.name = rospy.resolve_name(name)
        self._service_class = service_class
        self._timeout = timeout
        self._patience = patience
        self._lock = threading.Lock()  # one call at a time; guards the proxy
        self._proxy: Optional[rospy.ServiceProxy] = None
        self._nodelay = False

    def __call__(self, *args: Any, **fields: Any) -> Any:
        """Calls the service with a request, or with the request's fields.

        :raises ServiceError: when there is no answer.
        """
        with self._lock:
            patience, self._patience = self._patience, 0.0
            if patience:
                self.wait(patience)
            limit = None
            try:
                proxy = self._connection()
                if self._timeout is not None:
                    limit = threading.Timer(self._timeout, self._give_up, [proxy])
                    limit.daemon = True
                    limit.start()
                return proxy(*args, **fields)
            except (rospy.ServiceException, ROSException, TransportException, OSError) as error:
                self._close()
                if "responded with an error" in str(error):
                    raise ServiceError(f"service {self.name} failed: {_reason(str(error))}") from error
                raise ServiceError(f"service {self.name} does not answer: {error}") from error
            finally:
                if limit is not None:
                    limit.cancel()

    def wait(self, timeout: Optional[float] = None) -> bool:
        """Waits until the service is offered.

        :param timeout: s of wall time; None: until ROS shuts down.
        :return: whether it is offered.
        """
        end = None if timeout is None else time.monotonic() + timeout
        while not rospy.is_shutdown():
            if self.available():
                return True
            if end is not None and time.monotonic() >= end:
                return False
            # The master tells nobody of a new service; asking is all there is, at start-up only.
            time.sleep(0.02)
        return False

    def available(self) -> bool:
        """Whether the master knows the service and its server accepts connections."""
        try:
            uri = rosgraph.Master(rospy.get_name()).lookupService(self.name)
            host, port = rospy.core.parse_rosrpc_uri(uri)
            with socket.create_connection((host, port), timeout=1.0) as connection:
                header = {"probe": "1", "md5sum": "*", "callerid": rospy.get_name(), "service": self.name}
                write_ros_handshake_header(connection, header)
                return True
        except (OSError, rosgraph.MasterException):
            return False

    def close(self) -> None:
        """Closes the connection; the next call opens another."""
        with self._lock:
            self._close()

    def _connection(self) -> rospy.ServiceProxy:
        if self._proxy is not None and not self._alive(self._proxy):
            self._close()
        if self._proxy is None:
            self._proxy = rospy.ServiceProxy(self.name, self._service_class, persistent=True)
        elif not self._nodelay:
            # A request of several segments would wait for the acknowledgement of the first.
            self._proxy.transport.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._nodelay = True
        return self._proxy

    @staticmethod
    def _give_up(proxy: rospy.ServiceProxy) -> None:
        # Closing a socket does not wake who reads from it; shutting it down does.
        with contextlib.suppress(OSError, AttributeError):
            proxy.transport.socket.shutdown(socket.SHUT_RDWR)

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


def _reason(text: str) -> str:
    """The server's own words in rospy's report of them, which shows them as the bytes that came."""
    said = text.split("responded with an error:", 1)[-1].strip()
    with contextlib.suppress(ValueError, SyntaxError):
        value = ast.literal_eval(said)
        said = value.decode(errors="replace") if isinstance(value, bytes) else said
    for opening in ("service cannot process request:", "error processing request:"):
        said = said[len(opening) :] if said.startswith(opening) else said
    return said.strip() or "no reason given"
