# SPDX-License-Identifier: Apache-2.0
"""Checks plans of one problem, by two witnesses, says how good they are, and why there is none."""

from typing import List, Optional, Sequence

from merlin_pddl.analysis.demand import demand
from merlin_pddl.analysis.leave_out import leave_out
from merlin_pddl.analysis.plan_run import Outcome, PaperState, PlanRun, plan_fault
from merlin_pddl.analysis.relaxed_state import CutOffError
from merlin_pddl.analysis.shortfall import Gap, Shortfall
from merlin_pddl.checks.kairos_check import PlanQuality, PlanValidator
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import Condition, must_hold, numeric_text, to_pddl
from merlin_pddl.plan_text import PlanStep, call_text
from merlin_pddl.problem_reader import parse_condition, parse_problem

#: s of processor time for a proof that no plan exists.
PROOF_LIMIT = 1.0


class Judge:
    """What is true of plans for a problem.

    :param domain, problem: PDDL text.
    :raises PddlError: one cannot be read.
    :raises ValueError: the validator cannot read it.
    """

    def __init__(self, domain: str, problem: str) -> None:
        self._texts = domain, problem
        self.domain = parse_domain(domain)
        self.problem = parse_problem(problem, self.domain, constraints=True)
        self._validator = PlanValidator(domain, problem)

    def read(self, goal: str) -> List[Condition]:
        """The single conditions of a goal in PDDL.

        :raises PddlError: it is not PDDL, or names what the problem does not have.
        """
        known = self.problem.typed(self.domain.constants)
        return must_hold(parse_condition(goal, self.domain, known, "the question"))

    def run(self, steps: Sequence[PlanStep]) -> Outcome:
        """A plan on paper.

        :raises PlanRunError: a step is no action of the domain.
        """
        return PlanRun(self.domain, self.problem, steps).run()

    def fault(self, steps: Sequence[PlanStep]) -> str:
        """What is wrong with a plan, for either witness; empty: nothing."""
        return plan_fault(self.domain, self.problem, steps) or self.checked(steps)

    def checked(self, steps: Sequence[PlanStep]) -> str:
        """What is wrong with a plan for the validator, that of kairos if there is one; empty: nothing."""
        return self._validator.fault(steps) or ""

    def quality(self, steps: Sequence[PlanStep]) -> PlanQuality:
        """How good a plan is."""
        return self._validator.quality(steps)

    @property
    def judged_by(self) -> str:
        """What plans are judged by, as PDDL; empty: their time."""
        metric = self.problem.metric
        text = "" if metric is None else to_pddl(metric.value)
        return "" if text == "(total-time)" else text

    def cost(self, quality: PlanQuality) -> float:
        """What a plan costs by that; the smaller is better."""
        return quality.makespan if quality.metric is None or not self.judged_by else quality.metric

    def effects(self, steps: Sequence[PlanStep]) -> List[str]:
        """What a plan changes, as facts and values in PDDL."""
        before, after = PaperState(self.domain, self.problem), self.run(steps).state
        changes = [call_text(key[0], key[1:]) for key in sorted(after.facts - before.facts)]
        changes += [f"(not {call_text(key[0], key[1:])})" for key in sorted(before.facts - after.facts)]
        for key, value in sorted(after.values.items()):
            if before.values.get(key) != value:
                changes.append(f"(= {call_text(key[0], key[1:])} {numeric_text(value)})")
        return changes

    def gap(self, include: Sequence[str] = (), without: Sequence[str] = ()) -> Optional[Gap]:
        """A goal that no action can reach, and what is missing for it: a proof without the planner.

        :param include, without: actions that the plan has to have, and must not have.
        :return: None: nothing is proved.
        """
        domain, problem = self._texts
        if without:
            domain, problem = leave_out(domain, problem, list(without))
        domain, done = demand(domain, self.problem.objects, include)
        model = parse_domain(domain)
        task = parse_problem(problem, model, constraints=True)
        task.goals += done
        try:
            found = Shortfall(model, task, PROOF_LIMIT)
            return found.gap(found.goals[0]) if found.goals else None
        except CutOffError:
            return None
