# SPDX-License-Identifier: Apache-2.0
"""The ledger of goals: in whatever order, what may be in the knowledge base is named and removed."""

from typing import List, Set

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from merlin_executor.goals.goal_ledger import GoalLedger

GOALS = ["(checked kitchen)", "(checked hall)", "(>= (battery) 20)"]


def ledger() -> GoalLedger[str]:
    return GoalLedger(str, "life")


class Ledger(RuleBasedStateMachine):
    """An Executor and a knowledge base that answers, refuses, or hangs and goes on later."""

    def __init__(self) -> None:
        super().__init__()
        self.ledger = ledger()
        self.stored: Set[str] = set()
        self.late: Set[str] = set()  # additions that a hung knowledge base still has before it
        self.lost: List[str] = []  # leases of which the knowledge base has heard that they are lost

    @rule(goals=st.lists(st.sampled_from(GOALS), unique=True), answered=st.booleans())
    @precondition(lambda self: not self.late)
    def add(self, goals: List[str], answered: bool) -> None:
        before = self.ledger.lease
        assert self.ledger.with_these(goals) == [*self.ledger.texts, *(
            goal for goal in goals if goal not in self.ledger.texts
        )]  # fmt: skip
        self.ledger.begin(goals)
        assert not self.ledger.lease or self.ledger.lease != before
        if answered:
            self.stored.update(goals)
            self.ledger.answered()
        else:
            self.late.update(goals)

    @rule(goals=st.lists(st.sampled_from(GOALS), unique=True))
    @precondition(lambda self: not self.late)
    def refuse(self, goals: List[str]) -> None:
        before = self.ledger.texts
        self.ledger.begin(goals)
        self.ledger.refused()
        assert self.ledger.texts == before

    @rule()
    def remove(self) -> None:
        self.stored -= set(self.ledger.texts)
        if not self.ledger.removed():
            self.stored |= self.late  # the addition comes true between the two removals
        self.late.clear()

    @rule()
    def lose(self) -> None:
        """The knowledge base removes what a lost lease names."""
        self.lost.append(self.ledger.lease)
        self.stored -= set(self.ledger.texts)

    @invariant()
    def what_is_stored_is_named(self) -> None:
        assert self.stored <= set(self.ledger.texts)
        assert len(self.ledger.texts) == len(set(self.ledger.texts))
        assert all(text in self.ledger.lease for text in self.ledger.texts)
        assert bool(self.ledger.lease) == bool(self.ledger.items)


TestLedger = Ledger.TestCase


def test_goals_of_a_former_life_are_not_leased_by_this_one() -> None:
    book = ledger()
    book.inherit(GOALS)
    assert book.texts == GOALS
    assert book.lease == ""
    assert book.removed()
    assert book.texts == []
