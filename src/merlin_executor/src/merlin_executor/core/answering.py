# SPDX-License-Identifier: Apache-2.0
"""How a client is answered: actionlib's verb for a verdict, the verdict on what cannot be read. Pure."""

from enum import Enum

from merlin_executor.core.agenda import NOT_BEGUN
from merlin_executor.core.outcome import Outcome, Verdict


class ClientAnswer(Enum):
    """The verbs that end a goal of an action server."""

    SUCCEED = "succeed"
    CANCEL = "cancel"
    REJECT = "reject"
    ABORT = "abort"


def answer_for(outcome: Outcome, accepted: bool) -> ClientAnswer:
    """The verb for an outcome.

    :param accepted: whether the client got the state ACTIVE; such a request cannot be rejected.
    """
    if outcome.achieved:
        return ClientAnswer.SUCCEED
    if outcome in (Outcome.CANCELLED, Outcome.DROPPED):
        return ClientAnswer.CANCEL
    if outcome in (Outcome.REFUSED, Outcome.LATE) and not accepted:
        return ClientAnswer.REJECT
    return ClientAnswer.ABORT


def unreadable(reason: str, cancelled: bool = False) -> Verdict:
    """On a request that could not be read, or not be checked.

    :param reason: a sentence.
    :param cancelled: its client has taken it back meanwhile.
    """
    if cancelled:
        return Verdict(Outcome.CANCELLED, f"{NOT_BEGUN}; {reason}")
    return Verdict(Outcome.REFUSED, reason)
