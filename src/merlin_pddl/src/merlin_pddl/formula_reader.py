# SPDX-License-Identifier: Apache-2.0
"""Reads typed lists, conditions and numeric expressions, checking every name against the domain."""

import math
import re
from typing import Dict, Iterator, List, Mapping, Sequence, Set, Tuple, Union

from merlin_pddl.domain import Domain, Signature
from merlin_pddl.formula import (
    END,
    OVER_ALL,
    START,
    And,
    Arithmetic,
    Atom,
    Comparison,
    Condition,
    Equal,
    Exists,
    Fluent,
    Forall,
    Not,
    Number,
    Numeric,
    Or,
    Preference,
    Special,
    TimedCondition,
    Variable,
    preferences,
)
from merlin_pddl.text_reader import NUMBER, Expression, Node, Word, is_name, is_variable, name_of, suggestion

COMPARISONS = (">", ">=", "<", "<=", "=")
ARITHMETIC = ("+", "-", "*", "/")
TIMES = {("at", "start"): START, ("over", "all"): OVER_ALL, ("at", "end"): END}
#: The trajectory constraints of PDDL 3 that carry a name of their own.
TRAJECTORY = {"always", "sometime", "at-most-once", "sometime-after", "sometime-before", "within"}
TRAJECTORY |= {"hold-after", "hold-during", "always-within"}
#: What to do with one that stands in a condition.
IN_CONSTRAINTS = (
    "is a trajectory constraint: a condition is about one moment; "
    "write it into (:constraints ...) of the domain, which every plan then obeys"
)

#: Variables with their types, and the special values that may be named, which have none.
Scope = Mapping[str, Tuple[str, ...]]

#: Special value -> where it may stand.
SPECIALS = {
    "#t": "in the continuous effects of durative actions",
    "?duration": "in durative actions",
    "total-time": "in a metric",
    "is-violated": "in a metric",
}
IN_DURATIVE: Scope = {"?duration": ()}
IN_CONTINUOUS: Scope = {"?duration": (), "#t": ()}
IN_METRIC: Scope = {"total-time": (), "is-violated": ()}


def typed_list(nodes: Sequence[Node], domain: Domain, variables: bool) -> List[Tuple[Word, Tuple[str, ...]]]:
    """Reads ``a b - type c - (either d e) f``.

    :raises PddlError: a word is not a name (or no variable, when those are asked for), or a type is unknown.
    """
    found: List[Tuple[Word, Tuple[str, ...]]] = []
    for names, kinds in groups(nodes):
        words = _variables(names) if variables else [name_of(node, "a name") for node in names]
        types = tuple(dict.fromkeys(_type(kind, domain) for kind in kinds)) or ("object",)
        found.extend((word, types) for word in words)
    return found


def groups(nodes: Sequence[Node]) -> Iterator[Tuple[List[Node], List[Node]]]:
    """What stands together before a ``-``, and the types behind that; at the end what has none.

    :raises PddlError: something is missing at a ``-``, or neither a word nor ``(either a b)`` is behind it.
    """
    waiting: List[Node] = []
    rest = iter(nodes)
    for node in rest:
        if node != "-":
            waiting.append(node)
            continue
        kind = next(rest, None)
        if kind is None or not waiting:
            raise node.error("'-' needs a name before it and a type after it")
        if isinstance(kind, Expression) and (kind.head != "either" or len(kind) < 2):
            raise kind.error(f"expected a type or (either ...), found '{kind.text()[:40]}'")
        yield waiting, kind[1:] if isinstance(kind, Expression) else [kind]
        waiting = []
    yield waiting, []


def _variables(nodes: Sequence[Node]) -> List[Word]:
    found: List[Word] = []
    for node in nodes:
        if not isinstance(node, Word) or not is_variable(node):
            shown = node.text()[:40] if isinstance(node, Expression) else node
            before = found[-1] if found else ""
            hint = f"; write a blank before the '-' of '{before}'" if before.endswith("-") else ""
            raise node.error(f"expected a variable such as '?x', found '{shown}'{hint}")
        found.append(node)
    return found


def _type(node: Node, domain: Domain) -> str:
    name = name_of(node, "a type")
    if name not in domain.types:
        raise name.error(f"unknown type '{name}'" + suggestion(name, domain.types))
    return str(name)


def preference_names(node: Node) -> Set[str]:
    """The names of the preferences that stand in an expression."""
    if not isinstance(node, Expression):
        return set()
    own = {str(node[1])} if node.head == "preference" and len(node) == 3 else set()
    return own.union(*map(preference_names, node))


def preference_name(node: Expression) -> str:
    """The name of a preference; empty when it has none.

    :raises PddlError: it is not ``(preference [<name>] <condition>)``.
    """
    if len(node) not in (2, 3):
        raise node.error(f"'preference' takes a name and a condition, here are {len(node) - 1} part(s)")
    return str(name_of(node[1], "the name of a preference")) if len(node) == 3 else ""


