# SPDX-License-Identifier: Apache-2.0
"""The store of a fleet in etcd: transactions, leases, and the changes of all keys without a gap.

One channel carries calls and watch. A call that is not answered in time ends the channel, so a watch over a
dead connection ends with it; the next watch continues behind the last revision that was seen.
"""

import random
import re
import threading
import traceback
from typing import Any, List, Optional, Sequence, Tuple

import grpc

from merlin_fleet.certified import HubError, Tls, certificate_problem, time_of
from merlin_fleet.core.store import Item, Snapshot, Txn, TxnResult
from merlin_fleet.etcd_messages import HubCompacted, behind, coding, error_of, item_of, message, txn_message
from merlin_fleet.hub_watch import ChannelClosed, Listener, Watch

DEFAULT_ENDPOINT = "127.0.0.1:2379"
ENDPOINT = re.compile(r"([\w.-]+|\[[0-9A-Fa-f:.]+\]):\d{1,5}\Z", re.ASCII)  # without a scheme
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
PAGE = 500  # keys that are read at once
PAUSES = (0.2, 0.5, 1.0, 2.0)  # s between attempts to connect
LARGEST = 64 << 20  # bytes of one message
OPTIONS = (
    # A new channel is a new connection, without the back-off of the old one.
    ("grpc.use_local_subchannel_pool", 1),
    ("grpc.max_receive_message_length", LARGEST),
    ("grpc.enable_http_proxy", 0),
)


