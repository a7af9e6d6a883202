# SPDX-License-Identifier: Apache-2.0
"""Growth is seen, and noise is not taken for growth."""

from chaos.endurance import leaks, report
from chaos.under_test.processes import Usage

BEFORE = Usage(80.0, 20, 40, 30)


def test_a_steady_process_does_not_leak() -> None:
    assert leaks([(300, {"executor": BEFORE}), (3000, {"executor": Usage(95.0, 21, 41, 31)})]) == []
    assert leaks([(300, {"executor": BEFORE})]) == []


def test_each_kind_of_growth_is_named() -> None:
    found = leaks([(300, {"executor": BEFORE}), (3000, {"executor": Usage(400.0, 60, 90, 70)})])
    assert [sentence.split()[1] for sentence in found] == ["memory_mb", "threads", "descriptors", "sockets"]
    assert "3000 goals" in found[0]


def test_a_process_that_ended_is_named() -> None:
    assert leaks([(300, {"executor": BEFORE}), (3000, {})]) == [
        "executor does not run any more after 3000 goals"
    ]


def test_the_table_has_a_line_per_process() -> None:
    text = report([(30, {"executor": BEFORE, "guard": BEFORE}), (300, {"executor": Usage(95.0, 21, 41, 31)})])
    assert text.startswith("After 30 and after 300 goals:")
    assert "| executor | 80 → 95 | 20 → 21 | 40 → 41 | 30 → 31 |" in text
    assert "| guard | 80 → ended |" in text
