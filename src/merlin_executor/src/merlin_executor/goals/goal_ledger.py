# SPDX-License-Identifier: Apache-2.0
"""Which goals of a knowledge base are this Executor's, and which lease names them. Pure.

A lease is ``<unique word> (and <goal> …)``: so a knowledge base knows what it is about without asking.
"""

import itertools
from typing import Callable, Collection, Generic, List, Sequence, TypeVar

Item = TypeVar("Item")


class GoalLedger(Generic[Item]):
    """The goals that were added and are not removed, each once.

    :param text: a goal as PDDL text.
    :param life: names this process; begins its leases.
    """

    def __init__(self, text: Callable[[Item], str], life: str) -> None:
        self._text = text
        self._life = life
        self._numbers = itertools.count(1)
        self._added: List[Item] = []  # by the last addition
        self._open = False  # whether an addition is still unanswered
        self.items: List[Item] = []
        """The goals, the oldest first."""
        self.lease = ""
        """Names the goals that are left; empty: all were removed."""

    @property
    def texts(self) -> List[str]:
        """The goals as PDDL text."""
        return [self._text(item) for item in self.items]

    def with_these(self, items: Sequence[Item]) -> List[str]:
        """What :attr:`texts` will be when these are added."""
        return [*self.texts, *map(self._text, self._new(items))]

    def begin(self, items: Sequence[Item]) -> None:
        """Goals are about to be added: they count from now on, an addition too many is harmless.

        The lease is a new one: the old one may be lost for good.
        """
        self._added = self._new(items)
        self.items += self._added
        self._open = True
        self._name()

    def answered(self) -> None:
        """The addition was carried out."""
        self._open = False

    def refused(self) -> None:
        """The addition was refused as a whole: its goals are not stored, and may not be removable either."""
        self._open = False
        kept = len(self.items) - len(self._added)
        self.items, self._added = self.items[:kept], []
        self._name()

    def inherit(self, items: Sequence[Item]) -> None:
        """Goals that an earlier process of this node has added, under its own lease."""
        self.items += self._new(items)

    def removed(self) -> bool:
        """The goals were removed.

        :return: whether for good. An addition that had no answer may come true later: after the first removal
            behind it they are kept, to be removed once more.
        """
        if self._open:
            self._open = False
            return False
        self.items = []
        self.lease = ""
        return True

    def all_in(self, texts: Collection[str]) -> bool:
        """Whether all of the goals are among others; names do not depend on case."""
        present = {text.lower() for text in texts}
        return all(text.lower() in present for text in self.texts)

    def _name(self) -> None:
        goals = " ".join(self.texts)
        self.lease = f"{self._life}-{next(self._numbers)} (and {goals})" if goals else ""

    def _new(self, items: Sequence[Item]) -> List[Item]:
        known = set(self.texts)
        return [item for item in items if self._text(item) not in known]
