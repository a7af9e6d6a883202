# SPDX-License-Identifier: Apache-2.0
"""What an action declares for its run and its interruption: literals and numeric effects. Pure."""

import re
from typing import List, Mapping, Sequence, Tuple

from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import ASSIGNMENTS
from merlin_pddl.formula_reader import IN_CONTINUOUS, FormulaReader
from merlin_pddl.text_reader import Expression, PddlError, read_expression

_NUMERIC = re.compile(r"\s*\(\s*(assign|increase|decrease|scale-up|scale-down)(?=[\s(;])", re.IGNORECASE)
_VARIABLE = re.compile(r"\?([A-Za-z_][\w-]*)")
#: The planned duration, a variable of PDDL's own.
DURATION = "duration"


def numeric_apart(texts: Sequence[str]) -> Tuple[List[str], List[str]]:
    """Literals, and numeric effects such as ``(decrease (battery) (* 0.1 #t))``."""
    numeric = [text for text in texts if _NUMERIC.match(text)]
    return [text for text in texts if text not in numeric], numeric


def bound(text: str, binding: Mapping[str, str]) -> str:
    """A numeric effect with objects for its variables, in any case; ``?duration`` stays.

    :raises ValueError: for a variable that is not bound.
    """
    objects = {name.lower(): value for name, value in binding.items()}

    def replace(match: "re.Match[str]") -> str:
        name = match.group(1)
        if name.lower() == DURATION:
            return match.group(0)
        if name.lower() not in objects:
            raise ValueError(f"{text!r}: nothing is bound to ?{name}")
        return objects[name.lower()]

    return _VARIABLE.sub(replace, text)


def declared_fault(text: str, operator: str, domain: Domain, objects: Mapping[str, Tuple[str, ...]]) -> str:
    """What is wrong with a literal or a numeric effect that an operator's class declares; empty: nothing.

    :param objects: of the problem -> their types.
    """
    known = domain.operators.get(operator.lower())
    if known is None:
        return ""
    scope = {variable.name: variable.types for variable in known.parameters}
    reader = FormulaReader(domain, dict(objects))
    try:
        node = read_expression(text, "")
        if node.head in ASSIGNMENTS and node.head not in domain.predicates:
            if len(node) != 3:
                raise node.error(f"'{node.head}' takes a function and a value")
            reader.fluent(node[1], scope)
            reader.numeric(node[2], {**scope, **IN_CONTINUOUS})
        else:
            negated = node.head == "not" and len(node) == 2
            part = node[1] if negated else node
            reader.atom(part if isinstance(part, Expression) else node, scope)
    except PddlError as error:
        return error.message
    return ""
