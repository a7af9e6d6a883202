"""Rows of a knowledge base as JSON values, for the state file."""

import dataclasses
from typing import Any, Dict, List, Type, Union

from merlin_rosplan import formula
from merlin_rosplan.knowledge import Fact, FunctionValue, Goal, Instance, Metric, Row, Timed
from merlin_rosplan.knowledge_state import MetricRow, Note

_FORMULAS: Dict[str, Type[Any]] = {
    kind.__name__: kind
    for kind in (
        formula.And,
        formula.Arithmetic,
        formula.Atom,
        formula.Comparison,
        formula.Equal,
        formula.Exists,
        formula.Fluent,
        formula.Forall,
        formula.Not,
        formula.Number,
        formula.Or,
        formula.Preference,
        formula.Special,
        formula.Variable,
    )
}


def encode_formula(value: Any) -> Any:
    """A condition or numeric expression as nested lists: the class's name, then its fields."""
    if isinstance(value, tuple):
        return [encode_formula(part) for part in value]
    if dataclasses.is_dataclass(value):
        fields = [encode_formula(getattr(value, field.name)) for field in dataclasses.fields(value)]
        return {type(value).__name__: fields}
    return value


def decode_formula(data: Any) -> Any:
    """What :func:`encode_formula` made.

    Raises
    ------
    ValueError, KeyError, TypeError: the data is something else.
    """
    if isinstance(data, list):
        return tuple(decode_formula(part) for part in data)
    if isinstance(data, dict):
        ((name, fields),) = data.items()
        return _FORMULAS[name](*[decode_formula(part) for part in fields])
    return data


def encode_row(row: Row) -> List[Any]:
    """A row as a JSON value; the kind of its table is kept beside it."""
    if isinstance(row, Instance):
        return [row.type_name, row.name]
    if isinstance(row, Fact):
        return [row.name, list(row.args), row.negative, row.since, row.labels]
    if isinstance(row, FunctionValue):
        return [row.name, list(row.args), row.value, row.since, row.op, row.labels]
    if isinstance(row, Timed):
        kind = {Instance: "instance", Fact: "fact", FunctionValue: "value"}[type(row.item)]
        return [row.at, kind, encode_row(row.item)]
    if isinstance(row, Goal):
        instance = None if row.instance is None else encode_row(row.instance)
        return [encode_formula(row.condition), instance, row.since]
    if isinstance(row, MetricRow):
        return [row.metric.optimization, encode_formula(row.metric.value)]
    assert isinstance(row, Note)
    return [row.name, row.data]


def decode_row(kind: str, data: List[Any]) -> Row:
    """The row that :func:`encode_row` made for a table of that kind.

    Raises
    ------
    ValueError, KeyError, TypeError: the data is something else.
    """
    if kind == "instance":
        return Instance(*data)
    if kind == "fact":
        name, args, negative, since, labels = data
        return Fact(name, tuple(args), negative, since, _tuple(labels))
    if kind == "value":
        name, args, value, since, op, labels = data
        return FunctionValue(name, tuple(args), value, since, op, _tuple(labels))
    if kind == "timed":
        at, item_kind, item = data
        decoded = decode_row(item_kind, item)
        assert isinstance(decoded, (Instance, Fact, FunctionValue))
        return Timed(at, decoded)
    if kind == "goal":
        condition, instance, since = data
        return Goal(decode_formula(condition), None if instance is None else Instance(*instance), since)
    if kind == "metric":
        optimization, value = data
        return MetricRow(Metric(optimization, decode_formula(value)))
    return Note(*data)


def _tuple(labels: Union[List[str], None]) -> Any:
    return None if labels is None else tuple(labels)
