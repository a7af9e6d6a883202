# SPDX-License-Identifier: Apache-2.0
"""What the restaurant serves, and how guests and barman speak of it."""

import re
from typing import List, Sequence

#: Objects of the PDDL type item; the camera knows them by the same names.
MENU = ("coffee", "water", "juice", "sandwich", "cake")

#: Everything on a table that belongs to a guest, full or empty.
DISHES = (*MENU, "cup", "glass", "plate", "dirty_plate", "bottle", "can")

_HEADER = "#JSGF V1.0; grammar g; "
ORDER = _HEADER + (
    f"public <order> = <item> [please] | <item> and <item> [please]; <item> = [a | one] ({' | '.join(MENU)});"
)
YES_NO = _HEADER + "public <answer> = yes [please | thank you] | no [thank you];"
ALL_RIGHT = _HEADER + "public <answer> = all right | of course;"
HERE_YOU_ARE = _HEADER + "public <answer> = here you are | all right;"
READY = _HEADER + "public <call> = your order is ready;"
CALL = _HEADER + (
    "public <call> = waiter table <number> please | good evening we would like a table; "
    "<number> = one | two | three | four | five | six;"
)
_NUMBERS = ("one", "two", "three", "four", "five", "six")


def items_in(text: str) -> List[str]:
    """The items that a sentence names, in the order of the menu."""
    words = re.findall(r"[a-z]+", text.lower())
    return [item for item in MENU if item in words]


def listed(items: Sequence[str]) -> str:
    """Items in a sentence: ``coffee and cake``."""
    return " and ".join(items)


def table_called(text: str) -> str:
    """The table that a call names; empty: it comes from the entrance."""
    numbers = [str(_NUMBERS.index(word) + 1) for word in text.split() if word in _NUMBERS]
    return f"table_{numbers[0]}" if numbers else ""


def call_from(table: str) -> str:
    """What a guest calls across the room."""
    return f"waiter table {_NUMBERS[int(table.rsplit('_', 1)[-1]) - 1]} please"


def difference(ordered: Sequence[str], seen: Sequence[str]) -> str:
    """What is wrong with an order on the bar, to be said to the barman; empty: nothing."""
    missing = [item for item in ordered if item not in seen]
    wrong = [item for item in seen if item not in ordered]
    extra = [item for item in dict.fromkeys(seen) if item in ordered and list(seen).count(item) > 1]
    parts = [f"the {listed(missing)} is missing"] if missing else []
    parts += [f"the {listed(wrong)} was not ordered"] if wrong else []
    parts += [f"there is more than one {listed(extra)}"] if extra else []
    return ", and ".join(parts)
