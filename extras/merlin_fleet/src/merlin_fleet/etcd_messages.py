# SPDX-License-Identifier: Apache-2.0
"""What etcd's messages say, and how it is asked: the protocol's words and those of gRPC."""

from typing import Any, Union

import etcd3.etcdrpc as rpc
import grpc

from merlin_fleet.certified import HubError
from merlin_fleet.core.store import Change, Compare, Item, Txn, Unwritten


class LeaseUnknown(HubError):
    """etcd does not know the lease, or no longer knows it."""


class HubRefuses(HubError):
    """etcd does not allow it to this certificate. Nothing was done."""


class HubFull(HubError):
    """etcd takes no changes: its quota is reached. This one may have been the last that it took."""


class HubFails(HubError):
    """etcd is there, and does not do it. Nothing was done."""


class HubCompacted(HubFails):
    """etcd no longer has what was at that revision."""


def behind(prefix: bytes) -> bytes:
    """The end of the range of all keys that begin so."""
    return prefix[:-1] + bytes([prefix[-1] + 1])


def compare_message(compare: Union[Compare, Unwritten]) -> Any:
    """A comparison of a transaction."""
    if isinstance(compare, Unwritten):
        prefix = compare.prefix.encode()
        return rpc.Compare(
            result=rpc.Compare.LESS,
            target=rpc.Compare.MOD,
            key=prefix,
            range_end=behind(prefix),
            mod_revision=compare.since + 1,
        )
    return rpc.Compare(
        result=rpc.Compare.EQUAL,
        target=rpc.Compare.MOD,
        key=compare.key.encode(),
        mod_revision=compare.modified,
    )


def txn_message(txn: Txn) -> Any:
    """The message of etcd for a transaction."""
    done = [
        rpc.RequestOp(
            request_put=rpc.PutRequest(key=put.key.encode(), value=put.value.encode(), lease=put.lease)
        )
        for put in txn.puts
    ]
    done += [
        rpc.RequestOp(request_delete_range=rpc.DeleteRangeRequest(key=key.encode())) for key in txn.deletes
    ]
    reads = [rpc.RequestOp(request_range=rpc.RangeRequest(key=key.encode())) for key in txn.reads]
    return rpc.TxnRequest(compare=list(map(compare_message, txn.compare)), success=done, failure=reads)


def item_of(pair: Any) -> Item:
    """A key with its value, as etcd sends it."""
    return Item(pair.key.decode(errors="replace"), pair.value.decode(errors="replace"), pair.mod_revision)


def change_of(event: Any) -> Change:
    """A change, as etcd sends it."""
    pair = event.kv
    value = None if event.type == event.DELETE else pair.value.decode(errors="replace")
    return Change(pair.key.decode(errors="replace"), value, pair.mod_revision)


def error_of(error: grpc.RpcError) -> HubError:
    """Why a call has failed, in words."""
    code, details = error.code(), error.details() or ""
    if code is grpc.StatusCode.NOT_FOUND and "lease" in details:
        return LeaseUnknown(details)
    if code is grpc.StatusCode.DEADLINE_EXCEEDED:
        return HubError("etcd does not answer in time")
    if code is grpc.StatusCode.UNAVAILABLE:
        return HubError(f"etcd cannot be reached ({details})")
    if code is grpc.StatusCode.PERMISSION_DENIED:
        return HubRefuses(f"the hub does not allow it to this certificate ({details})")
    if code is grpc.StatusCode.RESOURCE_EXHAUSTED and "space exceeded" in details:
        return HubFull(
            "the hub is full and takes no changes: its database has reached its quota; there, "
            "`etcdctl compact`, `etcdctl defrag` and `etcdctl alarm disarm` are needed (docs/fleet.md)"
        )
    if code is grpc.StatusCode.CANCELLED:  # another call on it was not answered in time
        return HubError("the connection to etcd was closed")
    if code is grpc.StatusCode.OUT_OF_RANGE and "compacted" in details:
        return HubCompacted(f"etcd refuses: {details}")
    return HubFails(f"etcd refuses: {details or code.name}")
