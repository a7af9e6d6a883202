# SPDX-License-Identifier: Apache-2.0
"""What is left of an evening: the table per guest, its file, and the timeline."""

from pathlib import Path
from typing import List, Sequence

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from merlin_executor.core.robot_lines import Deed
from merlin_restaurant.evening_record import COLUMNS, EveningRecord, GuestAccount
from merlin_restaurant.robots_account import aligned, robot_of

COLORS = {
    "navigate": "#9bb7d4",
    "take_over": "#444444",
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
#: Of a guest: from, until, colour, what it is.
PHASES = (
    ("came", "seated", "#d8c7e8", "waits for a table"),
    ("seated", "ordered", "#f1d9a7", "waits for the waiter"),
    ("ordered", "served", "#f0b4a0", "waits for the order"),
    ("served", "left", "#b9dcb9", "eats"),
)
FAILED = "#c02020"
LEGEND = {"loc": "upper left", "frameon": False, "fontsize": 8, "alignment": "left"}


def guest_table(record: EveningRecord) -> List[str]:
    """The table for the screen; what went wrong follows below it."""
    shown = COLUMNS[:-1]  # without the errors
    heads = [name.replace("waited_", "").replace("_s", "").replace("_", " ") for name in shown]
    lines = aligned([heads, *([_cell(row[column]) for column in shown] for row in record.rows())])
    for account in record.guests.values():
        lines += [f"  {account.name}: {error}" for error in account.errors]
    return lines


def plot_timeline(
    path: Path, deeds: Sequence[Deed], record: EveningRecord, start: float, robots: Sequence[str] = ("",)
) -> None:
    """Draws what each robot did, and each guest from coming to leaving; s since `start`."""
    accounts = list(record.guests.values())
    rows = len(accounts) + len(robots)
    figure, axes = plt.subplots(figsize=(14, 1.6 + 0.5 * rows))
    for deed in deeds:
        _draw_deed(axes, len(robots) - 1 - robots.index(robot_of(deed, robots)), deed, start)
    end = max([deed.ended - start for deed in deeds] + [1.0])
    for number, account in enumerate(accounts, start=1):
        _draw_guest(axes, -number, account, end)
    axes.set_yticks(range(len(robots) - 1, -len(accounts) - 1, -1))
    names = [robot or "robot" for robot in robots]
    axes.set_yticklabels([*names, *(f"{account.name}  {account.table}".strip() for account in accounts)])
    axes.set_xlabel("s of simulated time")
    axes.set_xlim(0, end)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color="#e4e4e4")
    axes.set_axisbelow(True)
    done = {_operator(deed) for deed in deeds}
    robot = [
        Patch(color=color, label=name.replace("_", " ")) for name, color in COLORS.items() if name in done
    ]
    robot += [
        Patch(facecolor="white", edgecolor="#555555", hatch="////", label="interrupted"),
        Patch(facecolor="white", edgecolor=FAILED, hatch="xxxx", label="failed"),
    ]
    guests = [Patch(color=color, label=text) for _, _, color, text in PHASES]
    guests.append(Line2D([], [], color=FAILED, marker="x", linestyle="", label="leaves unserved"))
    below = -0.8 / (0.5 * rows)  # the legends keep their distance, however many guests there are
    first = axes.legend(handles=robot, title="robot", bbox_to_anchor=(0.0, below), ncol=4, **LEGEND)
    axes.add_artist(first)
    axes.legend(handles=guests, title="guests", bbox_to_anchor=(0.68, below), ncol=2, **LEGEND)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, bbox_inches="tight", bbox_extra_artists=[first, axes.get_legend()])
    plt.close(figure)


def _operator(deed: Deed) -> str:
    return deed.text.strip("()").split()[0]


def _draw_deed(axes: plt.Axes, row: int, deed: Deed, start: float) -> None:
    failed = bool(deed.reason) and deed.reason != "cancelled"
    axes.barh(
        row,
        max(0.5, deed.ended - deed.begun),
        left=deed.begun - start,
        color=COLORS.get(_operator(deed), "#999999"),
        edgecolor=FAILED if failed else "#555555",
        linewidth=1.0 if deed.reason else 0.0,
        hatch=("xxxx" if failed else "////") if deed.reason else None,
    )


def _draw_guest(axes: plt.Axes, row: int, account: GuestAccount, end: float) -> None:
    for begins, ends, color, _ in PHASES:
        begun, ended = getattr(account, begins), getattr(account, ends)
        if begun is not None:
            until = next(time for time in (ended, account.left, end) if time is not None)
            axes.barh(row, max(0.0, until - begun), left=begun, color=color, height=0.6)
    if account.left is not None and account.served is None:
        axes.plot(account.left, row, "x", color=FAILED)


def _cell(value: object) -> str:
    if value is None or value == "":
        return "-"
    return f"{value:.0f}" if isinstance(value, float) else str(value)
