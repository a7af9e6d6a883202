# SPDX-License-Identifier: Apache-2.0
"""What is worth remembering: the events of the history."""

from typing import Any, Callable, Dict, NamedTuple

from merlin_monitor.text.phrase import Phrase, in_english

KINDS = (
    *("mission", "goal", "plan", "action", "speech", "sight"),
    *("machine", "knowledge", "health", "guard", "control", "monitor"),
)


class Event(NamedTuple):
    """Something that happened.

    :ivar kind: one of :data:`KINDS`.
    :ivar text: one line in plain words.
    :ivar at: ROS time, s.
    :ivar detail: what a timeline draws: ``began`` and ``ended`` (ROS time, s), ``outcome``, ``lane``,
        ``label`` (PDDL) and ``words`` (the same as a phrase); and ``said``, the text as a phrase.
    :ivar mark: what the time bar jumps to: failure, cancel or replan; empty: none of these.
    """

    kind: str
    text: str
    at: float
    detail: Dict[str, Any] = {}
    mark: str = ""


def sentence(kind: str, phrase: Phrase, at: float, mark: str = "", **detail: Any) -> Event:
    """An event that the page shows in the reader's language."""
    return Event(kind, in_english(phrase), at, {**detail, "said": phrase}, mark)


Reporter = Callable[[Event], None]
