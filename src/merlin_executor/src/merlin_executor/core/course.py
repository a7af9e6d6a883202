# SPDX-License-Identifier: Apache-2.0
"""The course of a run through the stages of planning, and the verdict on it. Pure."""

from typing import Dict, List, NamedTuple, Sequence

from merlin_executor.core.awaited import Absence
from merlin_executor.core.outcome import Outcome, Verdict
from merlin_executor.core.replanning import REPLAN_WAIT, SAME_FAILURES, Failure, ReplanDecision, Replanning
from merlin_pddl.plan_text import INTERFACE_GONE, OUTDATED
from merlin_planning.dispatch_progress import DispatchResult

SETTLE = "SETTLE"
PLAN = "PLAN"
REPLAN = "REPLAN"
DISPATCH_PLAN = "DISPATCH_PLAN"
PREEMPTED = "cancelled"  #: What a stage says that was preempted and has nothing to add.
ACHIEVED_MEANWHILE = "the goal holds"
NOT_DISPATCHED = DispatchResult(False)

#: Outcome of a stage → outcome of the request; aborted depends on the stage.
_VERDICTS = {
    "succeeded": Outcome.SUCCEEDED,
    "already_true": Outcome.ALREADY_TRUE,
    "refused": Outcome.REFUSED,
    "preempted": Outcome.CANCELLED,
    "unsolvable": Outcome.UNSOLVABLE,
    "no_plan": Outcome.NO_PLAN,
    "timeout": Outcome.PLANNER_TIMEOUT,
    "late": Outcome.LATE,
    "failed": Outcome.ACTION_FAILED,
    "cancel_timeout": Outcome.CANCEL_TIMEOUT,
}


_NO_PLAN = ("unsolvable", "no_plan", "timeout", "aborted")


class StageEnd(NamedTuple):
    """How a stage ended."""

    stage: str = ""
    outcome: str = ""
    """The SMACH outcome of the stage."""
    reason: str = ""
    gone: bool = False
    """A part of the planning system is gone."""


