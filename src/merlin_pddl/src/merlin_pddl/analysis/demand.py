# SPDX-License-Identifier: Apache-2.0
"""A planning task whose plans have to contain some ground actions, as PDDL that every planner reads.

Each operator concerned gets an effect that says that it was done, and that is a goal.
"""

from typing import Dict, List, Mapping, Sequence, Tuple

from merlin_pddl.analysis.leave_out import action_of, declare, extend_action
from merlin_pddl.domain_reader import DomainReader
from merlin_pddl.formula import Atom, Condition
from merlin_pddl.problem import Problem
from merlin_pddl.text_reader import read_expression

#: Begins the predicates that say which actions were done.
DONE = "was-done-"


def demand(
    domain: str, objects: Mapping[str, Tuple[str, ...]], actions: Sequence[str]
) -> Tuple[str, List[Condition]]:
    """The domain as text whose actions leave a mark, and the goals that the actions were done.

    :param domain: PDDL text.
    :param objects: of the problem with their types, names in lower case.
    :param actions: ground actions as PDDL text.
    :raises PddlError: the text is not PDDL, or an action is not one of the domain with such objects.
    """
    node = read_expression(domain, "domain")
    model = DomainReader(read_expression(domain, "domain")).read()
    known = Problem("", "", dict(objects)).typed(model.constants)
    goals: List[Condition] = []
    marks: Dict[str, str] = {}
    for text in actions:
        operator, names = action_of(text, model, known)
        for name, parameter in zip(names, operator.parameters):
            if not model.accepts(parameter.types, known[name]):
                wanted = " or ".join(parameter.types)
                raise name.error(f"'{name}' is no {wanted}, as {parameter.name} has to be")
        if operator.name not in marks:
            marks[operator.name], atom = declare(node, DONE, operator)
            extend_action(node, operator, ":effect", f"(at end {atom})" if operator.durative else atom)
        goals.append(Atom(marks[operator.name], tuple(map(str, names))))
    return node.text(), goals
