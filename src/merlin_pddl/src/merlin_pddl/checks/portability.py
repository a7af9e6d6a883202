# SPDX-License-Identifier: Apache-2.0
"""What is valid here and yet seldom meant, or not read by other parsers."""

from typing import Dict, Iterator, List, Set

from merlin_pddl.domain_reader import open_definition
from merlin_pddl.formula_reader import TRAJECTORY, groups
from merlin_pddl.text_reader import Expression, Node, Word, read_expression, suggestion
from merlin_pddl.type_hierarchy import OBJECT

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
    kind = (root[1].head if len(root) > 1 else "") or "domain"
    _, sections = open_definition(root, kind)
    found: List[str] = []
    for section in sections:
        found.extend(
            f"{_place(name)}: warning: '{name}' is a keyword of PDDL: parsers such as VAL's, POPF's and "
            "ROSPlan's do not read it as a name"
            for name in _names(section)
            if name.lstrip("?") in KEYWORDS
        )
        if section.head == ":goal" and len(section) == 2 and section[1] in ([], ["and"]):
            found.append(f"{_place(section)}: warning: the goal is empty: POPF and ROSPlan refuse it")
    return found


def misspelt_supertypes(text: str, source: str) -> List[str]:
    """Supertypes that are declared nowhere and look like a type that is; PDDL allows them.

    :param text, source: as of :func:`warnings`.
    :raises PddlError: it is not a domain.
    """
    _, sections = open_definition(read_expression(text, source), "domain")
    declared: Set[str] = {OBJECT}
    parents: List[Word] = []
    for section in sections:
        for names, kinds in groups(section[1:] if section.head == ":types" else []):
            declared.update(_words(names))
            parents.extend(_words(kinds))
    return [
        f"{_place(word)}: warning: the type '{word}' is declared nowhere{hint}"
        for word in parents
        for hint in [suggestion(str(word), declared)]
        if word not in declared and hint
    ]


def declared_twice(text: str, source: str) -> List[str]:
    """Objects of a problem that are declared more than once; allowed, an object then has all of the types.

    :param text, source: as of :func:`warnings`.
    :raises PddlError: it is not a problem.
    """
    _, sections = open_definition(read_expression(text, source), "problem")
    first: Dict[str, Word] = {}
    found: List[str] = []
    for section in sections:
        listed = groups(section[1:] if section.head == ":objects" else [])
        for node in _words([name for names, _ in listed for name in names]):
            if first.setdefault(str(node), node) is not node:
                before = first[str(node)]
                found.append(
                    f"{_place(node)}: warning: '{node}' is declared in line {before.line} already; "
                    "it has the types of both"
                )
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
