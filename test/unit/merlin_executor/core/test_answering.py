# SPDX-License-Identifier: Apache-2.0
"""The results that a client gets, and the status that the Executor publishes."""

import pytest

from merlin_executor.core.activity import LONGEST_REASON, Activity
from merlin_executor.core.outcome import Outcome, Verdict
from merlin_ros.actions.action_server import ServerGoal


@pytest.mark.parametrize("outcome", list(Outcome))
@pytest.mark.parametrize("accepted", [True, False])
def test_the_verb_says_what_the_outcome_says(outcome: Outcome, accepted: bool) -> None:
    verb = outcome.verb(accepted)
    assert (verb == "succeed") == outcome.achieved
    assert (verb == "cancelled") == (outcome in (Outcome.CANCELLED, Outcome.DROPPED))
    never_ran = outcome in (Outcome.REFUSED, Outcome.LATE) and not accepted
    assert (verb == "reject") == never_ran
    assert callable(getattr(ServerGoal, verb))


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