class EtcdHub:
    """The keys of one fleet in etcd. Thread-safe.

    :param root: with which the keys begin.
    :param end: the keys before it are read and followed; empty: all.
    :param endpoints: host:port of each member of the cluster.
    :param tls: None: without, and then only on this machine.
    :param timeout: s for a call.
    :raises HubError: for what is not an endpoint, one on another machine without certificates, and files
        that cannot be read.
    """

    def __init__(
        self,
        root: str,
        endpoints: Sequence[str] = (DEFAULT_ENDPOINT,),
        tls: Optional[Tls] = None,
        timeout: float = 2.0,
        end: str = "",
    ) -> None:
        for each in endpoints:
            if not ENDPOINT.match(each) or not 0 < int(each.rpartition(":")[2]) < 65536:
                raise HubError(f"'{each}' is not the address of a hub; write hub.lab:2379")
        foreign = [each for each in endpoints if each.rpartition(":")[0] not in LOOPBACK]
        if tls is None and foreign:
            raise HubError(f"without certificates only an etcd on this machine is used, not {foreign[0]}")
        if not endpoints:
            raise HubError("no etcd is named")
        self._root = root.encode()
        self._end = end.encode() or behind(self._root)
        self._endpoints = list(endpoints)
        self._tls = tls
        if tls is not None:
            tls.credentials()  # a mistake is reported at the start
        self._timeout = timeout
        self._lock = threading.Lock()  # guards what follows
        self._channel: Optional[grpc.Channel] = None
        self._turn = 0
        self._dropped = ""
        self._written: Optional[Item] = None  # the last answered put of what it follows
        self._closed = threading.Event()
        self._thread: Optional[threading.Thread] = None

    # --- calls

    def transact(self, txn: Txn) -> TxnResult:
        """A transaction.

        :raises LeaseUnknown: for a put with a lease that has ended; then nothing was done.
        :raises HubError: when there was no answer in time, or etcd refuses.
        """
        answer = self._call("KV/Txn", txn_message(txn))
        items: List[Item] = []
        if not answer.succeeded:
            for response in answer.responses:
                items += map(item_of, response.response_range.kvs)
        revision = answer.header.revision
        followed = [put for put in txn.puts if self._root <= put.key.encode() < self._end]
        if answer.succeeded and followed:
            with self._lock:
                self._written = Item(followed[-1].key, followed[-1].value, revision)
        return TxnResult(answer.succeeded, revision, tuple(items))

    def grant(self, ttl: float) -> Tuple[int, float]:
        """A new lease, and its time in s.

        :raises HubError: when there was no answer in time, or etcd refuses.
        """
        answer = self._call("Lease/LeaseGrant", message("LeaseGrantRequest", TTL=int(ttl)))
        return answer.ID, float(answer.TTL)

    def renew(self, lease: int) -> float:
        """Renews a lease.

        :return: its time, s; 0: etcd no longer knows it.
        :raises HubError: when there was no answer in time, or etcd refuses.
        """
        # etcd has a stream for this; one request and its answer are the same on the wire, and need no thread.
        answer = self._call("Lease/LeaseKeepAlive", message("LeaseKeepAliveRequest", ID=lease))
        return float(max(answer.TTL, 0))

    def revoke(self, lease: int) -> None:
        """Ends a lease and its keys now.

        :raises HubError: when there was no answer in time, or etcd refuses.
        """
        self._call("Lease/LeaseRevoke", message("LeaseRevokeRequest", ID=lease))

    def check(self) -> None:
        """Asks whether etcd answers. When it does not answer in time, the changes end, too.

        A watch alone waits forever for a machine that is switched off, or behind a link that is cut.

        :raises HubError: when there was no answer in time, or etcd refuses.
        """
        self._where()

    def time(self) -> float:
        """The time of the hub's clock, s since 1970, right to 1 s.

        :raises HubError: when there was no answer with a time.
        """
        with self._lock:
            endpoint = self._endpoints[self._turn % len(self._endpoints)]
        return time_of(endpoint, self._tls, self._timeout)

    def ask(self, method: str, request: Any) -> Any:
        """Any call of etcd's, as an administrator needs it.

        :param method: service and method: "KV/Range".
        :raises HubError: when there was no answer in time, or etcd refuses.
        """
        try:
            return self._call(method, request)
        except HubError as error:
            raise type(error)(self._reason(error)) from None

    def read(self) -> Snapshot:
        """All keys at one revision.

        :raises HubError: when there was no answer in time, or etcd refuses.
        """
        return self._read()[1]

    def _read(self) -> Tuple[int, Snapshot]:
        """Reads all keys; returns the id of the cluster and the keys."""
        begin, revision, cluster, items = self._root, 0, 0, []  # type: bytes, int, int, List[Item]
        while True:
            request = message("RangeRequest", key=begin, range_end=self._end, limit=PAGE, revision=revision)
            answer = self._call("KV/Range", request)
            revision, cluster = revision or answer.header.revision, answer.header.cluster_id
            items += map(item_of, answer.kvs)
            if not answer.more:
                return cluster, Snapshot(revision, tuple(items))
            begin = answer.kvs[-1].key + b"\0"

    def _call(self, method: str, request: Any) -> Any:
        channel = self._open()
        try:
            return channel.unary_unary(*coding(method, request))(request, timeout=self._timeout)
        except grpc.RpcError as error:
            failure = error_of(error)
            if error.code() in (grpc.StatusCode.DEADLINE_EXCEEDED, grpc.StatusCode.UNAVAILABLE):
                self._drop(channel, str(failure))
            raise failure from None
        except ValueError as error:  # the channel was closed meanwhile
            raise HubError(f"the connection to etcd has ended ({error})") from None

    def _open(self) -> grpc.Channel:
        with self._lock:
            if self._closed.is_set():
                raise HubError("the hub is closed")
            if self._channel is None:
                self._dropped = ""
                endpoint = self._endpoints[self._turn % len(self._endpoints)]
                if self._tls is None:
                    self._channel = grpc.insecure_channel(endpoint, OPTIONS)
                else:  # read anew: they are renewed while this runs
                    self._channel = grpc.secure_channel(endpoint, self._tls.credentials(), OPTIONS)
            return self._channel

    def _drop(self, channel: grpc.Channel, reason: str) -> None:
        """The next call goes to the next member of the cluster; the changes end for this reason."""
        with self._lock:
            if channel is self._channel:
                self._channel = None
                self._dropped = reason
                self._turn += 1
        channel.close()

    # --- changes

    def follow(self, listener: Listener) -> None:
        """Begins to report changes, from now until `close`."""
        assert self._thread is None
        self._thread = threading.Thread(
            target=self._follow, args=(listener,), name="fleet watch", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Closes the connection and ends the threads."""
        self._closed.set()
        with self._lock:
            channel, self._channel = self._channel, None
        if channel is not None:
            channel.close()
        if self._thread is not None:
            self._thread.join(4 * self._timeout)

    def _follow(self, listener: Listener) -> None:
        watch = Watch(listener, self._root, self._end)
        failures = 0
        while not self._closed.is_set():
            received = watch.received
            try:
                cluster, known = self._where()
                with self._lock:
                    written = self._written
                has = self._has(watch.latest(written), known) if watch.resumes(cluster, known) else None
                if not has:
                    watch.restart(*self._read(), another=has is False)
                    with self._lock:  # of a store that is gone; what was written meanwhile stays
                        self._written = None if self._written is written else self._written
                watch.run(self._open(), self._timeout)
            except (grpc.RpcError, ChannelClosed) as error:
                reason = str(error_of(error)) if isinstance(error, grpc.RpcError) else str(error)
                with self._lock:  # a call that failed has ended it, and says more
                    reason = self._dropped or reason
            except HubError as error:
                reason = self._reason(error) if watch.connected else str(error)
            except Exception as error:  # a listener's mistake: without this thread it would hear nothing more
                traceback.print_exc()
                watch.forget()
                reason = f"the changes of the hub were not taken: {error!r}"
            failures = 0 if watch.received > received else failures + 1
            if not self._closed.is_set():
                watch.lost(reason)
                pause = PAUSES[min(failures, len(PAUSES) - 1)]
                self._closed.wait(pause * random.uniform(0.7, 1.3))  # not all robots at once

    def _has(self, last: Optional[Item], known: int) -> Optional[bool]:
        """Whether etcd has the last change that this process knows of; None: that cannot be seen.

        One that was put back from a backup has the same id when its token is the same, and its revision may
        have passed that of the change since then.

        :param known: etcd's revision.
        """
        if last is None:
            return None  # nothing is left of a deletion
        if last.modified > known:
            return False
        try:
            request = message("RangeRequest", key=last.key.encode(), revision=last.modified)
            found = list(map(item_of, self._call("KV/Range", request).kvs))
        except HubCompacted:
            return None
        return found == [last]

    def _reason(self, error: HubError) -> str:
        """Why a call has failed; where certificates are used, grpc does not say whether it is for them."""
        if self._tls is None or "cannot be reached" not in str(error):
            return str(error)
        endpoint = self._endpoints[(self._turn - 1) % len(self._endpoints)]
        return certificate_problem(endpoint, self._tls, self._timeout) or str(error)

    def _where(self) -> Tuple[int, int]:
        """The cluster's id and its revision."""
        header = self._call("KV/Range", message("RangeRequest", key=self._root, count_only=True)).header
        return header.cluster_id, header.revision
