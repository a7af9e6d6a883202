# SPDX-License-Identifier: Apache-2.0
"""What etcd's messages say, and how it is asked: the protocol's words and those of gRPC.

The messages are described here, with the names and numbers of etcd's protocol, as far as the fleet uses them;
fields that are not described are passed over. So no code is generated, which would have to fit the installed
protobuf.
"""

from typing import Any, Callable, Dict, List, Tuple, Union

import grpc
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from merlin_fleet.certified import HubError
from merlin_fleet.core.store import Change, Compare, Item, Txn, Unwritten

FIELD = descriptor_pb2.FieldDescriptorProto
INT64, UINT64, BOOL = FIELD.TYPE_INT64, FIELD.TYPE_UINT64, FIELD.TYPE_BOOL
STRING, BYTES = FIELD.TYPE_STRING, FIELD.TYPE_BYTES
ENUM = FIELD.TYPE_INT32  # the same on the wire
#: Message → its fields: number, and type or the name of a message; in a list: repeated.
MESSAGES: Dict[str, Dict[str, Tuple[int, Any]]] = {
    "Empty": {},  # an answer of which nothing is read
    "ResponseHeader": {"cluster_id": (1, UINT64), "member_id": (2, UINT64), "revision": (3, INT64)},
    "KeyValue": {"key": (1, BYTES), "mod_revision": (3, INT64), "value": (5, BYTES), "lease": (6, INT64)},
    "Event": {"type": (1, ENUM), "kv": (2, "KeyValue")},
    "RangeRequest": {
        "key": (1, BYTES),
        "range_end": (2, BYTES),
        "limit": (3, INT64),
        "revision": (4, INT64),
        "count_only": (9, BOOL),
    },
    "RangeResponse": {"header": (1, "ResponseHeader"), "kvs": (2, ["KeyValue"]), "more": (3, BOOL)},
    "PutRequest": {"key": (1, BYTES), "value": (2, BYTES), "lease": (3, INT64)},
    "DeleteRangeRequest": {"key": (1, BYTES), "range_end": (2, BYTES)},
    "Compare": {
        "result": (1, ENUM),
        "target": (2, ENUM),
        "key": (3, BYTES),
        "mod_revision": (6, INT64),
        "range_end": (64, BYTES),
    },
    "RequestOp": {
        "request_range": (1, "RangeRequest"),
        "request_put": (2, "PutRequest"),
        "request_delete_range": (3, "DeleteRangeRequest"),
    },
    "ResponseOp": {"response_range": (1, "RangeResponse")},
    "TxnRequest": {"compare": (1, ["Compare"]), "success": (2, ["RequestOp"]), "failure": (3, ["RequestOp"])},
    "TxnResponse": {
        "header": (1, "ResponseHeader"),
        "succeeded": (2, BOOL),
        "responses": (3, ["ResponseOp"]),
    },
    "CompactionRequest": {"revision": (1, INT64), "physical": (2, BOOL)},
    "LeaseGrantRequest": {"TTL": (1, INT64), "ID": (2, INT64)},
    "LeaseGrantResponse": {"ID": (2, INT64), "TTL": (3, INT64)},
    "LeaseRevokeRequest": {"ID": (1, INT64)},
    "LeaseKeepAliveRequest": {"ID": (1, INT64)},
    "LeaseKeepAliveResponse": {"ID": (2, INT64), "TTL": (3, INT64)},
    "WatchCreateRequest": {"key": (1, BYTES), "range_end": (2, BYTES), "start_revision": (3, INT64)},
    "WatchRequest": {"create_request": (1, "WatchCreateRequest")},
    "WatchResponse": {
        "created": (3, BOOL),
        "canceled": (4, BOOL),
        "compact_revision": (5, INT64),
        "cancel_reason": (6, STRING),
        "events": (11, ["Event"]),
    },
    "Permission": {"permType": (1, ENUM), "key": (2, BYTES), "range_end": (3, BYTES)},
    "AuthEnableRequest": {},
    "AuthUserAddRequest": {"name": (1, STRING), "password": (2, STRING)},
    "AuthUserDeleteRequest": {"name": (1, STRING)},
    "AuthUserGetRequest": {"name": (1, STRING)},
    "AuthUserGetResponse": {"roles": (2, [STRING])},
    "AuthUserGrantRoleRequest": {"user": (1, STRING), "role": (2, STRING)},
    "AuthRoleAddRequest": {"name": (1, STRING)},
    "AuthRoleGetRequest": {"role": (1, STRING)},
    "AuthRoleGetResponse": {"perm": (2, ["Permission"])},
    "AuthRoleGrantPermissionRequest": {"name": (1, STRING), "perm": (2, "Permission")},
    "AlarmMember": {"memberID": (1, UINT64), "alarm": (2, ENUM)},
    "AlarmRequest": {"action": (1, ENUM), "memberID": (2, UINT64), "alarm": (3, ENUM)},
    "AlarmResponse": {"alarms": (2, ["AlarmMember"])},
    "DefragmentRequest": {},
}
EQUAL, LESS = 0, 2  # results of a comparison
BY_REVISION = 2  # the target of a comparison: the revision of a key's last change
DELETED = 1  # type of an event
READ, READ_WRITE = 0, 2  # types of a permission
DEACTIVATE = 2  # action with an alarm


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


