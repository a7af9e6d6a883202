# SPDX-License-Identifier: Apache-2.0
"""Adds robots to a domain and a problem that were written for one robot. Without ROS."""

import re
from typing import Iterator, List, Sequence, Tuple

from merlin_pddl.text_reader import Expression, Node, Word, line_starts, read_expression

VARIABLE = "?r"
AT = "robot_at"
_ACTIONS = (":action", ":durative-action")
_CONDITIONS = {":condition": "(at start (available ?r))", ":precondition": "(available ?r)"}


def with_robots(
    domain: str, problem: str, robots: Sequence[str], sources: Tuple[str, str]
) -> Tuple[str, str]:
    """A domain and its problem with a robot in each operator and in ``robot_at``; comments stay.

    All robots begin where the only one did. An operator asks that its robot is available.

    :param sources: names of the files, for errors.
    :raises PddlError: where that is not clear; the text says what to write by hand.
    """
    return _domain(_Text(domain, sources[0])), _problem(_Text(problem, sources[1]), robots)


class _Text:
    """PDDL text, and what is inserted into it."""

    def __init__(self, text: str, source: str) -> None:
        self.root = read_expression(text, source)
        self._text = text
        self._lines = line_starts(text)
        self._found: List[Tuple[int, str]] = []

    def before(self, node: Node, text: str) -> None:
        """Inserts a text before a node."""
        self._found.append((self._place(node), text))

    def inside(self, node: Expression, text: str) -> None:
        """Inserts a text behind the opening parenthesis of a node."""
        self._found.append((self._place(node) + 1, text))

    def around(self, node: Expression, begin: str, end: str) -> None:
        """Inserts texts before and behind a node."""
        depth, first = 0, self._place(node)
        for found in re.finditer(r";[^\n\r]*|[()]", self._text[first:]):
            depth += {"(": 1, ")": -1}.get(found.group(), 0)
            if not depth:
                self._found += [(first, begin), (first + found.end(), end)]
                return

    def after(self, word: Node, text: str) -> None:
        """Inserts a text behind a word."""
        assert isinstance(word, Word)
        self._found.append((self._place(word) + len(word.written), text))

    def _place(self, node: Node) -> int:
        return self._lines[node.line - 1] + node.column - 1

    def section(self, name: str) -> Expression:
        """The part of a name.

        :raises PddlError: when there is none.
        """
        for part in self.root[1:]:
            if isinstance(part, Expression) and part.head == name:
                return part
        raise self.root.error(f"there is no ({name} …), to which --robots would add the robots; write one")

    def written(self) -> str:
        """The text with all insertions."""
        text = self._text
        for place, added in sorted(self._found, reverse=True):
            text = text[:place] + added + text[place:]
        return text


def _domain(text: _Text) -> str:
    text.after(text.section(":types")[0], "\n    robot - object")
    predicates = text.section(":predicates")
    for found in _with_head(predicates, "available"):
        raise found.error(
            "(available …) is what --robots adds, of a robot; call this predicate something else"
        )
    text.after(predicates[0], "\n    (available ?r - robot)")
    for part in text.root[1:]:
        if not isinstance(part, Expression):
            continue
        places = list(_with_head(part, AT))
        if part.head in _ACTIONS:
            _operator(text, part)
        elif places and part.head == ":predicates":
            text.after(places[0][0], f" {VARIABLE} - robot")
        elif places:
            raise places[0].error(
                f"{AT} in ({part.head} …): write the robot there by hand, and leave --robots out"
            )
    return text.written()


def _operator(text: _Text, operator: Expression) -> None:
    fields = dict(zip(operator[2::2], operator[3::2]))
    parameters = fields.get(Word(":parameters"))
    if not isinstance(parameters, Expression):
        raise operator.error(f"{operator[1]} has no :parameters (…)")
    if VARIABLE in parameters:
        raise parameters.error(
            f"{operator[1]} has a {VARIABLE} already, as --robots calls the robot; rename it"
        )
    text.inside(parameters, f"{VARIABLE} - robot{' ' if parameters else ''}")
    for found in _with_head(operator, AT):
        text.after(found[0], f" {VARIABLE}")
    name = ":precondition" if operator.head == ":action" else ":condition"
    condition, asked = _CONDITIONS[name], fields.get(Word(name))
    if not isinstance(asked, Expression):
        text.around(parameters, "", f"\n    {name} {condition}")
    elif asked.head == "and":
        text.after(asked[0], f" {condition}")
    elif not asked:
        text.inside(asked, f"and {condition}")
    else:
        text.around(asked, f"(and {condition} ", ")")


def _problem(text: _Text, robots: Sequence[str]) -> str:
    text.after(text.section(":objects")[0], f"\n    {' '.join(robots)} - robot")
    text.after(text.section(":init")[0], "".join(f"\n    (available {robot})" for robot in robots))
    for found in _with_head(text.section(":init"), AT):
        words = " ".join(str(word) for word in found[1:])
        text.before(found, "".join(f"({AT} {robot} {words})\n    " for robot in robots[:-1]))
        text.after(found[0], f" {robots[-1]}")
    for found in _with_head(text.section(":goal"), AT):
        raise found.error(
            f"the goal {found.text()} does not say which robot; take it out, or add the robots by hand"
        )
    return text.written()


def _with_head(node: Expression, head: str) -> Iterator[Expression]:
    for part in node:
        if isinstance(part, Expression):
            if part.head == head:
                yield part
            yield from _with_head(part, head)
