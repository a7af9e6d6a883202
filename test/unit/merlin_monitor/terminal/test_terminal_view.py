# SPDX-License-Identifier: Apache-2.0
"""The state in a terminal."""

import re
import time
import unicodedata
from typing import Any, Dict

from hypothesis import given
from hypothesis import strategies as st

from merlin_monitor.state.history_events import Event
from merlin_monitor.terminal.terminal_view import lines, paint, printable

STATE: Dict[str, Any] = {
    "meta": {"time": 12.0, "robot": "", "simulator": {"paused": False, "factor": 3.0}},
    "now": {"doing": "asking at the kitchen", "because": "because x", "step": "step 2 of 2", "chain": []},
    "plan": {
        "order": ["0", "1"],
        "steps": {
            "0": {
                "text": "(navigate a b)",
                "words": {"english": "driving to b", "de": "?"},
                "state": "succeeded",
            },
            "1": {
                "text": "(ask b)",
                "words": "asking at b",
                "state": "failed",
                "reason": {"english": "nobody there"},
            },
        },
        "planner": {"planner": "kairos", "state": "solved"},
    },
    "queue": {"waiting": [{"goals": ["(a)"], "words": ["do a"], "priority": 5, "by": "/me"}]},
    "machines": {"containers": {"/n /N": {"path": "/N", "active": ["DRIVE"]}}},
    "knowledge": {
        "facts": {"(robot_at b)": {"by": "/x", "at": 3.0}, "(old)": {}},
        "goals": {"(checked b)": {}},
    },
    "health": {"parts": {"arm": {"level": "error", "message": "no power"}, "leg": {"level": "ok"}}},
}


def test_everything_is_there() -> None:
    text = "\n".join(paint(lines(STATE, [Event("goal", "(x) failed", 4.0)]), 80, 100, colour=False))
    for wanted in (
        "Asking at the kitchen",
        "because x · step 2 of 2",
        "+ driving to b  succeeded",
        "x asking at b  failed: nobody there",
        "do a  priority 5, from /me",
        "> /N: DRIVE",
        "(robot_at b)  /x at 3.0",
        "goal (checked b)",
        "1 of 2 well",
        "arm: error: no power",
        "(x) failed",
    ):
        assert wanted in text, wanted
    assert "\x1b" not in text


def test_the_times_of_requests_are_there_as_on_the_page() -> None:
    times = {"not_before": 100.0, "deadline": 300.0, "expected_begin": 150.5, "expected_end": 0.0}
    late = {"english": "the plan ends at 210.0 s", "de": "?"}
    waits = {"english": "waits until “do b” has ended", "de": "?"}
    waiting = [{**STATE["queue"]["waiting"][0], **times, "waits": waits, "late": ""}]
    runs = {"deadline": 200.0, "expected_end": 210.0, "late": late}
    state = {**STATE, "now": {**STATE["now"], "executor": runs}, "queue": {"waiting": waiting}}
    shown = [line.text for line in lines(state)]
    assert "the plan ends at 210.0 s, done by 200.0 s, expected to end at 210.0 s" in shown
    assert "  do a  priority 5, from /me, waits until “do b” has ended" in shown
    assert "    not before 100.0 s, done by 300.0 s, expected to begin at 150.5 s" in shown
    wall = 1_700_000_000.0  # a clock that was set counts, as everywhere on the page
    state = {"meta": {"clock_set": 60.0}, "now": {"executor": {"deadline": wall}}}
    assert f"done by {time.strftime('%H:%M:%S', time.localtime(wall + 60.0))}" in [
        line.text for line in lines(state)
    ]


def test_machines_of_one_path_are_told_apart() -> None:
    one = {"server": "/one", "node": "/here", "path": "/SM", "active": ["A"]}
    state = {"machines": {"containers": {"1": one, "2": {**one, "node": "/there", "active": []}}}}
    text = "\n".join(paint(lines(state), 80, 100, colour=False))
    assert "> /SM of /here /one: A" in text and "o /SM of /there /one: idle" in text


def test_an_empty_state_is_no_reason_to_fail() -> None:
    assert paint(lines({}), 80, 24, True)


def test_a_small_screen_cuts() -> None:
    painted = paint(lines(STATE), 20, 5, colour=False)
    assert len(painted) == 5 and all(len(line) <= 20 for line in painted)


def test_wide_letters_take_two_columns() -> None:
    def columns(text: str) -> int:
        return sum(2 if unicodedata.east_asian_width(letter) in "WF" else 1 for letter in text)

    wide = dict(STATE, now={"doing": "去厨房" * 30})
    painted = paint(lines(wide), 80, 100, colour=False)
    assert all(columns(line) <= 80 for line in painted)
    assert any(line.endswith("房>") and columns(line) == 79 for line in painted)


@given(st.text())
def test_no_name_can_move_the_cursor(name: str) -> None:
    hostile = dict(
        STATE, now={"doing": f"\x1b]0;pwned\x07{name}\r\n", "because": name, "chain": [["x", name]]}
    )
    for line in paint(lines(hostile), 80, 100, colour=True):
        plain = re.sub(r"\x1b\[[0-9]*m", "", line)
        assert plain.isprintable() and "\x1b" not in plain, repr(plain)
    assert "\u202e" not in printable("abc\u202edef")


def test_the_worst_problem_is_named_and_nothing_is_said_of_what_is_not_heard() -> None:
    def text(silence: float, *problems: Dict[str, Any]) -> str:
        now = {**STATE["now"], "problems": list(problems)}
        return "\n".join(line.text for line in lines({**STATE, "now": now}, (), silence))

    known = {"said": "eye: blind", "rank": 1, "by": "Ana"}
    fresh = {"said": "leg: warm", "rank": 2, "by": ""}
    assert "! leg: warm\n" in text(0.0, fresh, known) and "eye: blind" not in text(0.0, fresh, known)
    assert "! leg: warm (and 1 more)" in text(0.0, fresh, {**known, "by": ""})
    assert "Asking at the kitchen\nbecause x" in text(1.0)
    assert "Not known: no news for 9 s\nbefore: asking at the kitchen\n" in text(9.0)