def _classes() -> Dict[str, Any]:
    """The class of each message, over whatever protobuf is installed."""
    file = descriptor_pb2.FileDescriptorProto(name="merlin_fleet_etcd.proto", package="merlin_fleet")
    for name, fields in MESSAGES.items():
        described = file.message_type.add(name=name)
        for field, (number, kind) in fields.items():
            one = described.field.add(name=field, number=number, label=FIELD.LABEL_OPTIONAL)
            if isinstance(kind, list):
                one.label, kind = FIELD.LABEL_REPEATED, kind[0]
            if isinstance(kind, str):
                one.type, one.type_name = FIELD.TYPE_MESSAGE, f".merlin_fleet.{kind}"
            else:
                one.type = kind
    pool = descriptor_pool.DescriptorPool()  # its own: names of others do not count
    pool.AddSerializedFile(file.SerializeToString())
    class_of = getattr(message_factory, "GetMessageClass", None)  # protobuf 4.22 and newer
    class_of = class_of or message_factory.MessageFactory(pool).GetPrototype
    return {name: class_of(pool.FindMessageTypeByName(f"merlin_fleet.{name}")) for name in MESSAGES}


_CLASSES = _classes()


def message(name: str, /, **fields: Any) -> Any:
    """A message of etcd.

    :raises KeyError: for one that is not described here.
    :raises ValueError: for a field that is not described here.
    """
    return _CLASSES[name](**fields)


def coding(method: str, request: Any) -> Tuple[str, Callable[[Any], bytes], Callable[[bytes], Any]]:
    """A method as a channel needs it: its path, what encodes the request, and what decodes the answer.

    :param method: service and method: "KV/Range".
    """
    answer = request.DESCRIPTOR.name.replace("Request", "Response")
    decoded = _CLASSES.get(answer, _CLASSES["Empty"])
    return f"/etcdserverpb.{method}", type(request).SerializeToString, decoded.FromString


def behind(prefix: bytes) -> bytes:
    """The end of the range of all keys that begin so."""
    return prefix[:-1] + bytes([prefix[-1] + 1])


def compare_message(compare: Union[Compare, Unwritten]) -> Any:
    """A comparison of a transaction."""
    if isinstance(compare, Compare):
        key, fields = compare.key.encode(), {"result": EQUAL, "mod_revision": compare.modified}
    else:
        key, fields = compare.prefix.encode(), {"result": LESS, "mod_revision": compare.since + 1}
    end = behind(key) if isinstance(compare, Unwritten) else b""
    return message("Compare", target=BY_REVISION, key=key, range_end=end, **fields)


def txn_message(txn: Txn) -> Any:
    """The message of etcd for a transaction."""
    done: List[Any] = []
    for put in txn.puts:
        pair = message("PutRequest", key=put.key.encode(), value=put.value.encode(), lease=put.lease)
        done.append(message("RequestOp", request_put=pair))
    for key in txn.deletes:
        deleted = message("DeleteRangeRequest", key=key.encode())
        done.append(message("RequestOp", request_delete_range=deleted))
    reads = [
        message("RequestOp", request_range=message("RangeRequest", key=key.encode())) for key in txn.reads
    ]
    return message("TxnRequest", compare=map(compare_message, txn.compare), success=done, failure=reads)


def item_of(pair: Any) -> Item:
    """A key with its value, as etcd sends it."""
    return Item(pair.key.decode(errors="replace"), pair.value.decode(errors="replace"), pair.mod_revision)


def change_of(event: Any) -> Change:
    """A change, as etcd sends it."""
    pair = event.kv
    value = None if event.type == DELETED else pair.value.decode(errors="replace")
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
