# SPDX-License-Identifier: Apache-2.0
"""Autonomy levels: up to which one a robot decides by itself, and which one an outcome requires.

Pure. An outcome that requires more than the present level is not taken before an operator confirms it.
"""

from typing import Any, Dict, Mapping, Sequence

#: In this order. At ``full`` every outcome is taken; at ``off`` those alone that require nothing.
LEVELS = ("off", "low", "high", "full")
FULL = len(LEVELS) - 1


def read_level(text: str) -> int:
    """The place of a level among :data:`LEVELS`.

    :raises ValueError: there is no such level.
    """
    try:
        return LEVELS.index(text)
    except ValueError:
        raise ValueError(f"'{text}' is not an autonomy level; there are {', '.join(LEVELS)}") from None


def read_levels(label: str, outcomes: Sequence[str], required: Mapping[str, str]) -> Dict[str, int]:
    """Which level each outcome of a state requires.

    :param label: of the state.
    :param outcomes: that it has registered.
    :param required: outcome → level.
    :raises ValueError: the state has not registered an outcome, or there is no such level.
    """
    for outcome in required:
        if outcome not in outcomes:
            known = ", ".join(map(label_text, outcomes))
            raise ValueError(
                f"autonomy of {label}: the state has no outcome '{outcome}', its outcomes are {known}"
            )
    return {outcome: read_level(level) for outcome, level in required.items()}


def label_text(label: Any) -> str:
    """A label or an outcome of SMACH as messages show it; it may be a member of an enumeration, or a number.

    :return: of a text its characters, of anything else its ``str``.
    """
    return str.__str__(label) if isinstance(label, str) else str(label)
