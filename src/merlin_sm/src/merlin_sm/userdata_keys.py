# SPDX-License-Identifier: Apache-2.0
"""Which userdata keys a container and its states read and set."""

from typing import Any, List, Mapping


def check_lists(**lists: Any) -> None:
    """Judges what has to be a list of names.

    :raises ValueError: for a text, which Python would take for the list of its letters.
    """
    for name, value in lists.items():
        if isinstance(value, str):  # ("s") is one, too
            raise ValueError(f"{name} is a text, where a list belongs: {name} = [{value!r}]")


def remapping_of(container: Any, state: Any) -> Mapping[str, str]:
    """Userdata key of a state → that of its container.

    A machine of MERLIN notes it with the state; SMACH's own containers do not give it back.
    """
    noted: Any = getattr(state, "remapping", None)
    if noted is not None:
        return dict(noted)
    remappings = getattr(container, "_remappings", {})
    found = (remappings.get(label) for label, child in container.get_children().items() if child is state)
    return dict(next(found, None) or {})


def given_keys(container: Any) -> List[str]:
    """Userdata keys that one of SMACH's own containers gives to its states: an Iterator's item, constants."""
    constants = getattr(container, "_constants", {}).values()
    item = [container._items_label] if hasattr(container, "_items_label") else []
    return [*item, *(key for given in constants for key in given)]
