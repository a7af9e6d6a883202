"""What is left of an evening: the table per guest, its file, and the timeline."""

import csv
from pathlib import Path
from typing import Dict, List, Sequence

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from merlin_restaurant.books import Books
from merlin_restaurant.robot_watch import Deed

COLUMNS = (
    "guest",
    "table",
    "came_s",
    "waited_for_table_s",
    "waited_for_waiter_s",
    "waited_for_order_s",
    "ordered",
    "served",
    "calls",
    "outcome",
    "errors",
)
COLORS = {
    "navigate": "#9bb7d4",
    "check_table": "#d9b44a",
    "take_order": "#6aa56a",
    "order_to_barman": "#c06c3e",
    "load_order": "#a0522d",
    "deliver_order": "#2e8b57",
    "return_order": "#8b5a5a",
    "check_entrance": "#c9a0dc",
    "greet_client": "#9467bd",
    "guide_client": "#6a3d9a",
}


def guest_table(books: Books) -> List[str]:
    """The table for the screen; what went wrong follows below it."""
    heads = (
        "guest",
        "table",
        "came",
        "for table",
        "for waiter",
        "for order",
        "ordered",
        "served",
        "calls",
        "outcome",
    )
    rows = [heads] + [tuple(_cell(row[column]) for column in COLUMNS[:10]) for row in books.rows()]
    widths = [max(map(len, column)) for column in zip(*rows)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip() for row in rows]
    for account in books.guests.values():
        lines += [f"  {account.name}: {error}" for error in account.errors]
    return lines


def write_guests(path: Path, books: Books) -> None:
    """Writes guests.csv."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(books.rows())


def plot_timeline(path: Path, deeds: Sequence[Deed], books: Books, start: float) -> None:
    """Draws what the robot did, and each guest from coming to leaving; s since `start`."""
    figure, axes = plt.subplots(figsize=(14, 1.5 + 0.5 * (len(books.guests) + 1)))
    seen: Dict[str, bool] = {}
    for deed in deeds:
        name = deed.text.strip("()").split()[0]
        axes.barh(
            0,
            max(0.5, deed.ended - deed.begun),
            left=deed.begun - start,
            color=COLORS.get(name, "#999999"),
            edgecolor="#c02020" if deed.reason else "none",
            hatch="//" if deed.reason else None,
            label=None if seen.get(name) else name.replace("_", " "),
        )
        seen[name] = True
    end = max([deed.ended - start for deed in deeds] + [1.0])
    for number, account in enumerate(books.guests.values(), start=1):
        _draw_guest(axes, -number, account, end)
    axes.set_yticks([0, *(-number for number in range(1, len(books.guests) + 1))])
    axes.set_yticklabels(["robot", *(f"{account.name} {account.table}" for account in books.guests.values())])
    axes.set_xlabel("s of simulated time")
    axes.set_xlim(0, end)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.25), ncol=6, frameon=False, fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(figure)


def _draw_guest(axes: plt.Axes, row: int, account: object, end: float) -> None:
    marks = [
        (account.came, account.seated, "#d8c7e8", "waits for a table"),
        (account.seated, account.ordered, "#f1d9a7", "waits for the waiter"),
        (account.ordered, account.served, "#f0b4a0", "waits for the order"),
        (account.served, account.left, "#b9dcb9", "eats"),
    ]
    for begin, finish, color, _ in marks:
        if begin is not None:
            until = finish if finish is not None else (account.left if account.left is not None else end)
            axes.barh(row, max(0.0, until - begin), left=begin, color=color, height=0.6)
    if account.left is not None and account.served is None:
        axes.plot(account.left, row, "x", color="#c02020")


def _cell(value: object) -> str:
    if value is None or value == "":
        return "-"
    return f"{value:.0f}" if isinstance(value, float) else str(value)