class Course:
    """One request on its way, or several that run together.

    :param max_replans: how often a failed plan is replaced in each run.
    :param same_failures, replan_wait: as of :class:`.replanning.Replanning`.
    """

    def __init__(
        self, max_replans: int, same_failures: int = SAME_FAILURES, replan_wait: float = REPLAN_WAIT
    ) -> None:
        self._limits = max_replans, same_failures, replan_wait
        self._replanning = Replanning(*self._limits)
        self._entered = 0.0
        self._earlier_replans = 0
        self.stage = ""
        """The stage under way, empty outside of a run."""
        self.stage_times: Dict[str, float] = {}
        """s for each stage, of all runs; replaced as a whole: answers are composed in other threads."""
        self.end = StageEnd()
        """How the last stage has ended."""
        self.dispatched = NOT_DISPATCHED
        """How the last dispatch of this run has ended."""
        self.may_move = False
        """Whether something may have moved: a plan was dispatched, or an earlier one was not at rest."""
        self.absence = Absence()
        """That of the planning system, over all runs."""
        self.unreachable = False
        """Whether the stage that ended last found a part of the planning system gone."""

    @property
    def replans(self) -> int:
        """New plans so far, of all runs."""
        return self._earlier_replans + self._replanning.count

    @property
    def replan_reason(self) -> str:
        """Why the last plan of this run was replaced, one sentence; empty when none was."""
        last = self._replanning.last
        return last.reason if last is not None and self.is_replan else ""

    @property
    def without(self) -> List[str]:
        """The actions that plans have to do without, as PDDL text with ``*`` for any argument."""
        return list(dict.fromkeys(failure.no_retry for failure in self._replanning.given_up))

    @property
    def is_replan(self) -> bool:
        """Whether a plan of this run has failed before."""
        return self._replanning.count > 0

    @classmethod
    def of(cls, courses: Sequence["Course"]) -> "Course":
        """The course of requests that run together from now on, each with a course of its own before.

        What one of them has given up, all do without.
        """
        made = cls(*courses[0]._limits)
        made.absence = courses[0].absence
        for course in courses:
            made.take_in(course)
        return made

    def take_in(self, other: "Course") -> None:
        """From now on it is that of another request, too, which has had one of its own."""
        self._earlier_replans = max(self._earlier_replans, other.replans)
        given_up = [*self._replanning.given_up, *other._replanning.given_up]
        self._replanning.given_up = list({failure.no_retry: failure for failure in given_up}.values())
        longer = {
            stage: max(seconds, self.stage_times.get(stage, 0.0))
            for stage, seconds in other.stage_times.items()
        }
        self.stage_times = {**self.stage_times, **longer}

    def begin(self) -> None:
        """A run begins: the first, or after an interruption."""
        self._earlier_replans = self.replans
        self._replanning = Replanning(*self._limits, self._replanning.given_up)
        self.end = StageEnd()
        self.stage = ""
        self.dispatched = NOT_DISPATCHED
        self.may_move = self.unreachable = False

    def enter(self, stage: str, now: float) -> None:
        """A stage begins; the empty name ends the run.

        :param now: s, of any clock.
        """
        if self.stage:
            seconds = self.stage_times.get(self.stage, 0.0) + now - self._entered
            self.stage_times = {**self.stage_times, self.stage: seconds}
        self.stage, self._entered = stage, now
        self.may_move = self.may_move or stage == DISPATCH_PLAN

    def ended(self, end: StageEnd) -> None:
        """A stage has ended; REPLAN only when the run ends with it."""
        self.end = end
        self.may_move = self.may_move or (end.stage == SETTLE and end.outcome != "succeeded")
        self.unreachable = end.gone or (end.stage == REPLAN and self.unreachable)

    def replan(self) -> ReplanDecision:
        """Whether the request is planned again after the stage that ended last."""
        end = self.end
        failed = (end.stage, end.outcome) == (DISPATCH_PLAN, "failed")
        if not failed and not (end.gone and end.outcome == "aborted"):
            return ReplanDecision(False, reason=end.reason)
        outdated = OUTDATED in end.reason  # behind the action, where one is named
        gone = end.gone or INTERFACE_GONE in end.reason
        last = self.dispatched
        failure = Failure(end.reason, last.action, gone, last.no_retry, outdated, last.of_robot)
        decision = self._replanning.failed(failure)
        if not decision.again:
            self.end = end._replace(reason=decision.reason)
        return decision

    def verdict(self) -> Verdict:
        """On the run, as the last stage has ended it."""
        end = self.end
        reason = end.reason
        if end.outcome == "aborted" or (end.gone and end.outcome == "failed"):
            outcome = Outcome.PLANNER_ERROR if end.stage == PLAN and not end.gone else Outcome.INTERNAL
        else:
            outcome = _VERDICTS[end.outcome]
        if outcome is Outcome.ALREADY_TRUE and self.is_replan:
            return Verdict(Outcome.SUCCEEDED, ACHIEVED_MEANWHILE)
        last = self._replanning.last
        given_up = self._replanning.given_up
        if end.stage == PLAN and end.outcome in _NO_PLAN and given_up and not end.gone:
            # What made the request fail is the action, not that there is no way round it.
            return Verdict(Outcome.ACTION_FAILED, _without_plan(given_up, reason), self.dispatched.action)
        if end.stage == PLAN and not outcome.achieved and last is not None:
            # "No other plan exists" is of little use without the failure that made another plan necessary.
            reason = f"{last.reason}; planned again: {reason}"
        action = "" if outcome.achieved else self.dispatched.action
        trouble = reason if outcome is Outcome.CANCELLED and end.gone and reason != PREEMPTED else ""
        return Verdict(outcome, reason, action, trouble)


def _without_plan(given_up: Sequence[Failure], reason: str) -> str:
    """Why a request failed that cannot be planned without what was given up.

    :param reason: the planner's.
    """
    reasons = "; ".join(dict.fromkeys(failure.reason for failure in given_up))
    return f"{reasons}; no plan without {'it' if len(given_up) == 1 else 'these'}: {reason}"
