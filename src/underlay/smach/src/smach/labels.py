# SPDX-License-Identifier: Apache-2.0
"""Labels, outcomes and keys: texts, members of enumerations, numbers."""

from typing import Any, Dict, Hashable, Mapping, Optional

from smach.exceptions import InvalidStateError


def is_name(value: Any) -> bool:
    """Whether a value can be a label, an outcome or a userdata key: what a dict can hold, but not None."""
    return value is not None and isinstance(value, Hashable)


def text_of(name: Any) -> str:
    """A label, an outcome or a key as paths, messages and logs show it.

    :return: of a text its characters, also of a member of an enumeration; of anything else its ``str``.
    """
    # str() of a member of class L(str, Enum) is 'L.ONE', and format() differs between versions of Python.
    return str.__str__(name) if isinstance(name, str) else str(name)


def mapping_of(value: Optional[Mapping[Any, Any]], where: str, what: str, shape: str) -> Dict[Any, Any]:
    """A copy of an argument that is a dict; what is empty counts as none.

    :param where: path of the state.
    :param what: the argument's name.
    :param shape: what leads to what in it.
    :raises InvalidStateError: it is not a mapping.
    """
    if not value:
        return {}
    if not isinstance(value, Mapping):
        raise InvalidStateError(f"'{where}': {what} must be a dict {shape}, not {value!r}")
    return dict(value)
