# SPDX-License-Identifier: Apache-2.0
"""What the protocol asks of a store: keys with revisions, leases, and transactions that compare and set.

etcd has all of it (`merlin_fleet.hub`).
"""

from typing import NamedTuple, Optional, Tuple, Union


class Item(NamedTuple):
    """A key and what the store knows of it."""

    key: str
    value: str
    modified: int
    """The revision of the transaction that wrote it last."""


class Change(NamedTuple):
    """A key was written, or deleted (by a transaction or by the end of its lease)."""

    key: str
    value: Optional[str]
    """None: it was deleted."""
    modified: int
    """The revision of the change."""


class Compare(NamedTuple):
    """Holds when the key was last written at this revision; 0: when it does not exist."""

    key: str
    modified: int


class Unwritten(NamedTuple):
    """Holds when no key that begins so, and exists, was written after this revision."""

    prefix: str
    since: int


class Put(NamedTuple):
    """Writes a value under a key."""

    key: str
    value: str
    lease: int = 0
    """The lease with which the key ends; 0: it stays."""


class Txn(NamedTuple):
    """When all comparisons hold, all is written and deleted at one revision; otherwise keys are read."""

    compare: Tuple[Union[Compare, Unwritten], ...] = ()
    puts: Tuple[Put, ...] = ()
    deletes: Tuple[str, ...] = ()
    reads: Tuple[str, ...] = ()


class TxnResult(NamedTuple):
    """The store's answer to a transaction."""

    done: bool
    """Whether all comparisons held."""
    revision: int
    items: Tuple[Item, ...] = ()
    """What was read, where the comparisons did not hold."""


class Snapshot(NamedTuple):
    """All keys of a fleet at one revision."""

    revision: int
    items: Tuple[Item, ...]
    another: bool = False
    """Whether it is another store than the one that was followed before."""
