# SPDX-License-Identifier: Apache-2.0
"""The results that a client gets, and the status that the Executor publishes."""

import pytest
from merlin_msgs.msg import ExecuteResult

from merlin_executor.core.outcome import LONGEST_REASON, Outcome, Verdict, end_words
from merlin_ros.actions.action_server import ServerGoal


def test_numbers_are_those_of_the_message() -> None:
    for name, outcome in Outcome.__members__.items():  # one that has the number of another is listed too
        assert getattr(ExecuteResult, name) == outcome


@pytest.mark.parametrize("outcome", list(Outcome))
@pytest.mark.parametrize("accepted", [True, False])
def test_the_verb_says_what_the_outcome_says(outcome: Outcome, accepted: bool) -> None:
    verb = outcome.verb(accepted)
    assert (verb == "succeed") == outcome.achieved
    assert (verb == "cancelled") == (outcome in (Outcome.CANCELLED, Outcome.DROPPED))
    never_ran = outcome in (Outcome.REFUSED, Outcome.LATE) and not accepted
    assert (verb == "reject") == never_ran
    assert callable(getattr(ServerGoal, verb))


def test_a_reason_is_bounded() -> None:
    assert len(end_words(["(checked hall)"] * 1000, Verdict(Outcome.SUCCEEDED))) == LONGEST_REASON
