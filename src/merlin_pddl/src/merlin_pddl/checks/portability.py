"""What other parsers do not read although it is valid here: keywords as names, and an empty goal."""

from typing import Iterator, List

from merlin_pddl.domain_reader import open_definition
from merlin_pddl.formula_reader import TRAJECTORY
from merlin_pddl.text_reader import Expression, Node, Word, read_expression

#: Words with a meaning of their own in PDDL. ``at`` is not among them: every parser takes it as a predicate.
KEYWORDS = TRAJECTORY | {
    *("and", "or", "not", "imply", "forall", "exists", "when", "either", "preference", "is-violated"),
    *("increase", "decrease", "assign", "scale-up", "scale-down"),
    *("over", "all", "start", "end", "duration", "total-time"),
    *("define", "domain", "problem", "minimize", "maximize"),
}


def warnings(text: str, source: str) -> List[str]:
    """What parsers such as VAL's, POPF's and ROSPlan's refuse in a domain or a problem.

    :param text: PDDL that our reader accepts.
    :param source: name of the file.
    :raises PddlError: it is not a definition.
    """
    root = read_expression(text, source)
    kind = root[1].head if len(root) > 1 and isinstance(root[1], Expression) else "domain"
    _, sections = open_definition(root, kind)
    found: List[str] = []
    for section in sections:
        found.extend(
            f"{_place(name)}: warning: '{name}' is a keyword of PDDL: parsers such as VAL's, POPF's and "
            "ROSPlan's do not read it as a name"
            for name in _names(section)
            if name.lstrip("?") in KEYWORDS
        )
        if section.head == ":goal" and len(section) == 2 and _empty(section[1]):
            found.append(f"{_place(section)}: warning: the goal is empty: POPF and ROSPlan refuse it")
    return found


def _place(node: Node) -> str:
    return f"{node.source}:{node.line}:{node.column}"


def _names(section: Expression) -> Iterator[Word]:
    """The words that a section declares, parameters included."""
    if section.head in (":types", ":constants", ":objects"):
        yield from _words(section[1:])
    elif section.head in (":predicates", ":functions"):
        for node in section[1:]:
            if isinstance(node, Expression):
                yield from _words(node)
    elif section.head in (":action", ":durative-action", ":process", ":event"):
        yield from _words(section[1:2])
        for key, value in zip(section[2:], section[3:]):
            if key == ":parameters" and isinstance(value, Expression):
                yield from _words(value)


def _words(nodes: List[Node]) -> Iterator[Word]:
    return (node for node in nodes if isinstance(node, Word))


def _empty(goal: Node) -> bool:
    return isinstance(goal, Expression) and (not goal or (goal.head == "and" and len(goal) == 1))
