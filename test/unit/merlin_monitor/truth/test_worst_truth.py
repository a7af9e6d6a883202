# SPDX-License-Identifier: Apache-2.0
"""The headline says the worst of what is true: a table of situations."""

from typing import Any, Dict, Tuple

import pytest

from merlin_monitor.text.phrase import in_english
from merlin_monitor.truth.worst_truth import Facts, worst_truth

RUNS: Dict[str, Any] = {"executor": {"state": "running"}, "acts": True, "drives": True}
MISSION: Dict[str, Any] = {"name": "Round", "state": "running"}
GONE, HANGS = "is gone", "does not answer"
DRIVES = "navigating to the kitchen"

#: What is known → headline, what is below it, state, tone, whether progress is known, and what comes.
TABLE: Dict[str, Tuple[Dict[str, Any], Tuple[str, str, str, str, bool, bool]]] = {
    "all is well": (RUNS, (DRIVES, "for a", "Working", "good", True, True)),
    "the Executor hangs": (
        {**RUNS, "lost": {"executor": HANGS}},
        (f"not known: the Executor {HANGS}", f"before: {DRIVES}", "Not known", "bad", False, False),
    ),
    "the planning system hangs": (
        {**RUNS, "lost": {"planning": HANGS}},
        (f"not known: the planning system {HANGS}", f"before: {DRIVES}", "Not known", "bad", False, False),
    ),
    "the planning system hangs between two goals of a mission": (
        {"doing": "idle", "executor": {"state": "idle"}, "mission": MISSION, "lost": {"planning": HANGS}},
        (f"idle; but the planning system {HANGS}", "for a", "Idle", "bad", False, False),
    ),
    "the navigation server hangs": (
        {**RUNS, "lost": {"navigation": HANGS}},
        (f"not known: the navigation server {HANGS}", f"before: {DRIVES}", "Not known", "bad", False, False),
    ),
    "the navigation server is gone while the robot asks": (
        {**RUNS, "drives": False, "lost": {"navigation": GONE}},
        (f"{DRIVES}; but the navigation server {GONE}", "for a", "Working", "bad", False, False),
    ),
    "the process of the state machines hangs": (
        {**RUNS, "lost": {"machines": HANGS}},
        (
            f"not known: the process of the state machines {HANGS}",
            *(f"before: {DRIVES}", "Not known", "bad", False, False),
        ),
    ),
    "the process of the bridges hangs between two actions": (
        {**RUNS, "acts": False, "lost": {"bridges": HANGS}},
        (f"{DRIVES}; but the process of the bridges {HANGS}", "for a", "Preparing", "bad", False, False),
    ),
    "the process of the bridges hangs while nothing runs": (
        {"doing": "idle", "executor": {"state": "idle"}, "lost": {"bridges": HANGS}},
        ("idle", "for a", "Idle", "", True, False),
    ),
    "the simulator hangs": (
        {**RUNS, "lost": {"simulator": HANGS}},
        (f"not known: the simulator {HANGS}", f"before: {DRIVES}", "Not known", "bad", False, False),
    ),
    "the simulator hangs while nothing runs": (
        {"doing": "idle", "executor": {"state": "idle"}, "lost": {"simulator": HANGS}},
        (f"not known: the simulator {HANGS}", "before: idle", "Not known", "bad", False, False),
    ),
    "of several that hang, the first": (
        {**RUNS, "lost": {"navigation": HANGS, "executor": GONE, "planning": HANGS}},
        (f"not known: the Executor {GONE}", f"before: {DRIVES}", "Not known", "bad", False, False),
    ),
    "the guard hangs": (
        {**RUNS, "lost": {"guard": HANGS}},
        (f"not known: the velocity guard {HANGS}", f"before: {DRIVES}", "Not known", "bad", False, False),
    ),
    "the guard hangs before the robot drives": (
        {**RUNS, "drives": False, "lost": {"guard": HANGS}},
        (f"{DRIVES}; but the velocity guard {HANGS}", "for a", "Working", "bad", False, False),
    ),
    "the mission hangs, and nothing runs": (
        {"doing": "idle", "executor": {"state": "idle"}, "mission": MISSION, "lost": {"mission": HANGS}},
        (f"not known: Round {HANGS}", "before: ask in the kitchen", "Not known", "bad", False, False),
    ),
    "the mission hangs, and its goal runs": (
        {**RUNS, "mission": MISSION, "lost": {"mission": HANGS}},
        (f"{DRIVES}; but Round {HANGS}", "for a", "Working", "bad", False, False),
    ),
    "the mission has ended": (
        {
            "doing": "Round has ended",
            "executor": {"state": "idle"},
            "mission": {**MISSION, "state": "succeeded"},
            "lost": {"mission": GONE},
        },
        ("Round has ended", "for a", "Finished", "good", True, False),
    ),
    "an operator holds the base": (
        {**RUNS, "stopped": "stopped and held by Ana"},
        ("stopped and held by Ana", f"the Executor: {DRIVES}", "Stopped and held", "bad", True, False),
    ),
    "an operator holds the base, and the Executor hangs": (
        {**RUNS, "stopped": "stopped and held by Ana", "lost": {"executor": HANGS}},
        (
            "stopped and held by Ana",
            f"the Executor: not known: the Executor {HANGS}",
            *("Stopped and held", "bad", False, False),
        ),
    ),
    "the guard keeps the base": (
        {**RUNS, "kept": "its owner is silent"},
        (
            "the base is held: its owner is silent",
            f"the Executor: {DRIVES}",
            *("Base held", "bad", True, False),
        ),
    ),
    "the guard keeps the base of a goal that is being cancelled": (
        {**RUNS, "executor": {"state": "cancelling"}, "kept": "cancelled"},
        (DRIVES, "for a", "Stopping", "warn", True, False),
    ),
    "a request waits for the release": (
        {"executor": {"state": "running", "waits": "the base is held by Ana"}},
        (DRIVES, "for a", "Preparing", "good", True, False),
    ),
    "a breakpoint holds it": (
        {**RUNS, "waits": True},
        (DRIVES, "for a", "Held", "warn", True, False),
    ),
    "it pauses": (
        {**RUNS, "executor": {"state": "running", "paused": True}},
        (DRIVES, "for a", "Pausing", "warn", True, False),
    ),
    "another executive": ({"acts": True}, (DRIVES, "for a", "Working", "good", True, True)),
    "nothing is heard yet": (
        {"doing": "nothing heard yet"},
        ("nothing heard yet", "for a", "Nothing heard yet", "", True, False),
    ),
}


@pytest.mark.parametrize("name", TABLE)
def test_the_worst_is_said(name: str) -> None:
    known, wanted = TABLE[name]
    truth = worst_truth(
        Facts(**{"doing": DRIVES, "because": "for a", "step": "", "task": "ask in the kitchen", **known})
    )
    words = [in_english(each) for each in (truth.doing, truth.because, truth.state)]
    assert (*words, truth.tone, truth.known, truth.expected) == wanted
