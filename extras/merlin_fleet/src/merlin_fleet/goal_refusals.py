# SPDX-License-Identifier: Apache-2.0
"""Whether a goal can be sent: what a client refuses before the hub has it."""

import re

from merlin_executor.core.request_limits import check_size
from merlin_fleet.core import records
from merlin_fleet.core.records import Goal
from merlin_pddl.text_reader import PddlError, read_expression

#: Characters of a record: the hub sends 500 at once, which have to fit into a message (`hub.LARGEST`).
LONGEST_RECORD = 100_000
DOMAIN = re.compile(r"[^\s@]+(@[0-9a-f]+)?\Z")


def check_goal(goal: Goal) -> None:
    """Checks its texts, and that other clients and robots can read it.

    :raises ValueError: when it cannot be sent.
    """
    if not goal.goals:
        raise ValueError("no goal is given")
    try:
        check_size(goal.goals)
        for text in goal.goals:
            if not read_expression(text, "goal"):
                raise ValueError(f"'{text}' is an empty goal")
    except PddlError as error:
        raise ValueError(str(error)) from None
    record = records.encode(goal)
    if len(record) > LONGEST_RECORD:
        raise ValueError(
            f"the goal has {len(record)} characters as the hub keeps it; it may have {LONGEST_RECORD}"
        )
    records.decode(Goal, record)
    if goal.robot:
        records.checked_name(goal.robot, "the robot")
    for group in goal.groups:
        _check_listed(group, "the group")
    for capability in goal.needs:
        _check_listed(capability, "the capability")
    if goal.domain and not DOMAIN.match(goal.domain):
        raise ValueError(f"the domain '{goal.domain}' is not a name, or a name, '@' and a hash")


def _check_listed(name: str, what: str) -> None:
    """Checks a name as robots have it, which are told theirs in a list with commas."""
    if not name or "," in name or name != name.strip():
        raise ValueError(f"{what} '{name}' is not a name: no robot can have it")
