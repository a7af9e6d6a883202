# SPDX-License-Identifier: Apache-2.0
"""A link between a page and its monitor that can stall: connections stay open, and nothing comes through."""

import contextlib
import socket
import threading
from typing import List
from urllib.parse import urlsplit

CHUNK = 65536  # bytes


class StalledLink:
    """Forwards connections of a port of its own to a server, until `hold` is called.

    :param url: of the server.
    """

    def __init__(self, url: str) -> None:
        where = urlsplit(url)
        self._server = where.hostname or "", where.port or 80
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listener.getsockname()[1]}/"
        self._open = threading.Event()
        self._open.set()
        self._ended = False
        self._sockets: List[socket.socket] = []
        threading.Thread(target=self._accept, name="link", daemon=True).start()

    def stall(self) -> None:
        """Lets nothing through from now on; a new connection is taken, and gets nothing either."""
        self._open.clear()

    def go_on(self) -> None:
        """Lets everything through again, also what was held."""
        self._open.set()

    def close(self) -> None:
        """Closes all connections."""
        self._ended = True
        self._open.set()
        for each in (self._listener, *self._sockets):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while not self._ended:
                page, _ = self._listener.accept()
                try:
                    server = socket.create_connection(self._server)
                except OSError:  # it is being started again
                    page.close()
                    continue
                self._sockets += [page, server]
                for source, target in ((page, server), (server, page)):
                    threading.Thread(target=self._forward, args=(source, target), daemon=True).start()

    def _forward(self, source: socket.socket, target: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                part = source.recv(CHUNK)
                self._open.wait()
                if not part:
                    break
                target.sendall(part)
            target.shutdown(socket.SHUT_WR)
