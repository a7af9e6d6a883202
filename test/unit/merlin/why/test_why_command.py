# SPDX-License-Identifier: Apache-2.0
"""What a command line asks, and how an answer is printed."""

import sys
import threading
from pathlib import Path
from typing import Any

import pytest
import rospy
from merlin_msgs.msg import Claim, Evidence
from merlin_msgs.srv import ExplainRequest, ExplainResponse

from merlin.why import command
from merlin.why.command import lines, parser, request_of
from merlin_executor import request_times
from merlin_explain.node import recorded_run
from merlin_test import LONG


def asked(*words: str) -> ExplainRequest:
    return request_of(parser().parse_args(words))


def test_a_step_or_a_goal_is_asked_about() -> None:
    request = asked("(ask kitchen)")
    assert (request.question, request.about) == (ExplainRequest.WHY, "(ask kitchen)")


def test_another_plan_has_its_wishes() -> None:
    request = asked(
        "--not", "(ask hall)", "--not", "(ask roof)", "--without", "(ask kitchen)", "--first", "(lit)"
    )
    assert request.question == ExplainRequest.WHY_NOT
    assert (request.include, request.without, request.first) == (
        ["(ask hall)", "(ask roof)"],
        ["(ask kitchen)"],
        ["(lit)"],
    )
    instead = asked("(ask kitchen)", "--not", "(ask hall)")
    assert (instead.include, instead.without) == (["(ask hall)"], ["(ask kitchen)"])


def test_facts_and_goals_are_of_what_if_and_goals_of_no_plan() -> None:
    request = asked("--what-if", "(lit)", "--goal", "(checked hall)")
    assert (request.question, request.facts, request.goals) == (
        ExplainRequest.WHAT_IF,
        ["(lit)"],
        ["(checked hall)"],
    )
    assert asked("--goal", "(checked hall)").question == ExplainRequest.WHAT_IF
    assert asked("--no-plan", "--goal", "(checked hall)").question == ExplainRequest.NO_PLAN


@pytest.mark.parametrize("option", ["waiting", "failed", "so", "doing"])
def test_the_other_questions_have_an_option_each(option: str) -> None:
    assert asked("(lit)", f"--{option}").question == option


@pytest.mark.parametrize(
    "words",
    [[], ["--no-plan", "--waiting"], ["--what-if", "(lit)", "--not", "(ask hall)"], ["--at", "10min"]],
)
def test_nothing_and_two_things_cannot_be_asked(words: list) -> None:
    with pytest.raises(ValueError, match="ask"):
        asked(*words)


def test_evidence_is_below_its_claim() -> None:
    step = Evidence("step", "(ask hall)", 2, 0, rospy.Time(3))
    plan = Evidence("plan", "0.0: (a)\n1.0: (b)", 0, 7, rospy.Time())
    claims = [Claim("link", "It is needed.", [step, plan])]
    assert lines(claims, False) == ["  - It is needed."]
    assert lines(claims, True) == [
        "  - It is needed.",
        "      step: (ask hall) (step 2, 3.000 s)",
        "      plan: 0.0: (a) (version 7)",
        "        1.0: (b)",
    ]


def test_what_others_have_written_cannot_move_the_cursor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    heard = "heard \x1b[2J\x07\nmerlin why: forged"
    claims = [Claim("event", heard, [Evidence("event", heard, 0, 0, rospy.Time())])]
    monkeypatch.setattr(
        recorded_run, "ask_recording", lambda *_: ExplainResponse(ok=True, sentence=heard, claims=claims)
    )
    monkeypatch.setattr(sys, "argv", ["why", "--failed", "--evidence", "--recording", str(tmp_path)])
    assert command.main() == 0
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 4 and all(line.isprintable() for line in printed), printed


def test_a_past_moment_counts_from_the_first_word_of_a_simulators_clock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now, clock, asked_at, looked = [0.0], rospy.rostime.get_rostime_cond(), [], threading.Event()

    def get_time() -> float:
        looked.set()
        return now[0]

    def begin() -> None:
        looked.wait(LONG)
        with clock:
            now[0] = 1231.0
            clock.notify_all()

    def answer(request: ExplainRequest) -> ExplainResponse:
        asked_at.append(request.at.to_sec())
        return ExplainResponse(ok=True)

    monkeypatch.setattr(request_times, "CLOCK_WAIT", LONG)
    monkeypatch.setattr(rospy, "get_time", get_time)
    monkeypatch.setattr(command, "at_robot", lambda _, __, do, *___: do("/"))
    monkeypatch.setattr(command, "ServiceProxy", lambda *_, **__: answer)
    monkeypatch.setattr(sys, "argv", ["why", "--failed", "--at", "10s"])
    threading.Thread(target=begin, name="clock").start()
    assert command.main() == 0
    assert asked_at == [1221.0]
