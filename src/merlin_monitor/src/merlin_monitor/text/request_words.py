# SPDX-License-Identifier: Apache-2.0
"""Words for the states of a mission, of the Executor and of its requests, by the numbers of the messages."""

import re
from typing import Sequence, Tuple

from merlin_executor.core.outcome import Outcome
from merlin_monitor.text.phrase import Phrase, say

MISSION_STATES = ("starting", "running", "paused", "succeeded", "failed", "cancelled")
EXECUTOR_STATES = ("idle", "running", "cancelling")
OUTCOMES = tuple(outcome.name.replace("_", " ").lower() for outcome in Outcome)
#: Outcomes that are not failures → what the time bar takes them for.
MARKS = {"succeeded": "", "already true": "", "cancelled": "cancel", "dropped": "cancel"}
#: What becomes of a request when a more urgent one comes.
ON_INTERRUPT = {0: "resume", 1: "drop", 2: "never"}
#: Outcomes whose reason is the planner's.
OF_PLANNER = ("unsolvable", "planner timeout", "planner error", "no plan")
STAGES = {
    "SETTLE": "waiting until the planning system is idle",
    "ADD_GOALS": "noting the goals",
    "GENERATE_PROBLEM": "preparing to plan",
    "PLAN": "planning",
    "PARSE_PLAN": "reading the plan",
    "DISPATCH_PLAN": "starting the next action",
    "REPLAN": "preparing a new plan",
    "REMOVE_GOALS": "clearing up",
}
ENDS = {
    "succeeded": "{mission} has ended: {what}",
    "failed": "{mission} has failed: {what}",
    "cancelled": "{mission} has been cancelled: {what}",
}
HELD_BEFORE = "held before {what}"
PAUSED = "no further goal begins until the robot is resumed"
_REQUEST = re.compile(r"(?P<node>[^-]+)(?:-[0-9a-f]{12})?-\d+-\d+\.\d+(?:-leased)?\Z")
ENDED = ("succeeded", "failed", "cancelled")


def cancel_words(client: str, request: str, goals: Sequence[Phrase]) -> Phrase:
    """A cancel in words, with its client.

    :param request: empty: all requests are meant.
    :param goals: of the request; empty: they are not known.
    """
    if not request:
        return say("{client} cancels all requests", client=client)
    if not goals:
        return say("{client} cancels a request", client=client)
    return say("{client} cancels “{goals}”", client=client, goals=list(goals))


def name_of(names: Tuple[str, ...], number: int) -> str:
    """The name of a state or an outcome, by its number in a message."""
    return names[number] if 0 <= number < len(names) else str(number)


def sender_of(request: str) -> str:
    """The node that has sent a request, of its id."""
    match = _REQUEST.match(request)
    return match.group("node") if match else (request or "an unknown client")
