# SPDX-License-Identifier: Apache-2.0
"""Why there is no plan: one smallest set of facts that would make one."""

from typing import List, NamedTuple, Optional, Sequence

from merlin_explain.claims import FACT, VALUE, Answer, Claim, Evidence, Words
from merlin_explain.core.judge import PROOF_LIMIT, Judge
from merlin_explain.core.other_plan import Found, cannot, impossible, said_by_planner, unproved
from merlin_explain.core.wording import and_list, plan_evidence, steps_count
from merlin_pddl.analysis.relaxed_state import CutOffError
from merlin_pddl.analysis.shortfall import Gap, Shortfall
from merlin_pddl.domain import Domain
from merlin_pddl.formula import Atom, Comparison, Condition, Fluent, Not, Number, to_pddl

#: The largest set that is looked for.
MOST = 6


class Missing(NamedTuple):
    """What is missing.

    :ivar gaps: the conditions that cannot be reached as things are.
    :ivar changes: conditions with which each goal can be reached; without any of them one cannot. Empty: no
        such set was found.
    """

    gaps: List[Gap]
    changes: List[Condition]
    known: bool = True
    """False: the time was over before that was known."""

    @property
    def texts(self) -> List[str]:
        """The changes as PDDL."""
        return [to_pddl(each) for each in self.changes]


def missing(judge: Judge) -> Missing:
    """Looks for a set of facts and values that no goal can do without."""
    try:
        found = _left(judge, ())
        changes: List[Condition] = []
        left = found
        while left and len(changes) < MOST:
            change = _change(left[0], judge.domain)
            if change is None or change in changes:
                return Missing(found, [])
            changes.append(change)
            left = _left(judge, changes)
        if left:
            return Missing(found, [])
        smaller: Optional[List[Condition]] = changes
        while smaller is not None:
            changes = smaller
            rests = ([each for each in changes if each != change] for change in changes)
            smaller = next((rest for rest in rests if not _left(judge, rest)), None) if found else None
    except CutOffError:
        return Missing([], [], known=False)
    return Missing(found, changes)


def _left(judge: Judge, changes: Sequence[Condition]) -> List[Gap]:
    """What is missing when something else holds, too."""
    short = Shortfall(judge.domain, judge.problem.changed(changes), PROOF_LIMIT)
    return [short.gap(goal) for goal in short.goals]


def _change(gap: Gap, domain: Domain) -> Optional[Condition]:
    """What closes a gap: a fact, its absence, or a value; None: nothing that can be named."""
    needed = gap.needed
    atom = needed.part if isinstance(needed, Not) else needed
    if isinstance(atom, Atom):
        return needed if atom.name in domain.predicates and atom.name not in domain.derived else None
    if not isinstance(needed, Comparison) or needed.op not in (">=", "<=", "="):
        return None
    settable = isinstance(needed.left, Fluent) and isinstance(needed.right, Number)
    return Comparison("=", needed.left, needed.right) if settable else None


def no_plan(
    judge: Judge,
    found: Found,
    lacking: Missing,
    then: Optional[Found],
    judge_then: Optional[Judge],
    words: Words,
) -> Answer:
    """Why goals have no plan.

    :param judge: of the problem; `judge_then` of the one with what is missing.
    :param found: what the planner finds as things are; `then` what it finds with what is missing.
    """
    if found.steps is not None and not judge.fault(found.steps):
        shown = Claim("plan", "This is the plan.", (plan_evidence(found.steps),))
        size = f"There is a plan, of {steps_count(found.steps)}."
        return Answer(size if found.steps else "The goals hold already.", (shown,))
    if not lacking.gaps:
        alone = " Each goal could be reached for itself, were nothing ever lost." if lacking.known else ""
        return Answer(f"I found no plan {unproved(found)}{alone}", (said_by_planner(found),))
    claims = [impossible(gap, words) for gap in lacking.gaps]
    sentence = f"There is no plan: {and_list([cannot(gap, words) for gap in lacking.gaps[:2]])}."
    if not lacking.changes or then is None:
        return Answer(sentence, tuple(claims))
    evidence = [Evidence(VALUE if text.startswith("(= ") else FACT, text) for text in lacking.texts]
    named = and_list([f"“{words.fact(text)}”" for text in lacking.texts])
    if len(evidence) > 1:
        claims.append(Claim("smallest", "None of these can be left out.", tuple(evidence)))
    if then.steps is None or judge_then is None or judge_then.fault(then.steps):
        text = f"With {named} each goal could be reached for itself, but no plan for all was found."
        return Answer(f"{sentence} {text}", (*claims, Claim("reachable", text, tuple(evidence))))
    text = f"With {named} there would be a plan of {steps_count(then.steps)}."
    if not then.steps:
        text = f"With {named} the goals would hold."
    claims.append(Claim("enough", text, (*evidence, plan_evidence(then.steps))))
    return Answer(f"{sentence} {text}", tuple(claims))
