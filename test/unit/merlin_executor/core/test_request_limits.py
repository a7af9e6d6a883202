# SPDX-License-Identifier: Apache-2.0
"""A request at a limit is taken; one beyond it is refused with the limit."""

import pytest

from merlin_executor.core.request_limits import (
    LARGEST_VALUE,
    LEAST_VALUE,
    MAX_GOALS,
    MAX_OF_CLIENT,
    MAX_PRIORITY,
    MAX_TEXT,
    MAX_TOKENS,
    MAX_WAITING,
    RequestTooLarge,
    check_priority,
    check_size,
    check_value,
    why_full,
)

TEXTS = ["(checked kitchen)"] * (MAX_GOALS - 1)


def test_at_the_limit() -> None:
    check_size([*TEXTS, "(checked bathroom)"])
    check_size(TEXTS, items=1, tokens=MAX_TOKENS)
    check_size(["x" * (MAX_TEXT - 1), "y"])
    assert [check_value(each) for each in (LEAST_VALUE, LARGEST_VALUE)] == [LEAST_VALUE, LARGEST_VALUE]
    assert [check_priority(each) for each in (MAX_PRIORITY, -MAX_PRIORITY)] == [MAX_PRIORITY, -MAX_PRIORITY]


def test_beyond_it() -> None:
    with pytest.raises(RequestTooLarge, match=f"has {MAX_GOALS + 1} goals; it may have {MAX_GOALS}"):
        check_size(TEXTS, items=2)
    with pytest.raises(RequestTooLarge, match=f"has {MAX_GOALS + 1} goals"):
        check_size([*TEXTS, *TEXTS[:2]])
    with pytest.raises(RequestTooLarge, match=f"have {MAX_TEXT + 1} characters; they may have {MAX_TEXT}"):
        check_size(["x" * MAX_TEXT, "y"])
    with pytest.raises(RequestTooLarge, match=f"has {MAX_TOKENS + 1} tokens; it may have {MAX_TOKENS}"):
        check_size([], tokens=MAX_TOKENS + 1)


@pytest.mark.parametrize("value", [0.0, -1.0, LEAST_VALUE / 2, LARGEST_VALUE * 2, float("nan"), float("inf")])
def test_a_value_that_a_message_cannot_hold(value: float) -> None:
    with pytest.raises(RequestTooLarge, match="a number above 0"):
        check_value(value)


@pytest.mark.parametrize("priority", [MAX_PRIORITY + 1, -MAX_PRIORITY - 1, 1.5, "high", None])
def test_a_priority_that_a_message_cannot_hold(priority: object) -> None:
    with pytest.raises(RequestTooLarge, match="a whole number from"):
        check_priority(priority)  # type: ignore[arg-type]


def test_how_many_may_wait() -> None:
    others = [f"/client_{number}" for number in range(MAX_WAITING - MAX_OF_CLIENT)]
    own = ["/me"] * MAX_OF_CLIENT
    assert why_full([*others, *own[1:]], "/me") == ""
    assert why_full(own, "/other") == ""
    assert why_full(own, "/me") == f"{MAX_OF_CLIENT} requests of /me wait already; no more may"
    assert why_full([""] * MAX_OF_CLIENT, "").startswith(
        f"{MAX_OF_CLIENT} requests of clients without a name"
    )
    assert why_full([*others, *own], "/other") == f"{MAX_WAITING} requests wait already; no more may"
