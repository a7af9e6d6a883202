# SPDX-License-Identifier: Apache-2.0
"""What a simulated person answers to what a robot says."""

import re
from collections import deque
from typing import Deque, List, Pattern, Sequence, Tuple

import numpy as np


class Answers:
    """The answers of one person: sentences for the next questions, then patterns, then one by chance.

    :param following: answers to the next questions, whatever is asked; an empty one: says nothing.
    :param patterns: regular expressions looked for in the question, case aside; the first that fits counts.
    :param answers: the answer to each pattern.
    :param otherwise: when no pattern fits, one of these; empty: says nothing.
    :raises ValueError: when they do not fit together, or a pattern is invalid; the text says which.
    """

    def __init__(
        self,
        otherwise: Sequence[str] = (),
        following: Sequence[str] = (),
        patterns: Sequence[str] = (),
        answers: Sequence[str] = (),
    ) -> None:
        if len(patterns) != len(answers):
            raise ValueError(f"there are {len(patterns)} patterns and {len(answers)} answers to them")
        self._following: Deque[str] = deque(following)
        self._rules: List[Tuple[Pattern[str], str]] = [
            (_compiled(pattern), answer) for pattern, answer in zip(patterns, answers)
        ]
        self._otherwise = list(otherwise)

    def to(self, question: str, random: np.random.Generator) -> str:
        """The answer to a question; empty: says nothing."""
        if self._following:
            return self._following.popleft()
        for pattern, answer in self._rules:
            if pattern.search(question):
                return answer
        return self._otherwise[int(random.integers(len(self._otherwise)))] if self._otherwise else ""


def _compiled(pattern: str) -> Pattern[str]:
    try:
        return re.compile(pattern, re.IGNORECASE)
    except re.error as error:
        raise ValueError(f"the pattern {pattern!r} is not a regular expression: {error}") from error
