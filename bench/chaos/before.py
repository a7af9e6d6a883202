# SPDX-License-Identifier: Apache-2.0
"""What goes wrong before the fault of a trial: nothing but an earlier trial can be its cause.

A system that an earlier fault has left broken must not hide behind trials that "do not count".
"""

from typing import List

from chaos.judging.events import Event
from chaos.judging.rules import GOOD, Judgement
from chaos.result import Result
from chaos.trials import Trial


class Missed(Exception):
    """The moment was over before the fault; the trial says nothing."""


class BrokenBefore(Exception):
    """The system does not do what it has to before the fault."""


def ended_before(ended: Event) -> Exception:
    """What it means that the request ended before its moment.

    One that was too fast, or was cancelled, says nothing. One that failed by itself does.
    """
    outcome, reason = ended["outcome"], ended["reason"]
    sentence = f"the request ended before its moment: {outcome}: {reason[:120]}"
    return Missed(sentence) if outcome in (*GOOD, "CANCELLED") else BrokenBefore(sentence)


def failed_before(trial: Trial, broken: Exception, earlier: str, log: List[Event]) -> Result:
    """A trial whose fault was not done, as a violation.

    :param earlier: label of the last trial on the same system; empty: it was fresh.
    """
    after = f"after the trial '{earlier}'" if earlier else "on a fresh system"
    sentence = f"before any fault of this trial, {after}: {broken}"
    note = f"the fault '{trial.label}' was not done"
    return Result(trial, Judgement((sentence,), None, None, None, ""), note, log, struck=False)
