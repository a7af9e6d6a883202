# SPDX-License-Identifier: Apache-2.0
"""The prospects of an open goal: why robots do not bid for it, and whether any may take it."""

from typing import Dict

from merlin_fleet.core.auction import unsuited
from merlin_fleet.core.records import Bids, Goal
from merlin_fleet.core.view import FleetView


def remarks(view: FleetView, goal: Goal) -> Dict[str, str]:
    """Remarks of the joined robots: why each does not bid for a goal, or what its bid lacks."""
    found = {}
    for name in view.lives:
        bids = view.offers.of(name) or Bids()
        bid = bids.of.get(goal.id)
        reason = _refusal(view, goal, name) or bids.reason or (bid.reason if bid is not None else "")
        if reason:
            found[name] = reason
    return found


def hopeless(view: FleetView, goal: Goal) -> str:
    """The reason why an open goal stays open; empty: a robot may take it.

    A robot that has enough to do may take it later, and one that has not said anything may, too.
    """
    if not view.lives:
        return "no robot is joined"
    if all(_refusal(view, goal, name) for name in view.lives):
        return "no robot that is joined can do it"
    return ""


def _refusal(view: FleetView, goal: Goal, robot: str) -> str:
    """Why a robot does not take a goal, however much room it has; empty: it may."""
    profile = view.robots.get(robot)
    reason = unsuited(goal, profile) if profile is not None else ""
    if reason:
        return reason
    for report in view.failures.get(goal.id, {}).values():
        if report.robot == robot:
            return f"it has tried: {report.outcome}" + (f", {report.reason}" if report.reason else "")
    bid = (view.offers.of(robot) or Bids()).of.get(goal.id)
    return bid.reason or "it refuses" if bid is not None and bid.cost is None else ""
