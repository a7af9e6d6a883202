# SPDX-License-Identifier: Apache-2.0
"""Takes the connections of a listening socket, and hands on those that have said what they want. Without ROS.

A connection that says nothing, as of a port scan or of a computer that lost its power, holds a descriptor
for some seconds, and neither a thread nor those who come after it.
"""

import contextlib
import logging
import select
import socket
import threading
import time
from typing import Any, Callable, Dict, NamedTuple, Optional

from merlin_ros.alarms import TickClock

#: Connections that the kernel keeps until they are taken.
BACKLOG = 256
#: Connections that may be silent at once; one more, and the oldest is closed.
MOST_SILENT = 128
#: s of wall time for the first words of a connection.
STALLED = 10.0
#: Bytes of the first words that are waited for.
LONGEST = 64 * 1024
#: s of wall time between two looks at the silent connections, while there are some.
LOOK = 1.0
#: s of wall time between two attempts to take a connection while descriptors are short.
PAUSE = 0.1
#: s of wall time for which a shortage is reported once.
QUIET = 60.0

_ENDED = select.EPOLLRDHUP | select.EPOLLHUP | select.EPOLLERR

_log = logging.getLogger("rosout")


class Greeting(threading.Thread):
    """Serves a connection; where it cannot be started, the connection is closed and nothing else is lost."""


class _Silent(NamedTuple):
    connection: socket.socket
    address: Any
    until: float  # by the clock of the entrance, s


class Entrance:
    """The connections of one listening socket.

    :param listening: bound; is closed by the entrance.
    :param name: of what listens, for texts and threads.
    :param length: gets the first bytes of a connection, and says how many are waited for in all. None: it
        cannot say yet. More than :data:`LONGEST`: the connection is closed.
    :param greet: gets a connection of which these bytes are there, unread, and its address. In a thread of
        its own.
    """

    def __init__(
        self,
        listening: socket.socket,
        name: str,
        length: Callable[[bytes], Optional[int]],
        greet: Callable[[socket.socket, Any], None],
    ) -> None:
        # Its own descriptor: epoll forgets one that another thread closes, and would wait for ever.
        self._given, self._listening = listening, listening.dup()
        self._number = self._listening.fileno()
        self._name, self._length, self._greet = name, length, greet
        self._closed = False
        # All below is for the thread that runs.
        self._events = select.epoll()
        self._clock = TickClock(longest=2 * LOOK)
        self._silent: Dict[int, _Silent] = {}  # by descriptor, the oldest first
        self._quiet_until = 0.0  # monotonic time, s
        listening.setblocking(False)
        listening.listen(BACKLOG)

    def close(self) -> None:
        """Takes no more connections; may be called again."""
        self._closed = True
        with contextlib.suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)  # wakes the thread that runs

    def run(self) -> None:
        """Takes connections until the entrance is closed."""
        self._events.register(self._number, select.EPOLLIN)
        try:
            while not self._closed:
                ready = self._events.poll(LOOK if self._silent else None)
                self._clock.look()
                # New connections last: for them, one may be closed whose first words have just come.
                for number, event in sorted(ready, key=lambda change: change[0] == self._number):
                    try:
                        if number == self._number:
                            self._take()
                        elif number in self._silent:
                            self._hear(number, bool(event & _ENDED))
                    except Exception as error:  # what one connection brings is its own end alone
                        self._report(error)
                        if number in self._silent:
                            self._unwatch(number).connection.close()
                while self._silent and next(iter(self._silent.values())).until <= self._clock.now:
                    self._close_oldest()
        finally:
            while self._silent:
                self._close_oldest()
            self._events.close()
            self._listening.close()
            self._given.close()

    def _close_oldest(self) -> None:
        self._unwatch(next(iter(self._silent))).connection.close()

    def _unwatch(self, number: int) -> _Silent:
        with contextlib.suppress(OSError):
            self._events.unregister(number)  # a child of this process may have the connection for a moment
        return self._silent.pop(number)

    def _take(self) -> None:
        try:
            connection, address = self._listening.accept()
        except (BlockingIOError, ConnectionAbortedError):
            return  # it has gone
        except OSError as error:
            if not self._closed:
                self._report(error)
                if self._silent:
                    self._close_oldest()
                else:
                    time.sleep(PAUSE)  # nothing tells when there is a descriptor again
            return
        if len(self._silent) >= MOST_SILENT:
            self._close_oldest()
        connection.settimeout(None)  # rospy sets one for all sockets
        # Each change is reported once: else half of the first words would be reported again and again.
        self._events.register(connection, select.EPOLLIN | select.EPOLLRDHUP | select.EPOLLET)
        self._silent[connection.fileno()] = _Silent(connection, address, self._clock.now + STALLED)

    def _report(self, error: Exception) -> None:
        now = time.monotonic()
        if now >= self._quiet_until:
            self._quiet_until = now + QUIET
            _log.warning("%s: a connection cannot be taken: %s; tried again", self._name, error)

    def _hear(self, number: int, ended: bool) -> None:
        silent = self._silent[number]
        try:
            said = silent.connection.recv(LONGEST, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError:
            said, ended = b"", True
        length = self._length(said)
        if length is not None and len(said) >= length:
            self._hand_on(self._unwatch(number))
        elif ended or len(said) >= LONGEST or (length is not None and length > LONGEST):
            self._unwatch(number).connection.close()

    def _hand_on(self, silent: _Silent) -> None:
        try:
            name = f"{self._name} connection"
            Greeting(target=self._greet, args=silent[:2], name=name, daemon=True).start()
        except RuntimeError as error:  # no thread
            silent.connection.close()
            self._report(error)
