# SPDX-License-Identifier: Apache-2.0
"""A ROS master inside this process, on a port that another process cannot take in between.

Finding a free port first and starting `rosmaster` on it afterwards is a race that two runs started
together lose now and then; binding port 0 is not.
"""

import contextlib
import http.client
import threading
import weakref
import xmlrpc.client
from typing import Any, Callable, Optional
from xml.parsers.expat import ExpatError

import rosgraph.xmlrpc
import rosmaster.master_api
import rosmaster.registrations

from merlin_ros.alarms import wait_ticks
from merlin_ros.ports.xmlrpc_port import use_entrance
from merlin_ros.work.threads import CallQueue

#: s that binding a socket may take; a stall of this process uses up none.
START_TIMEOUT = 10.0
#: Longest wait of the master for a node, s of wall time. The call has reached one that hangs.
NODE_TIMEOUT = 60.0


class MasterError(Exception):
    """The master cannot be started; the text says why."""


class _Server(rosgraph.xmlrpc.XmlRpcNode):
    """The master's XML-RPC server; sets an event when it is bound or has failed."""

    def __init__(self, port: int, handler: rosgraph.xmlrpc.XmlRpcHandler) -> None:
        super().__init__(port, handler, on_run_error=self._failed)
        self.settled = threading.Event()
        self.error: Optional[Exception] = None

    def set_uri(self, uri: str) -> None:
        super().set_uri(uri)
        self.settled.set()

    def _failed(self, error: Exception) -> None:
        self.error = error
        self.settled.set()


class _Transport(xmlrpc.client.Transport):
    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = NODE_TIMEOUT
        return connection


class _Node(CallQueue):
    """What the master has to call at a node; the connection ends with the last call that waits."""

    def __init__(self, address: str) -> None:
        super().__init__("notifies a node")
        self.proxy = xmlrpc.client.ServerProxy(address, transport=_Transport())

    def call(self, task: Callable[..., Any], *args: Any) -> None:
        """Calls the node after what waits."""
        self.put(self._call, task, *args)

    def _call(self, task: Callable[..., Any], *args: Any) -> None:
        # The node has ended, or hangs, or is another program; rosmaster has logged it.
        with contextlib.suppress(OSError, http.client.HTTPException, xmlrpc.client.Error, ExpatError):
            task(*args)


class _Notifier:
    """Makes the master's calls to nodes: those to one node one after the other, and all at once.

    It takes the place of rosmaster's pool of three threads. These look for work every 0.1 s, and a node that
    hangs holds one of them until it ends: with three such nodes no other one hears of a new publisher.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the field below
        # By address; the thread of one that is being called holds it.
        self._nodes: weakref.WeakValueDictionary[str, _Node] = weakref.WeakValueDictionary()

    def queue_task(self, marker: str, task: Callable[..., Any], args: Any) -> None:
        """Has a node called.

        :param marker: its address.
        """
        self._node(marker).call(task, *args)

    def proxy(self, address: str) -> xmlrpc.client.ServerProxy:
        """The connection to a node, for a call that was queued."""
        return self._node(address).proxy

    def join_all(self, **_: bool) -> None:
        """Is called at the end of a master; calls that wait at its nodes end with the process."""

    def _node(self, address: str) -> _Node:
        with self._lock:
            node = self._nodes.get(address)
            if node is None:
                node = self._nodes[address] = _Node(address)
        return node


_notifier = _Notifier()


class Master:
    """The master of one run.

    :ivar port: the port it listens on.
    """

    def __init__(self, port: Optional[int] = None) -> None:
        """Starts the master.

        :param port: TCP port; None: any free one.
        :raises MasterError: the port is taken.
        """
        use_entrance()  # the thread of rosgraph's own server would work on after the end, at full speed
        handler = rosmaster.master_api.ROSMasterHandler(0)  # threads of its own
        handler.thread_pool = handler.reg_manager.thread_pool = _notifier
        rosmaster.master_api.xmlrpcapi = rosmaster.registrations.xmlrpcapi = _notifier.proxy
        self._server = _Server(port or 0, handler)
        self._server.start()
        if not wait_ticks(self._server.settled.wait, START_TIMEOUT) or self._server.error is not None:
            reason = self._server.error or f"not ready after {START_TIMEOUT:.0f} s"
            raise MasterError(
                f"the ROS master cannot use port {port or '(any)'} ({reason}); stop what holds it, "
                "or leave port:= out to get a free one"
            )
        self.port: int = self._server.port

    def stop(self) -> None:
        """Closes the port."""
        self._server.shutdown("run ended")
