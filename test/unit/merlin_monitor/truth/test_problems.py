# SPDX-License-Identifier: Apache-2.0
"""What is wrong, the worst first; what an operator knows about stays known until it is over."""

from typing import Any, Dict, List

from merlin_monitor.text.phrase import in_english
from merlin_monitor.truth.problems import OVER, Acknowledged, Problem, problems_of

SECTIONS: Dict[str, Dict[str, Any]] = {
    "guard": {"state": "holding", "reason": "its owner is silent"},
    "now": {
        "mission": {"name": "Round"},
        "lost": {
            "mission": {"what": "is gone", "node": ""},
            "simulator": {"what": "does not answer", "node": "/merlin_sim"},
        },
        "silent_nodes": ["camera"],
    },
    "plan": {"silent": {"since": 12.0}, "planner": {"state": "unsolvable"}},
    "health": {
        "parts": {
            "arm: motor": {"level": "warning", "message": "warm"},
            "leg: motor": {"level": "ok", "silent": True},
            "eye: lens": {"level": "ok"},
        }
    },
    "map": {"stands": "stands since 3.0 s"},
}


def problems(sections: Dict[str, Dict[str, Any]]) -> List[Problem]:
    return problems_of(sections, [{"name": "plan", "title": "Plan"}], lambda at: f"{at:.1f} s")


def test_the_worst_comes_first() -> None:
    assert [in_english(problem.said) for problem in problems(SECTIONS)] == [
        "The base is held: its owner is silent",
        "Round (a node) is gone",
        "the simulator (merlin_sim) does not answer",
        "camera does not answer",
        "Plan: no news since 12.0 s",
        "leg: motor is silent",
        "No plan was found",
        "arm: motor: warm",
        "stands since 3.0 s",
    ]
    assert problems({}) == []


def test_what_is_known_stays_so_until_it_is_over() -> None:
    def of(level: str, message: str) -> List[Problem]:
        parts = {"arm: motor": {"level": level, "message": message}, "eye: lens": {"level": "warning"}}
        return problems({"health": {"parts": parts}})

    known = Acknowledged()
    warm = of("warning", "warm")
    known.acknowledge(warm[0].key, "Ana")
    shown = known.of(warm, 1.0)
    assert [(each["key"], each["by"]) for each in shown] == [
        ("part eye: lens warning", ""),
        ("part arm: motor warning", "Ana"),
    ]
    # Other words, and a moment without it, do not make it new; a worse level does.
    assert known.of(of("warning", "warmer"), 2.0)[1]["by"] == "Ana"
    known.of(of("ok", ""), 3.0)
    assert known.of(of("warning", "warm"), 2.0 + OVER - 1.0)[1]["by"] == "Ana"
    assert [each["by"] for each in known.of(of("error", "hot"), OVER)] == ["", ""]
    known.of([], 4 * OVER)
    assert [each["by"] for each in known.of(warm, 4 * OVER + 1.0)] == ["", ""]
