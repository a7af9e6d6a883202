# SPDX-License-Identifier: Apache-2.0
"""Long lists of knowledge items on the wire, without the cost of generated code.

The generated classes need some 25 µs for one item in each direction: seconds for a large knowledge base, in
which no other client is served. Here an answer is joined from bytes that are kept with the rows, and a
request is read into plain objects.
"""

import io
import struct
from typing import Any, List, NamedTuple, Sequence, Tuple, Type, Union

import genpy
import rospy
from rosplan_knowledge_msgs.msg import DomainInequality, ExprComposite, KnowledgeItem
from rosplan_knowledge_msgs.srv import (
    GetAttributeServiceResponse,
    KnowledgeQueryServiceRequest,
    KnowledgeQueryServiceResponse,
    KnowledgeUpdateServiceArrayRequest,
)

from merlin_pddl.knowledge import Fact, FunctionValue
from merlin_rosplan.messages.knowledge_messages import KnowledgeWriter


class StoredItems(genpy.Message):
    """A GetAttributeService response with the items of stored rows."""

    _type = GetAttributeServiceResponse._type
    _md5sum = GetAttributeServiceResponse._md5sum
    _full_text = GetAttributeServiceResponse._full_text
    __slots__ = ["_rows", "_write"]
    _slot_types: List[str] = []

    def __init__(self, rows: Sequence[Union[Fact, FunctionValue]], writer: KnowledgeWriter) -> None:
        super().__init__()
        self._rows = rows
        self._write = writer

    @property
    def attributes(self) -> List[KnowledgeItem]:
        """The items, for a caller of this process."""
        return [self._write.item(row) for row in self._rows]

    def serialize(self, buff: Any) -> None:
        """Writes the response."""
        parts = [struct.pack("<I", len(self._rows))]
        for row in self._rows:
            wire = row.wire
            if wire is None:
                single = io.BytesIO()
                self._write.item(row).serialize(single)
                wire = row.wire = single.getvalue()
            parts.append(wire)
        buff.write(b"".join(parts))


class WireValue(NamedTuple):
    """A diagnostic_msgs/KeyValue that was read."""

    key: str
    value: str


class WireItem(NamedTuple):
    """A knowledge item that was read: the fields of the message, without expression and inequality.

    `wire` is what it was read from.
    """

    knowledge_type: int
    initial_time: genpy.Time
    is_negative: bool
    instance_type: str
    instance_name: str
    attribute_name: str
    values: List[WireValue]
    function_value: float
    assign_op: int
    optimization: str
    wire: bytes
    expr: ExprComposite = ExprComposite()
    ineq: DomainInequality = DomainInequality()


_HEAD = struct.Struct("<BIIB")
_LENGTH = struct.Struct("<I")
_NUMBER = struct.Struct("<dB")
_TAIL = struct.Struct("<IBIIB")  # tokens of expr; comparison type, tokens left and right, grounded
_SHORTEST = _HEAD.size + 5 * _LENGTH.size + _NUMBER.size + _TAIL.size
_NOW = genpy.Time(0)


class _HasExpressions(Exception):
    """The request holds items that only the generated code reads."""


class _BoundedRequest:
    """A request whose items without expressions are read as :class:`WireItem`.

    :cvar max_items: of a request with more only the number is read; 0: no limit.
    :ivar too_many: how many items a request has that was not read.
    """

    max_items = 0
    too_many = 0

    def deserialize(self, data: bytes) -> Any:
        """Reads the request.

        :raises genpy.DeserializationError: the bytes end too early.
        """
        try:
            self.too_many, self.knowledge = _read_items(data, self._before(data), self.max_items)
        except _HasExpressions:
            super().deserialize(data)  # type: ignore[misc]
        except struct.error as error:
            raise genpy.DeserializationError(str(error)) from error
        return self

    def _before(self, data: bytes) -> int:
        """Reads what comes before the items; returns where these begin."""
        return 0


