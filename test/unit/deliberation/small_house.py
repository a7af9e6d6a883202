# SPDX-License-Identifier: Apache-2.0
"""A house of two rooms with a closed door between them, as tests of examples/deliberation see it."""

from typing import Any

from deliberation.house import House, Site, State

DICE = {"navigate": 0.9, "pick": 0.5, "place": 0.5, "open": 0.75, "close": 0.75, "detect": 0.8}
HOUSE = House(
    ("hall", "study"),
    {
        "table": Site("spot", ("hall",), 0.0, 0.0),
        "dock": Site("charger", ("hall",), 0.0, 2.0),
        "door": Site("door", ("hall", "study"), 3.0, 0.0),
        "desk": Site("spot", ("study",), 6.0, 0.0),
        "cabinet": Site("spot", ("study",), 6.0, 2.0),
    },
    DICE,
    {"navigate": 2.0, "pick": 1.0},
)


def state(**changes: Any) -> State:
    """In the hall, at no site. Door and cabinet are closed; mug on the desk, soap in the cabinet."""
    made = State(
        site="",
        room="hall",
        x=0.0,
        y=1.0,
        holding="",
        battery=80.0,
        open=frozenset({"table", "desk"}),
        things={"mug": "desk", "soap": "cabinet"},
    )
    return made._replace(**changes)
