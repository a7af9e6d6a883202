# SPDX-License-Identifier: Apache-2.0
"""The results that a client gets, and the status that the Executor publishes."""

import pytest

from merlin_executor.core.activity import LONGEST_REASON, Activity
from merlin_executor.core.answering import ClientAnswer, answer_for, unreadable
from merlin_executor.core.outcome import Outcome, Verdict


@pytest.mark.parametrize("outcome", list(Outcome))
@pytest.mark.parametrize("accepted", [True, False])
def test_the_verb_says_what_the_outcome_says(outcome: Outcome, accepted: bool) -> None:
    answer = answer_for(outcome, accepted)
    assert (answer is ClientAnswer.SUCCEED) == outcome.achieved
    assert (answer is ClientAnswer.CANCEL) == (outcome in (Outcome.CANCELLED, Outcome.DROPPED))
    never_ran = outcome in (Outcome.REFUSED, Outcome.LATE) and not accepted
    assert (answer is ClientAnswer.REJECT) == never_ran


def test_a_request_that_cannot_be_read_is_refused_unless_it_was_taken_back() -> None:
    assert unreadable("no PDDL") == Verdict(Outcome.REFUSED, "no PDDL")
    taken_back = unreadable("the knowledge base hangs", cancelled=True)
    assert taken_back == Verdict(Outcome.CANCELLED, "cancelled before it began; the knowledge base hangs")


@pytest.mark.parametrize("outcome", list(Outcome))
def test_only_software_makes_it_ill(outcome: Outcome) -> None:
    activity = Activity()
    assert activity.report([], 0) == (False, "idle", {"waiting requests": 0, "last request": ""})
    reason = activity.ended(["(checked hall)"], Verdict(outcome, "because"))
    assert reason == activity.reason == "(checked hall): because"
    report = activity.report(["(checked kitchen)"], 2)
    assert report.ill == outcome.of_software
    assert report.text.startswith("running (checked kitchen)")
    assert ("because" in report.text) == report.ill
    assert report.values == {"waiting requests": 2, "last request": reason}


def test_a_reason_is_bounded() -> None:
    activity = Activity()
    assert len(activity.ended(["(checked hall)"] * 1000, Verdict(Outcome.SUCCEEDED))) == LONGEST_REASON