class UpdateArrayRequest(_BoundedRequest, KnowledgeUpdateServiceArrayRequest):
    """The request of update_array."""

    def _before(self, data: bytes) -> int:
        (count,) = _LENGTH.unpack_from(data, 0)
        self.update_type = data[4 : 4 + count]
        return 4 + int(count)


class QueryRequest(_BoundedRequest, KnowledgeQueryServiceRequest):
    """The request of query_state."""


class QueryResponse(genpy.Message):
    """A KnowledgeQueryService response; what was not true goes back as it came."""

    _type = KnowledgeQueryServiceResponse._type
    _md5sum = KnowledgeQueryServiceResponse._md5sum
    _full_text = KnowledgeQueryServiceResponse._full_text
    __slots__ = ["results", "false_knowledge"]
    _slot_types: List[str] = []

    def __init__(self, results: List[bool], false_knowledge: Sequence["AnyItem"]) -> None:
        super().__init__()
        self.results = results
        self.false_knowledge = false_knowledge

    def serialize(self, buff: Any) -> None:
        """Writes the response."""
        parts = [
            struct.pack("<BI", not self.false_knowledge, len(self.results)),
            bytes(self.results),
            struct.pack("<I", len(self.false_knowledge)),
        ]
        for item in self.false_knowledge:
            if isinstance(item, WireItem):
                parts.append(item.wire)
            else:
                single = io.BytesIO()
                item.serialize(single)
                parts.append(single.getvalue())
        buff.write(b"".join(parts))


def _read_items(data: bytes, position: int, max_items: int) -> Tuple[int, List[WireItem]]:
    """The items of a list, or none of them and their number when they are too many."""
    (count,) = _LENGTH.unpack_from(data, position)
    position += _LENGTH.size
    # An item has at least this length: a larger count cannot be true, and is not read.
    if count * _SHORTEST > len(data) - position:
        raise genpy.DeserializationError(f"{len(data) - position} bytes cannot hold {count} items")
    if 0 < max_items < count:
        return count, []
    items = []
    for _ in range(count):
        item, position = _read_item(data, position)
        items.append(item)
    return 0, items


def _read_text(data: bytes, position: int) -> Tuple[str, int]:
    (length,) = _LENGTH.unpack_from(data, position)
    end = position + 4 + length
    return data[position + 4 : end].decode("utf-8", "rosmsg"), end


def _read_item(data: bytes, start: int) -> Tuple[WireItem, int]:
    kind, seconds, nanoseconds, negative = _HEAD.unpack_from(data, start)
    time = genpy.Time(seconds, nanoseconds) if seconds or nanoseconds else _NOW
    instance_type, position = _read_text(data, start + _HEAD.size)
    instance, position = _read_text(data, position)
    name, position = _read_text(data, position)
    (count,) = _LENGTH.unpack_from(data, position)
    position += 4
    values = []
    for _ in range(count):
        key, position = _read_text(data, position)
        value, position = _read_text(data, position)
        values.append(WireValue(key, value))
    number, op = _NUMBER.unpack_from(data, position)
    optimization, position = _read_text(data, position + _NUMBER.size)
    tokens, _, left, right, _ = _TAIL.unpack_from(data, position)
    if tokens or left or right:
        raise _HasExpressions
    end = position + _TAIL.size
    wire = data[start:end]
    item = WireItem(
        kind, time, bool(negative), instance_type, instance, name, values, number, op, optimization, wire
    )
    return item, end


def bounded(service_class: Type[Any], request: Type[Any], max_items: int) -> Type[Any]:
    """A service for its server, whose requests have at most so many items (0: any number).

    :param request: one of the two above that belongs to it; clients use the generated class.
    """
    limited = type(request.__name__, (request,), {"max_items": max_items})
    return type(service_class.__name__, (service_class,), {"_request_class": limited})


def refuse_too_many(request: Any) -> None:
    """Fails the call of a request that is too long to be read.

    :raises rospy.ServiceException: it was.
    """
    if request.too_many:
        raise rospy.ServiceException(
            f"{request.too_many} items, more than the {request.max_items} of ~max_items: send them in parts"
        )


#: What an update or a question may come as.
AnyItem = Union[KnowledgeItem, WireItem]
