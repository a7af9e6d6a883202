# SPDX-License-Identifier: Apache-2.0
"""A ROS master inside this process, on a port that another process cannot take in between.

Finding a free port first and starting `rosmaster` on it afterwards is a race that two runs started
together lose now and then; binding port 0 is not.
"""

import threading
from typing import Optional

import rosgraph.xmlrpc
import rosmaster.master_api

#: Wall seconds that binding a socket may take.
START_TIMEOUT = 10.0


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


class Master:
    """The master of one run.

    :ivar port: the port it listens on.
    """

    def __init__(self, port: Optional[int] = None) -> None:
        """Starts the master.

        :param port: TCP port; None: any free one.
        :raises MasterError: the port is taken.
        """
        handler = rosmaster.master_api.ROSMasterHandler(rosmaster.master_api.NUM_WORKERS)
        self._server = _Server(port or 0, handler)
        self._server.start()
        if not self._server.settled.wait(START_TIMEOUT) or self._server.error is not None:
            reason = self._server.error or f"not ready after {START_TIMEOUT:.0f} s"
            raise MasterError(
                f"the ROS master cannot use port {port or '(any)'} ({reason}); stop what holds it, "
                "or leave port:= out to get a free one"
            )
        self.port: int = self._server.port

    def stop(self) -> None:
        """Closes the port."""
        self._server.shutdown("run ended")
