# SPDX-License-Identifier: Apache-2.0
"""The JSON schema of world files; docs/simulation.md explains the fields to people."""

from typing import Any, Dict

_number: Dict[str, Any] = {"type": "number"}
_positive: Dict[str, Any] = {"type": "number", "exclusiveMinimum": 0}
_moment: Dict[str, Any] = {"type": "number", "minimum": 0}
_point: Dict[str, Any] = {"type": "array", "items": _number, "minItems": 2, "maxItems": 2}
_placed: Dict[str, Any] = {**_point, "maxItems": 3}
_name: Dict[str, Any] = {"type": "string", "pattern": "^[A-Za-z][A-Za-z0-9_-]*$"}
_shape: Dict[str, Any] = {
    "box": {"type": "array", "items": _positive, "minItems": 3, "maxItems": 3},
    "cylinder": {"type": "array", "items": _positive, "minItems": 2, "maxItems": 2},
    "color": {"type": "string", "pattern": "^#[0-9a-fA-F]{6}$"},
}


def _object(properties: Dict[str, Any], required: str = "", **more: Any) -> Dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": required.split(),
        "additionalProperties": False,
        **more,
    }


def _list(items: Dict[str, Any]) -> Dict[str, Any]:
    return {"type": "array", "items": items}


_pose = _object({"x": _number, "y": _number, "yaw": _number}, "x y")
_segment = {"from": _point, "to": _point}

SCHEMA: Dict[str, Any] = _object(
    {
        "name": _name,
        "resolution": {"type": "number", "minimum": 0.01, "maximum": 0.2},
        "wall": _object({"thickness": _positive, "height": _positive}),
        "walls": {**_list(_object(_segment, "from to")), "minItems": 1},
        "doors": _list(_object({"name": _name, "open": {"type": "boolean"}, **_segment}, "name from to")),
        "furniture": _list(
            _object(
                {
                    "name": _name,
                    "at": _placed,
                    **_shape,
                    "on_map": {"type": "boolean"},
                    "mass": {"type": "number", "exclusiveMinimum": 0, "maximum": 500},
                },
                "name at",
                oneOf=[{"required": ["box"]}, {"required": ["cylinder"]}],
            )
        ),
        "people": _list(
            _object(
                {
                    "name": _name,
                    "path": {**_list(_point), "minItems": 1},
                    "speed": {"type": "number", "exclusiveMinimum": 0, "maximum": 3},
                    "delay": _moment,
                    "pause": _moment,
                    "polite": {"type": "boolean"},
                    "absent": {"type": "boolean"},
                },
                "name path",
            )
        ),
        "objects": _list(
            _object(
                {
                    "name": _name,
                    "class": {"type": "string", "pattern": "^[a-z][a-z0-9_]*$"},
                    "support": _name,
                    "at": _placed,
                    "yaw": _number,
                    **_shape,
                    "tag": {"type": "integer", "minimum": 0, "maximum": 49},
                    "absent": {"type": "boolean"},
                },
                "name class at",
                **{"not": {"required": ["box", "cylinder"]}},
            )
        ),
        "events": _list(
            {
                "oneOf": [
                    _object({"at": _moment, "door": _name, "open": {"type": "boolean"}}, "at door open"),
                    _object({"at": _moment, "move": _name, "to": _placed}, "at move to"),
                ]
            }
        ),
        "points_of_interest": {
            "type": "object",
            "propertyNames": {"pattern": "^[a-z][a-z0-9_]*$"},
            "additionalProperties": _pose,
        },
        "starts": _list(_pose),
    },
    "name walls points_of_interest starts",
)
