"""What the mission decides from what is known."""

from typing import List, Set

import pytest

from merlin_restaurant.evening import CLOSING_ROUNDS, Evening


class Known:
    """An evening's knowledge without a knowledge base."""

    def __init__(self, facts: Set[str]) -> None:
        self.known = facts

    def facts(self, predicate: str) -> List[str]:
        return sorted(fact for fact in self.known if fact.startswith(f"({predicate}"))


@pytest.fixture()
def evening(monkeypatch: pytest.MonkeyPatch) -> Evening:
    mission = Evening.__new__(Evening)  # its machine needs an Executor; its decisions do not
    known = Known({"(ready table_1)", "(checked table_2)", "(needs_cleaning table_2)"})
    mission.__dict__.update(_last_round=True, _closing_rounds=0, _tell=lambda text: None, known=known)
    monkeypatch.setattr(Evening, "facts", lambda self, predicate: self.known.facts(predicate))
    monkeypatch.setattr(Evening, "holds", lambda self, fact: fact in self.known.known)
    monkeypatch.setattr(Evening, "objects", lambda self, kind: ["table_1", "table_2", "table_3"])
    return mission


def test_the_evening_goes_on_until_the_restaurant_has_closed(evening: Evening) -> None:
    evening._last_round = False
    assert evening._end_round(None) == "open"


def test_a_table_that_could_not_be_looked_at_is_looked_at_again(evening: Evening) -> None:
    assert evening._tables(None) == ["(checked table_2)", "(checked table_3)"]
    assert evening._end_round(None) == "open"
    evening.known.known.add("(checked table_3)")
    assert evening._end_round(None) is None


def test_it_ends_also_when_a_table_can_never_be_looked_at(evening: Evening) -> None:
    assert [evening._end_round(None) for _ in range(CLOSING_ROUNDS)] == ["open", "open", None]


def test_what_is_on_the_tray_goes_back(evening: Evening) -> None:
    assert evening._to_bring_back(None) == []
    evening.known.known.add("(carrying table_2)")
    assert evening._to_bring_back(None) == ["(tray_free)"]


def test_a_client_waits_while_no_table_is_free(evening: Evening) -> None:
    evening.known.known.add("(waiting client_1)")
    assert evening._to_guide(None) == ["(seated client_1)"]
    evening.known.known.remove("(ready table_1)")
    assert evening._to_guide(None) == []


def test_a_call_in_a_conversation_is_none(evening: Evening) -> None:
    class Heard:
        heard = "waiter table two please"

    assert evening._note_call(Heard) == "no_call"
