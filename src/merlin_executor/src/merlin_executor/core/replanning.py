# SPDX-License-Identifier: Apache-2.0
"""Whether a plan that failed is replaced by another one. Pure."""

import re
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

#: s of running time before the second new plan; twice as long before each further one. What makes a plan fail
#: at once, such as an action that has not ended yet, may pass.
REPLAN_WAIT = 1.0
#: How often the same action may fail for the same reason, where its failures are no matter of chance.
SAME_FAILURES = 2
#: A measured time: the next failure for the same reason has another one.
_MEASURED = re.compile(r"\d+\.\d+ s\b")


class Failure(NamedTuple):
    """Why a run did not continue."""

    reason: str
    """Why the plan failed, as a sentence."""
    action: str = ""
    """The ground action that failed, as PDDL text; empty: none did, as when the goal does not hold."""
    gone: bool = False
    """A part of the planning system, or the action's interface, is gone: it may come back."""
    no_retry: str = ""
    """Which actions another try cannot help, as PDDL text with ``*`` for any argument; empty: it may help."""
    outdated: bool = False
    """Nothing failed: the world has changed, and the rest of the plan does not fit it."""
    of_robot: str = ""
    """The same operator by the same robot, like `no_retry`; empty: no other robot could do it."""


class ReplanDecision(NamedTuple):
    """What to do about a failure."""

    again: bool
    """Whether the request is planned again."""
    wait: float = 0.0
    """s of running time before that."""
    reason: str = ""
    """Why not again, as a sentence."""


class Replanning:
    """The policy for one run: a bounded number of new plans, and not the same way too often.

    What one of several robots has not done the same way too often is left to the others.

    :param limit: how many new plans there may be.
    :param same_failures: how often the same action may fail for the same reason.
    :param wait: s of running time before the second new plan; twice as long before each further one.
    :param given_up: failures of earlier runs of the request that no other try can help.
    """

    def __init__(
        self,
        limit: int,
        same_failures: int = SAME_FAILURES,
        wait: float = REPLAN_WAIT,
        given_up: Sequence[Failure] = (),
    ) -> None:
        self._limit, self._same_failures, self._wait = limit, same_failures, wait
        self.given_up: List[Failure] = list(given_up)
        """Failures that no other try of their actions can help: further plans have to do without these."""
        self._failures: Dict[Tuple[str, str], int] = {}
        self.count = 0
        """New plans so far."""
        self.last: Optional[Failure] = None

    def failed(self, failure: Failure) -> ReplanDecision:
        """Decides about a failure."""
        self.last = failure
        if failure.no_retry:
            known = {other.no_retry.lower() for other in self.given_up}
            self.given_up.append(failure)
            planned_all_the_same = failure.no_retry.lower() in known
            if planned_all_the_same or self.count >= self._limit:
                return ReplanDecision(False, reason=failure.reason)
            self.count += 1
            return ReplanDecision(True)
        key = (failure.action.lower(), _MEASURED.sub("s", failure.reason))
        same = self._failures[key] = self._failures.get(key, 0) + 1
        if self.count >= self._limit:
            often = "once" if self.count == 1 else f"{self.count} times"
            times = f" (planned again {often})" if self._limit else ""
            return ReplanDecision(False, reason=failure.reason + times)
        if failure.outdated:
            self.count += 1
            return ReplanDecision(True)
        if same >= self._same_failures and not failure.gone:
            # The world has not changed enough for another end, or the planner would have found another way.
            if failure.of_robot:  # another robot may do it
                return self.failed(failure._replace(no_retry=failure.of_robot))
            if failure.action:  # a request of a joint run that can do without the action goes on
                self.given_up.append(failure._replace(no_retry=failure.action))
            return ReplanDecision(False, reason=f"{failure.reason} ({same} times for the same reason)")
        self.count += 1
        return ReplanDecision(True, self._wait * 2 ** (self.count - 2) if self.count > 1 else 0.0)
