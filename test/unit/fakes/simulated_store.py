# SPDX-License-Identifier: Apache-2.0
"""A store in memory with the semantics of etcd: revisions, leases, transactions, changes in order."""

from typing import Dict, List, Tuple, Union

from merlin_fleet.core.store import Change, Compare, Item, Snapshot, Txn, TxnResult, Unwritten


class SimulatedLeaseUnknown(Exception):
    """The store does not know the lease, or no longer knows it."""


class SimulatedStore:
    """The store. Its time passes only by a call."""

    def __init__(self) -> None:
        self.revision = 1
        self.changes: List[Change] = []
        self._items: Dict[str, Tuple[Item, int]] = {}
        self._leases: Dict[int, List[float]] = {}
        self._last_lease = 0

    def grant(self, ttl: float) -> int:
        """Makes a lease of that many seconds; returns its id."""
        self._last_lease += 1
        self._leases[self._last_lease] = [ttl, ttl]
        return self._last_lease

    def renew(self, lease: int) -> float:
        """Renews a lease.

        :return: its time, s; 0: it is not known.
        """
        times = self._leases.get(lease)
        if times is None:
            return 0.0
        times[1] = times[0]
        return times[0]

    def revoke(self, lease: int) -> None:
        """Ends a lease and its keys."""
        if self._leases.pop(lease, None) is not None:
            ended = [key for key, (_, held) in self._items.items() if held == lease]
            if ended:
                self.revision += 1
                self._delete(ended)

    def pass_time(self, seconds: float) -> None:
        """Time passes; leases end."""
        for lease, times in list(self._leases.items()):
            times[1] -= seconds
            if times[1] <= 0:
                self.revoke(lease)

    def transact(self, txn: Txn) -> TxnResult:
        """A transaction.

        :raises SimulatedLeaseUnknown: for a put with a lease that is not known; then nothing is done.
        """
        if not all(map(self._holds, txn.compare)):
            found = tuple(self._items[key][0] for key in txn.reads if key in self._items)
            return TxnResult(False, self.revision, found)
        if any(put.lease and put.lease not in self._leases for put in txn.puts):
            raise SimulatedLeaseUnknown("requested lease not found")
        deleted = [key for key in txn.deletes if key in self._items]
        if txn.puts or deleted:
            self.revision += 1
        for put in txn.puts:
            self._items[put.key] = (Item(put.key, put.value, self.revision), put.lease)
            self.changes.append(Change(put.key, put.value, self.revision))
        self._delete(deleted)
        return TxnResult(True, self.revision)

    def snapshot(self) -> Snapshot:
        """All keys at the present revision."""
        return Snapshot(self.revision, tuple(item for item, _ in self._items.values()))

    def value(self, key: str) -> str:
        """A value; empty: the key does not exist."""
        return self._items[key][0].value if key in self._items else ""

    def _holds(self, compare: Union[Compare, Unwritten]) -> bool:
        if isinstance(compare, Unwritten):
            return all(
                item.modified <= compare.since
                for item, _ in self._items.values()
                if item.key.startswith(compare.prefix)
            )
        known = self._items.get(compare.key)
        return (known[0].modified if known else 0) == compare.modified

    def _delete(self, keys: List[str]) -> None:
        for key in keys:
            del self._items[key]
            self.changes.append(Change(key, None, self.revision))
