# SPDX-License-Identifier: Apache-2.0
"""The record of an evening balances when truth and the robot's beliefs agree, and says where they do not."""

import pytest

from merlin_restaurant.evening_record import (
    CAME,
    CLEARED,
    CLOSED,
    DISTURBED,
    LEFT,
    ORDERED,
    SEATED,
    SERVED,
    EveningRecord,
)


def evening(*events: tuple) -> EveningRecord:
    record = EveningRecord()
    for time, event, guest, table, items, reason in events:
        record.guest_event(float(time), event, guest, table, items, reason)
    return record


def served(items: tuple = ("coffee",)) -> EveningRecord:
    return evening(
        (0, CAME, "ann", "table_1", (), ""),
        (0, SEATED, "ann", "table_1", (), ""),
        (20, ORDERED, "ann", "table_1", ("coffee",), ""),
        (80, SERVED, "ann", "table_1", items, ""),
        (150, LEFT, "ann", "table_1", (), "content"),
        (160, CLOSED, "", "", (), ""),
    )


def test_the_record_of_a_good_evening_balance() -> None:
    record = served()
    record.delivered(79.0, "table_1", ["coffee"])
    record.close({"table_1": "needs_cleaning", "table_2": "ready"}, [])
    assert record.problems() == []
    (row,) = record.rows()
    assert (row["waited_for_waiter_s"], row["waited_for_order_s"], row["outcome"]) == (20.0, 60.0, "served")


def test_a_cleared_table_is_ready() -> None:
    record = served()
    record.guest_event(170.0, CLEARED, "", "table_1", (), "")
    assert record.truth("table_1") == "ready"


@pytest.mark.parametrize(
    "items, delivered, state, held, problem",
    [
        (("cake",), ["coffee"], "needs_cleaning", [], "ann ordered coffee and got cake"),
        (("coffee",), [], "needs_cleaning", [], "coffee came to table_1 1 time(s) more than the robot knows"),
        (("coffee",), ["cake"], "needs_cleaning", [], "the robot believes it brought cake to table_1"),
        (("coffee",), ["coffee"], "ready", [], "the robot knows table_1 as ready, but it is needs_cleaning"),
        (("coffee",), ["coffee"], "needs_cleaning", ["(carrying table_2)"], "(carrying table_2)"),
    ],
)
def test_what_does_not_agree_is_named(
    items: tuple, delivered: list, state: str, held: list, problem: str
) -> None:
    record = served(items)
    if delivered:
        record.delivered(79.0, "table_1", delivered)
    record.close({"table_1": state}, held)
    assert any(problem in found for found in record.problems()), record.problems()


@pytest.mark.parametrize("reason, right", [("left before the order came", True), ("waited too long", False)])
def test_a_guest_who_was_not_served_needs_a_reason_that_is_not_the_robots(reason: str, right: bool) -> None:
    record = evening(
        (0, CAME, "ben", "", (), ""), (60, LEFT, "ben", "", (), reason), (70, CLOSED, "", "", (), "")
    )
    record.close({}, [])
    assert (record.problems() == []) == right


def test_a_guest_who_is_forgotten_is_a_problem() -> None:
    record = evening((0, CAME, "ben", "", (), ""), (70, CLOSED, "", "", (), ""))
    record.close({}, [])
    assert record.problems() == ["ben was neither served nor is there a reason"]


def test_an_evening_without_an_end_is_a_problem() -> None:
    record = evening((0, CAME, "ben", "", (), ""), (9, LEFT, "ben", "", (), "content"))
    record.close({}, [])
    assert record.problems() == ["the evening did not come to its end"]


def test_errors_go_to_the_guest_who_sits_there() -> None:
    record = evening((0, SEATED, "ann", "table_1", (), ""), (5, DISTURBED, "ann", "table_1", (), "a chair"))
    record.robot_failed("table_1", "(navigate bar table_1): blocked")
    record.robot_failed("table_2", "(navigate bar table_2): blocked")
    assert record.guests["ann"].errors == ["a chair", "(navigate bar table_1): blocked"]


@pytest.mark.parametrize(
    ("table", "blocked", "balanced"),
    [
        ("table_1", ["table_1"], True),
        ("table_1", ["bar"], True),
        ("table_1", ["table_2", "entrance"], False),
        ("", ["entrance"], True),
        ("", ["bar"], False),
    ],
)
def test_what_no_robot_could_do_because_one_stands_there_that_is_gone_is_not_a_mistake(
    table: str, blocked: list, balanced: bool
) -> None:
    record = evening(
        (0, CAME, "ann", table, (), ""),
        (900, LEFT, "ann", table, (), "waited too long for the waiter"),
        (901, CLOSED, "", "", (), ""),
    )
    record.close({}, [], blocked)
    assert (record.problems() == []) == balanced
    assert ("a robot that takes no actions stands in the way" in record.rows()[0]["errors"]) == balanced


def test_the_state_of_a_table_where_a_robot_stands_that_is_gone_is_not_known() -> None:
    record = served()
    record.delivered(79.0, "table_1", ["coffee"])
    record.close({"table_1": "already_served"}, [], ["table_1"])
    assert record.problems() == []
