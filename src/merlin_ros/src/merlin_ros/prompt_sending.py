# SPDX-License-Identifier: Apache-2.0
"""Sends what is published from the publishing thread, as far as the connection takes it at once.

rospy hands each message to a thread of its own for each connection: two changes of thread, and in Python a
wait for the interpreter, before the first byte leaves. Here a thread exists only while a subscriber is slow.
Rospy leaves Nagle's algorithm to the subscriber, and most do not ask for it to be off: a small message then
waits up to 40 ms for the acknowledgement of the one before. For a clock that is two ticks.

A node of rospy that ends leaves the master's list before it closes its topics. A subscriber of roscpp then
drops the connection with what it has not read. Here the connections end first: the subscriber reads to the
end, and closes.
"""

import contextlib
import select
import socket
import threading
import time
from typing import Any, Iterable, Iterator, List

import rospy
from rospy.exceptions import TransportInitError, TransportTerminated
from rospy.impl.tcpros_pubsub import QueuedConnection

from merlin_ros.work.threads import start_thread

#: Longest time for which a node that ends waits until its subscribers have read everything, s of wall time.
READ_LIMIT = 0.5


def send_promptly() -> None:
    """Lets rospy connect its publishers like this; for the whole process, before `rospy.init_node`."""
    rospy.topics.QueuedConnection = PromptConnection
    rospy.topics.Poller = PlainPoller
    rospy.core.add_preshutdown_hook(_finish_topics)  # the first: rospy's own takes the node off the list


def _finish_topics(_: str) -> None:
    PromptConnection.ends = True  # a subscriber of roscpp connects again while the others still read
    topics = rospy.topics.get_topic_manager()
    with topics.lock:
        publishers = list(topics.pubs.values())
    finish([each for topic in publishers for each in topic.connections or ()], READ_LIMIT)


def finish(connections: Iterable[Any], limit: float) -> None:
    """Ends connections and waits until their subscribers have read everything and have closed them.

    :param connections: also those of publishers without a queue, which rospy sends over itself.
    :param limit: of the wait, s of wall time.
    """
    waits, open_ = select.poll(), set()
    for connection in connections:
        if isinstance(connection, PromptConnection):
            connection.finish()
        else:
            _end(connection)
        with contextlib.suppress(OSError, AttributeError, TypeError, ValueError):  # it is closed
            number = connection.fileno()
            waits.register(number, select.POLLRDHUP)
            open_.add(number)
    end = time.monotonic() + limit
    while open_ and (left := end - time.monotonic()) > 0:
        for number, _ in waits.poll(left * 1000):
            waits.unregister(number)
            open_.remove(number)


def _end(transport: Any) -> None:
    """Lets the subscriber read the end of a connection of rospy behind what was sent."""
    with contextlib.suppress(OSError, AttributeError):  # it is closed
        transport.socket.shutdown(socket.SHUT_WR)


class PlainPoller:
    """Finds the broken connections of a topic, as rospy's own does, but without a descriptor.

    Rospy's has one for each topic, and closes that of a topic that was left only when the garbage collector
    finds it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the set, which only one thread may ask at a time
        self._set = select.poll()

    def add_fd(self, fd: int) -> None:
        """Watches a connection."""
        with self._lock:
            self._set.register(fd, select.POLLHUP | select.POLLERR | select.POLLRDHUP)

    def remove_fd(self, fd: int) -> None:
        """Watches it no more.

        :raises KeyError: when it was not watched.
        """
        with self._lock:
            self._set.unregister(fd)

    def error_iter(self) -> Iterator[int]:
        """The connections that are broken."""
        with self._lock:
            found = self._set.poll(0)
            for fd, event in found:
                if event & select.POLLNVAL:  # closed without a word
                    self._set.unregister(fd)
        return (fd for fd, event in found if not event & select.POLLNVAL)


class PromptConnection(QueuedConnection):
    """The connection of a publisher to a subscriber; publishing never waits for it.

    What the kernel does not take at once waits in the queue, as in rospy: when that is full, the oldest
    message is dropped. A message of which a part was sent is always completed, also by a node that ends.

    :param connection: rospy's transport.
    :param queue_size: messages that may wait; zero: any number.
    """

    ends = False  # the node ends: a new connection takes nothing

    def __init__(self, connection: Any, queue_size: int) -> None:
        # Not rospy's own, which starts a thread.
        self._connection = connection
        self._queue_size = queue_size
        self._lock = threading.Lock()  # guards the fields below
        self._queue: List[bytes] = []
        self._rest = b""  # of the message that was sent in part
        self._working = False  # a thread sends what waits
        self._error: Any = None
        self._finished = False  # nothing more is taken
        if self.ends:
            self.finish()
        with contextlib.suppress(OSError, AttributeError):  # one that is closing no longer has options
            connection.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def set_cleanup_callback(self, callback: Any) -> None:
        """Called by rospy: the callback takes what it gets from the list of the topic's connections."""
        self._connection.set_cleanup_callback(lambda _: callback(self))

    def fileno(self) -> Any:
        """Its descriptor; None once it is closed: rospy would also remove one of the same number."""
        return None if self._connection.done else self._connection.fileno()

    def write_data(self, data: bytes) -> bool:
        """Sends a message, or queues it; after :meth:`finish` drops it.

        :raises TransportTerminated: the connection is broken; its publisher closes it.
        """
        with self._lock:
            if self._error is not None:
                error, self._error = self._error, None
                raise error
            if self._finished:
                return True
            if not self._working:
                self._rest = data[self._send(data) :]
                if not self._rest:
                    return True
                self._working = True
                start_thread(f"sending to {self._connection.endpoint_id}", self._work)
                return True
            if self._queue_size > 0 and len(self._queue) == self._queue_size:
                del self._queue[0]
            self._queue.append(data)
        return True

    def finish(self) -> None:
        """Lets the subscriber read the connection's end after what was published; nothing more is sent."""
        with self._lock:
            self._finished = True
            if not self._working:
                _end(self._connection)

    def _send(self, data: bytes) -> int:
        """Sends without waiting; returns how many bytes the kernel has taken."""
        connection = self._connection
        peer = connection.socket
        if connection.done:
            raise TransportTerminated("connection closed")
        if peer is None:
            raise TransportInitError("the connection is not open")
        try:
            sent = int(peer.send(data, socket.MSG_DONTWAIT))
        except BlockingIOError:
            return 0
        except OSError as error:
            raise TransportTerminated(str(error)) from error
        if sent == len(data):
            connection.stat_bytes += sent
            connection.stat_num_msg += 1
        return sent

    def _work(self) -> None:
        """Sends what waits, until nothing does."""
        while True:
            with self._lock:
                if self._connection.done or not (self._rest or self._queue):
                    self._working = False
                    if self._finished:
                        _end(self._connection)
                    return
                data, self._rest = self._rest or self._queue.pop(0), b""
            try:
                self._connection.write_data(data)
            except Exception as error:  # whatever it is, the next message finds it out, as in rospy
                with self._lock:
                    self._error, self._working = error, False
                    return
