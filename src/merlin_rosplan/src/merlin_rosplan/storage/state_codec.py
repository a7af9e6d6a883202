# SPDX-License-Identifier: Apache-2.0
"""Rows of a knowledge base as JSON values, for the state file."""

import dataclasses
from typing import Any, Dict, List, Optional, Tuple, get_args

from merlin_pddl import formula
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, Metric, Row, StoredGoal, Timed
from merlin_rosplan.knowledge.knowledge_state import MetricRow, Note

_FORMULAS = {kind.__name__: kind for kind in (*get_args(formula.Formula), formula.Variable)}


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

    :raises ValueError, KeyError, TypeError: the data is something else.
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
    if isinstance(row, StoredGoal):
        instance = None if row.instance is None else encode_row(row.instance)
        return [encode_formula(row.condition), instance, row.since]
    if isinstance(row, MetricRow):
        return [row.metric.optimization, encode_formula(row.metric.value)]
    assert isinstance(row, Note)
    return [row.name, row.data]


def decode_row(kind: str, data: Any) -> Row:
    """The row that :func:`encode_row` made for a table of that kind.

    :raises ValueError, KeyError, TypeError: when the data is something else; a file may be damaged.
    """
    if not isinstance(data, list):
        raise TypeError(f"{data!r} is not a list")
    if kind == "instance":
        type_name, name = data
        return Instance(_text(type_name), _text(name))
    if kind == "fact":
        name, args, negative, since, labels = data
        return Fact(_text(name), _texts(args), _flag(negative), _whole(since), _labels(labels))
    if kind == "value":
        name, args, value, since, op, labels = data
        return FunctionValue(
            _text(name), _texts(args), _number(value), _whole(since), _text(op), _labels(labels)
        )
    if kind == "timed":
        at, item_kind, item = data
        decoded = decode_row(item_kind, item)
        if not isinstance(decoded, (Instance, Fact, FunctionValue)):
            raise ValueError(f"a timed {item_kind!r} does not exist")
        return Timed(_whole(at), decoded)
    if kind == "goal":
        condition, instance, since = data
        declared = None if instance is None else decode_row("instance", instance)
        assert declared is None or isinstance(declared, Instance)
        if declared is None and condition is None:
            raise ValueError("a goal without a condition")
        return StoredGoal(decode_formula(condition), declared, _whole(since))
    if kind == "metric":
        optimization, value = data
        return MetricRow(Metric(_text(optimization), decode_formula(value)))
    if kind not in ("sensed", "execution", "oneof"):
        raise ValueError(f"rows of the kind {kind!r} do not exist")
    name, note = data
    if not isinstance(note, dict):
        raise TypeError(f"{note!r} is not a mapping")
    if kind == "execution":
        _check_execution(note)
    return Note(_text(name), note)


def _check_execution(note: Dict[str, Any]) -> None:
    _text(note["operator"])
    if note.get("ended"):
        return
    _whole(note["since"])
    if note["duration"] is not None:
        _number(note["duration"])
    if not isinstance(note["later"], dict):
        raise TypeError(f"{note['later']!r} is not a mapping")
    for label, value in note.get("parameters", ()):
        _text(label), _text(value)
    for name, args, negative in (*note.get("holds", ()), *note.get("interrupted", ())):
        _text(name), _texts(args), _flag(negative)
    for change in (*note["undo"], *note.get("running", ())):
        _text(change["name"]), _texts(change["args"])
        if change["kind"] == "value":
            _texts(change["key"]), _number(change["after"])
            for optional in ("before", "delta"):
                if change[optional] is not None:
                    _number(change[optional])
        elif change["was"] not in ("true", "absent", "negative"):
            raise ValueError(f"a fact that was {change['was']!r}")


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is not a text")
    return value


def _texts(value: Any) -> Tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(part, str) for part in value):
        raise TypeError(f"{value!r} is not a list of texts")
    return tuple(value)


def _labels(value: Any) -> Optional[Tuple[str, ...]]:
    return None if value is None else _texts(value)


def _flag(value: Any) -> bool:
    if value not in (True, False):
        raise TypeError(f"{value!r} is neither true nor false")
    return bool(value)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"{value!r} is not a number")
    return float(value)


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(f"{value!r} is not a whole number")
    return value
