# SPDX-License-Identifier: Apache-2.0
"""The stream of changes of a fleet's keys, and its listeners."""

import threading
from typing import Any, Optional, Tuple

import grpc

from merlin_fleet.certified import HubError
from merlin_fleet.core.store import Change, Item, Snapshot
from merlin_fleet.etcd_messages import change_of, coding, message


class Listener:
    """Takes the changes of a hub. Called from the hub's thread."""

    def on_connected(self, snapshot: Snapshot) -> None:
        """All keys were read; the changes after it come."""

    def on_resumed(self) -> None:
        """The changes after the last one come again."""

    def on_changed(self, changes: Tuple[Change, ...]) -> None:
        """Keys changed, in one or more transactions; each is complete."""

    def on_disconnected(self, reason: str) -> None:
        """No changes come until further notice."""


class ChannelClosed(HubError):
    """A call that failed has closed the connection."""


class Watch:
    """Reads the stream of changes. For one thread."""

    def __init__(self, listener: Listener, root: bytes, end: bytes) -> None:
        self._listener = listener
        self._root, self._end = root, end
        self._cluster = 0
        self._revision = 0
        self._snapshot: Optional[Snapshot] = None
        self.last: Optional[Item] = None
        """The last delivered key; None: there is none, or the last change was a deletion."""
        self.connected = True  # so that the first failure is reported
        self.received = 0
        """How often something came."""

    def resumes(self, cluster: int, revision: int) -> bool:
        """Whether the next changes follow the delivered ones without a gap."""
        return bool(self._revision) and cluster == self._cluster and revision >= self._revision

    def latest(self, written: Optional[Item]) -> Optional[Item]:
        """The last change that this process knows of: the delivered one, or one that it has written.

        What it has written may be answered before it is delivered, and is known then.
        """
        return written if written is not None and written.modified > self._revision else self.last

    def restart(self, cluster: int, snapshot: Snapshot, another: bool) -> None:
        """Changes delivered before no longer count.

        :param another: whether it is known that the store is not the one that they came from.
        """
        undelivered = self._snapshot is not None and self._snapshot.another
        another = another or undelivered or self._cluster not in (0, cluster)
        self._cluster, self._revision = cluster, snapshot.revision
        self.last = max(snapshot.items, key=lambda item: item.modified, default=None)
        self._snapshot = snapshot._replace(another=another)

    def forget(self) -> None:
        """Everything is read again at the next start."""
        self._revision = 0

    def lost(self, reason: str) -> None:
        """The stream has ended."""
        if self.connected:
            self.connected = False
            self._listener.on_disconnected(reason)

    def run(self, channel: grpc.Channel, timeout: float) -> None:
        """Delivers the changes, until the stream ends.

        :raises grpc.RpcError: when it ends.
        :raises HubError: when etcd refuses it.
        """
        begin = self._revision
        if self._snapshot is None and self.last is not None:
            begin = self.last.modified  # it is known to be there; what followed may be another store's
        keys = {"key": self._root, "range_end": self._end, "start_revision": begin + 1}
        first = message("WatchRequest", create_request=message("WatchCreateRequest", **keys))
        ended = threading.Event()
        try:
            stream = channel.stream_stream(*coding("Watch/Watch", first))(_requests(first, ended))
        except ValueError:
            raise ChannelClosed("its connection was closed") from None
        # A stream has no time-out of its own; it has to begin in time.
        alarm = threading.Timer(timeout, stream.cancel)
        alarm.name, alarm.daemon = "fleet watch begins", True
        alarm.start()
        try:
            for response in stream:
                alarm.cancel()
                self._take(response)
        finally:
            alarm.cancel()
            ended.set()
            stream.cancel()
        raise HubError("etcd has ended the watch")

    def _take(self, response: Any) -> None:
        if response.compact_revision:
            self._revision = 0  # the changes in between are gone: everything is read again
            raise HubError(f"etcd has compacted its history up to {response.compact_revision}")
        if response.canceled:
            raise HubError(f"etcd refuses the watch: {response.cancel_reason}")
        self.received += 1
        if response.created:
            self._begin()
        changes = tuple(map(change_of, response.events))
        if changes:
            self._revision = changes[-1].modified
            key, value, modified = changes[-1]
            self.last = Item(key, value, modified) if value is not None else None
            self._listener.on_changed(changes)

    def _begin(self) -> None:
        self.connected = True
        if self._snapshot is not None:
            self._listener.on_connected(self._snapshot)
            self._snapshot = None  # a listener that raises gets the next one
        else:
            self._listener.on_resumed()


def _requests(first: Any, ended: threading.Event) -> Any:
    """The client's side of a stream: it stays open until the stream has ended."""
    yield first
    ended.wait()
