# SPDX-License-Identifier: Apache-2.0
"""What an answer is made of: one or two sentences, and claims with the evidence for each."""

from typing import NamedTuple, Tuple

#: Kinds of evidence.
PLAN, STEP, GOAL, FACT, VALUE, REQUEST, EVENT = "plan", "step", "goal", "fact", "value", "request", "event"


class Evidence(NamedTuple):
    """Something that shows a claim to be true.

    :ivar kind: one of the kinds above.
    :ivar text: PDDL of steps, goals, facts and values; a plan has a step per line; else words.
    :ivar step: number in the plan, from 1; 0: none.
    :ivar version: of the knowledge base; 0: not known.
    :ivar time: ROS time of an event, a fact or a request; of a step from the start of its plan; s, 0: none.
    """

    kind: str
    text: str
    step: int = 0
    version: int = 0
    time: float = 0.0


class Claim(NamedTuple):
    """One statement that was checked.

    :ivar kind: what is claimed, one word: ``link``, ``request``, ``comparison``, ….
    :ivar text: a sentence.
    """

    kind: str
    text: str
    evidence: Tuple[Evidence, ...] = ()


class Answer(NamedTuple):
    """What is said to a question. What could not be shown is not claimed: then the sentence says so."""

    sentence: str
    claims: Tuple[Claim, ...] = ()


class QuestionError(ValueError):
    """A question that cannot be answered as it is asked; the text says what is wrong and what to do."""


class Words:
    """What steps, facts and goals are called in sentences; these are as PDDL."""

    def step(self, text: str) -> str:
        """An action, ``(navigate hall kitchen)``."""
        return text

    def fact(self, text: str) -> str:
        """A fact or a condition that holds."""
        return text

    def goal(self, text: str) -> str:
        """What is wanted."""
        return text
