# SPDX-License-Identifier: Apache-2.0
"""Which numbers keep actions of a problem from running: those without a value, and negative durations."""

import time
from typing import Dict, Iterator, List, Tuple

from merlin_pddl.analysis.reachability import Reachability, conditions_of
from merlin_pddl.analysis.relaxed_state import CutOffError
from merlin_pddl.domain import Domain, Operator, open_advice, open_terms
from merlin_pddl.evaluation import key_of
from merlin_pddl.formula import START, Comparison, Fluent, terms
from merlin_pddl.plan_text import call_text
from merlin_pddl.problem import Problem

#: How many missing values of a function are named.
NAMED = 3
LIMIT = 2.0
"""s of processor time for the analysis."""
CUT_OFF = "values of functions were not looked at: the problem is too large for it"


def missing_values(domain: Domain, problem: Problem, limit: float = LIMIT) -> List[str]:
    """One sentence for each operator and function; values that an action may set before are not missing.

    Likewise one for each operator whose duration is negative.

    :param limit: s of processor time of this thread.
    """
    reach = Reachability(domain, problem, time.thread_time() + limit)
    found: Dict[Tuple[str, str], Dict[str, None]] = {}
    negative: Dict[str, str] = {}  # of an operator: its first action with such a duration
    try:
        reach.run()
        for operator in domain.operators.values():
            needed = conditions_of(operator)
            plain = [condition for condition in needed if not isinstance(condition, Comparison)]
            fluents = list(dict.fromkeys(_read(operator)))
            longest = [duration.value for duration in operator.durations if duration.op != ">="]
            for bindings in reach.state.matches(operator.parameters, plain):
                for value in longest:
                    seconds = reach.state.range(value, bindings)
                    if seconds is not None and seconds.high < 0.0:
                        names = [bindings[each.name] for each in operator.parameters]
                        action = call_text(operator.name, names)
                        negative.setdefault(operator.name, f"{action} lasts {seconds.high:g} s")
                for fluent in fluents:
                    key = key_of(fluent, bindings)
                    # From a place to itself is nothing to drive.
                    if key not in reach.state.values and len(set(key)) == len(key):
                        found.setdefault((operator.name, fluent.name), {})[f"({' '.join(key)})"] = None
    except CutOffError:
        return [CUT_OFF]
    said = [
        f"operator {name} has a negative duration: {text}, so no plan can use it there; correct its "
        ":duration in the domain, or the value in :init of the problem"
        for name, text in negative.items()
    ]
    for (name, _), texts in found.items():
        named = sorted(texts)[:NAMED]
        more = f" and {len(texts) - NAMED} more" if len(texts) > NAMED else ""
        said.append(
            f"operator {name} needs the value of {', '.join(named)}{more}: no plan can use it there; "
            f"write (= {named[0]} …) into :init of the problem, or have a node set it"
        )
    return said


def open_durations(domain: Domain, at_start: bool) -> List[str]:
    """Effects whose numbers depend on a duration that the domain leaves open; one sentence for each operator.

    :param at_start: effects at start: their actions are refused; else those that are not foreseen.
    """
    what = " cannot start" if at_start else ": while it runs, no plan can be made that follows it"
    found: Dict[str, str] = {}
    for operator in domain.operators.values():
        for effect in operator.effects:
            target = effect.fluent
            for term in open_terms(operator, effect) if (effect.when == START) == at_start else ():
                advice = open_advice(effect, term)
                text = f"operator {operator.name}{what}: its effect on {target and target.name}: {advice}"
                found.setdefault(operator.name, text)
    return list(found.values())


def _read(operator: Operator) -> Iterator[Fluent]:
    """The functions whose values an operator needs before it can run."""
    names = {variable.name for variable in operator.parameters}
    for formula in conditions_of(operator):
        for term in terms(formula):
            # One with a variable of a quantifier is none of a ground action.
            if isinstance(term, Fluent) and {a for a in term.args if a[0] == "?"} <= names:
                yield term
