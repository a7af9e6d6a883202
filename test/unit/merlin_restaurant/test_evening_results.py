# SPDX-License-Identifier: Apache-2.0
"""What is left of an evening: table, file and picture."""

import csv
from pathlib import Path

import cv2

from merlin_executor.core.robot_lines import Deed
from merlin_restaurant.evening_record import (
    CAME,
    COLUMNS,
    DISTURBED,
    LEFT,
    ORDERED,
    SEATED,
    SERVED,
    EveningRecord,
)
from merlin_restaurant.robots_account import write_rows


def evening_record() -> EveningRecord:
    kept = EveningRecord()
    for time, event, guest, table, items, reason in (
        (5.0, CAME, "ann", "", (), ""),
        (40.0, SEATED, "ann", "table_1", (), ""),
        (62.5, ORDERED, "ann", "table_1", ("cake",), ""),
        (140.0, SERVED, "ann", "table_1", ("cake",), ""),
        (100.0, CAME, "ben", "", (), ""),
        (120.0, DISTURBED, "ben", "", (), "walks off"),
        (125.0, LEFT, "ben", "", (), "walked off before there was a table"),
    ):
        kept.guest_event(time, event, guest, table, items, reason)
    return kept


def test_the_table_tells_waiting_serving_and_errors() -> None:
    from merlin_restaurant.evening_results import guest_table  # with matplotlib: other workers do without

    lines = guest_table(evening_record())
    assert " ".join(lines[0].split()) == (
        "guest table came for table for waiter for order ordered served calls outcome"
    )
    assert lines[1].split() == ["ann", "table_1", "5", "35", "22", "78", "cake", "cake", "0", "served"]
    assert lines[2].endswith("walked off before there was a table")
    assert lines[3:] == ["  ben: walks off"]


def test_the_file_has_a_row_per_guest(tmp_path: Path) -> None:
    write_rows(tmp_path / "guests.csv", COLUMNS, evening_record().rows())
    with (tmp_path / "guests.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["guest"], row["waited_for_order_s"], row["errors"]) for row in rows] == [
        ("ann", "77.5", ""),
        ("ben", "", "walks off"),
    ]


def test_the_timeline_is_a_picture_also_of_an_evening_without_anything(tmp_path: Path) -> None:
    from merlin_restaurant.evening_results import plot_timeline

    deeds = [
        Deed("(navigate bar table_1)", 1010.0, 1030.0, ""),
        Deed("(check_table table_1)", 1030.0, 1031.0, "cancelled"),
        Deed("(deliver_order table_1)", 1040.0, 1045.0, "the guests have left table_1"),
    ]
    for name, done, kept in (("full", deeds, evening_record()), ("empty", [], EveningRecord())):
        plot_timeline(tmp_path / f"{name}.png", done, kept, 1000.0)
        picture = cv2.imread(str(tmp_path / f"{name}.png"))
        assert picture is not None and picture.shape[1] > 800
