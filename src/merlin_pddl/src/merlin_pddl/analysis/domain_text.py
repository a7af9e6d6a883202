# SPDX-License-Identifier: Apache-2.0
"""The text of a domain as an expression that is changed and written again."""

import itertools
from typing import Collection, Iterable, Set

from merlin_pddl.text_reader import Expression, Node, Word, read_expression


def section(node: Expression, head: str) -> Expression:
    """A section of a domain; made behind its name, requirements, types and constants when it has none."""
    for found in node:
        if isinstance(found, Expression) and found.head == head:
            return found
    made = read_expression(f"({head})")
    order = (":requirements", ":types", ":constants")
    behind = order[: order.index(head)] if head in order else order
    place = 2
    while place < len(node) and node[place].head in behind:
        place += 1
    node.insert(place, made)
    return made


def unused(name: str, used: Collection[str]) -> str:
    """A name that is not used yet: this one, or with a number behind it."""
    numbered = (f"{name}-{number}" for number in itertools.count(1))
    return next(each for each in itertools.chain([name], numbered) if each not in used)


def words(nodes: Iterable[Node]) -> Set[str]:
    """All words of expressions, at any depth."""
    found: Set[str] = set()
    for node in nodes:
        found |= words(node) if isinstance(node, Expression) else {str(node)}
    return found


def require(node: Expression, requirements: Iterable[str]) -> None:
    """Adds requirements to a domain that it does not state."""
    stated = section(node, ":requirements")
    stated.extend(Word.at(name, "", 0, 0) for name in requirements if name not in stated[1:])