def parameters(node: Node, domain: Domain, what: str) -> Tuple[Variable, ...]:
    """Reads a list of typed variables in parentheses.

    :raises PddlError: when it is not a list of variables, or one stands there twice.
    """
    if not isinstance(node, Expression):
        raise node.error(f"expected the parameters of {what} in parentheses, found '{node}'")
    found: Dict[str, Variable] = {}
    for word, types in typed_list(node, domain, variables=True):
        if word in found:
            raise word.error(f"'{word}' stands twice among the parameters of {what}")
        found[str(word)] = Variable(str(word), types)
    return tuple(found.values())


class FormulaReader:
    """Reads formulas over a domain.

    :param domain: knows the predicates, functions and constants.
    :param objects: further objects that may be named (those of a problem), with their types.
    """

    def __init__(self, domain: Domain, objects: Union[Scope, None] = None) -> None:
        self._domain = domain
        self._objects: Scope = objects if objects is not None else {}

    def condition(self, node: Node, scope: Scope) -> Condition:
        """Reads a condition; `scope` holds the variables that may stand in it.

        :raises PddlError: it is malformed or names something unknown.
        """
        if not isinstance(node, Expression):
            raise node.error(f"expected a condition in parentheses, found '{node}'")
        head = node.head
        if not node:
            return And()
        if head in ("and", "or"):
            parts = tuple(self.condition(part, scope) for part in node[1:])
            return And(parts) if head == "and" else Or(parts)
        if head == "not":
            return Not(self._plain(self._rest(node, 1)[0], scope, "negated"))
        if head == "imply":
            first, second = self._rest(node, 2)
            return Or((Not(self._plain(first, scope, "negated")), self.condition(second, scope)))
        if head in ("forall", "exists"):
            declared, part = self._rest(node, 2)
            variables = parameters(declared, self._domain, f"'{head}'")
            inner = {**scope, **{v.name: v.types for v in variables}}
            body = self.condition(part, inner)
            return Forall(variables, body) if head == "forall" else Exists(variables, body)
        if head == "preference":
            return Preference(preference_name(node), self._plain(node[-1], scope, "part of another"))
        if head in COMPARISONS:
            return self._comparison(node, scope)
        return self.atom(node, scope)

    def _plain(self, node: Node, scope: Scope, what: str) -> Condition:
        found = self.condition(node, scope)
        if preferences(found):
            raise node.error(f"a preference cannot be {what}")
        return found

    def timed_condition(self, node: Node, scope: Scope) -> List[TimedCondition]:
        """Reads the condition of a durative action; a quantifier may stand outside of the time.

        :raises PddlError: as `condition`, or a part has no time.
        """
        if not isinstance(node, Expression):
            raise node.error(f"expected a condition in parentheses, found '{node}'")
        if not node:
            return []
        if node.head == "and":
            return [found for part in node[1:] for found in self.timed_condition(part, scope)]
        if node.head == "forall":
            declared, part = self._rest(node, 2)
            variables = parameters(declared, self._domain, "'forall'")
            inner = {**scope, **{v.name: v.types for v in variables}}
            return [
                TimedCondition(found.when, Forall(variables, found.condition))
                for found in self.timed_condition(part, inner)
            ]
        if node.head == "preference":
            preference_name(node)
            self.timed_condition(node[-1], scope)
            return []
        time = self.time_of(node)
        if not time:
            raise node.error("expected (at start ...), (over all ...) or (at end ...)")
        return [TimedCondition(time, self.condition(node[2], scope))]

    @staticmethod
    def time_of(node: Expression) -> str:
        """START, OVER_ALL or END when the expression is ``(at start x)`` and so on, else an empty text."""
        if len(node) == 3 and isinstance(node[1], Word):
            return TIMES.get((node.head, str(node[1])), "")
        return ""

    def _comparison(self, node: Expression, scope: Scope) -> Condition:
        left, right = self._rest(node, 2)
        if node.head == "=" and not self._numeric(left) and not self._numeric(right):
            return Equal(self.term(left, scope), self.term(right, scope))
        return Comparison(node.head, self.numeric(left, scope), self.numeric(right, scope))

    @staticmethod
    def _numeric(node: Node) -> bool:
        return isinstance(node, Expression) or node in SPECIALS or number_of(node) is not None

    def atom(self, node: Node, scope: Scope) -> Atom:
        """Reads a predicate with its arguments.

        :raises PddlError: the predicate is unknown, or its arguments do not fit.
        """
        if not isinstance(node, Expression) or not node:
            raise node.error("expected a predicate in parentheses")
        name = name_of(node[0], "a predicate")
        known = self._domain.predicates
        if name not in known:
            if name in TRAJECTORY:
                raise name.error(f"'{name}' {IN_CONSTRAINTS}")
            hint = " (it is a function)" if name in self._domain.functions else suggestion(name, known)
            raise name.error(f"unknown predicate '{name}'{hint}")
        return Atom(str(name), self._arguments(node, known[str(name)], scope))

    def literal(self, node: Expression, scope: Scope, derived: str) -> Tuple[Atom, bool]:
        """Reads a predicate that is stated or changed, and whether it stands in a ``not``.

        :param derived: why it may not be a derived one.
        :raises PddlError: as :meth:`atom`, or it is derived.
        """
        negative = node.head == "not"
        if negative and len(node) != 2:
            raise node.error("'not' takes 1 part")
        atom = self.atom(node[1] if negative else node, scope)
        if atom.name in self._domain.derived:
            raise node.error(f"'{atom.name}' is derived: {derived}")
        return atom, negative

    def fluent(self, node: Node, scope: Scope) -> Fluent:
        """Reads a numeric function with its arguments.

        :raises PddlError: the function is unknown, or its arguments do not fit.
        """
        parts = node if isinstance(node, Expression) else [node]
        if not parts:
            raise node.error("expected a function")
        name = name_of(parts[0], "a function")
        known = self._domain.functions
        if name not in known:
            raise name.error(f"unknown function '{name}'" + suggestion(name, known))
        if isinstance(node, Word):
            if known[str(name)].parameters:
                raise name.error(f"the function '{name}' needs parentheses and arguments")
            return Fluent(str(name))
        return Fluent(str(name), self._arguments(node, known[str(name)], scope))

    def numeric(self, node: Node, scope: Scope) -> Numeric:
        """Reads a numeric expression.

        :raises PddlError: it is malformed or names something unknown.
        """
        head = str(node) if isinstance(node, Word) else node.head
        if head in SPECIALS:
            return self._special(node, head, scope)
        if isinstance(node, Word):
            value = number_of(node)
            return self.fluent(node, scope) if value is None else Number(value)
        if node.head in ARITHMETIC:
            parts = tuple(self.numeric(part, scope) for part in node[1:])
            if not parts or (len(parts) == 1 and node.head != "-") or (len(parts) > 2 and node.head in "-/"):
                raise node.error(f"'{node.head}' with {len(parts)} operand(s)")
            return Arithmetic(node.head, parts)
        return self.fluent(node, scope)

    @staticmethod
    def _special(node: Node, name: str, scope: Scope) -> Special:
        if name not in scope:
            raise node.error(f"'{name}' can only stand {SPECIALS[name]}")
        args = node[1:] if isinstance(node, Expression) else []
        wanted = 1 if name == "is-violated" else 0
        if len(args) != wanted:
            raise node.error(f"'{name}' takes {wanted} argument(s), here are {len(args)}")
        return Special(name, tuple(str(name_of(arg, "the name of a preference")) for arg in args))

    def term(self, node: Node, scope: Scope) -> str:
        """Reads a variable or the name of an object.

        :raises PddlError: it is unknown.
        """
        if not isinstance(node, Word):
            raise node.error(f"expected a variable or an object, found '{node.text()[:40]}'")
        if node.startswith("?"):
            if not scope.get(str(node)):  # a special value is not an object
                raise node.error(f"unknown variable '{node}'" + suggestion(node, scope))
        elif node not in self._domain.constants and node not in self._objects:
            if not is_name(node):
                raise node.error(f"expected a variable or an object, found '{node}'")
            known: Set[str] = set(self._domain.constants) | set(self._objects)
            raise node.error(f"unknown object '{node}'" + suggestion(node, known))
        return str(node)

    def types_of(self, term: str, scope: Scope) -> Tuple[str, ...]:
        """Types of a known term."""
        if term.startswith("?"):
            return scope[term]
        return self._domain.constants.get(term, ()) + tuple(self._objects.get(term, ()))

    def _arguments(self, node: Expression, signature: Signature, scope: Scope) -> Tuple[str, ...]:
        wanted = signature.parameters
        if len(node) - 1 != len(wanted):
            raise node.error(f"'{signature.name}' takes {len(wanted)} argument(s), here are {len(node) - 1}")
        found: List[str] = []
        for part, parameter in zip(node[1:], wanted):
            term = self.term(part, scope)
            actual = self.types_of(term, scope)
            # A variable may still hold an object that fits; an object is what it is.
            may_fit = term.startswith("?") and self._domain.types.overlap(actual, parameter.types)
            if not may_fit and not self._domain.accepts(parameter.types, actual):
                raise part.error(
                    f"'{term}' is of type {' or '.join(actual)}, but '{signature.name}' takes "
                    f"{' or '.join(parameter.types)} here"
                )
            found.append(term)
        return tuple(found)

    @staticmethod
    def _rest(node: Expression, count: int) -> List[Node]:
        if len(node) != count + 1:
            raise node.error(f"'{node.head}' takes {count} part(s), here are {len(node) - 1}")
        return node[1:]


def number_of(node: Node) -> Union[float, None]:
    """The value of a word that is a number; None when it is not one, or one that no float holds."""
    if not isinstance(node, Word) or re.fullmatch(NUMBER, node, re.ASCII) is None:
        return None
    value = float(node)
    # What is too small for a float is refused like what is too large.
    return value if math.isfinite(value) and (value or not re.search("[1-9]", node.split("e")[0])) else None
