# SPDX-License-Identifier: Apache-2.0
"""Reads a PDDL domain (the parts of PDDL 2.1 to 3.1 that a knowledge base needs) into a :class:`Domain`."""

import hashlib
import os
from typing import Callable, Dict, Iterator, List, Mapping, NamedTuple, Optional, Tuple, Union

from merlin_pddl.constraint_reader import ConstraintReader
from merlin_pddl.domain import Derived, Domain, Duration, Operator, Signature, self_negating
from merlin_pddl.formula import OVER_ALL, START, Effect, TimedCondition, Variable, terms
from merlin_pddl.formula_reader import (
    IN_DURATIVE,
    SPECIALS,
    FormulaReader,
    Scope,
    groups,
    parameters,
    preference_names,
    typed_list,
)
from merlin_pddl.text_reader import Expression, Node, Word, name_of, read_expression, read_file
from merlin_pddl.type_hierarchy import OBJECT, TypeCycleError

OBJECT_FLUENTS = (
    "only functions of numbers are known: ROSPlan's messages carry no object as a value; "
    "use a predicate with one more argument"
)
#: What no robot executes; it is read for its mistakes.
_BY_ITSELF = (":process", ":event")
_OF_PROCESS = "a process changes numbers with the time, and nothing else: (increase (x) (* #t 2))"
ASSIGNMENTS = ("assign", "increase", "decrease", "scale-up", "scale-down")


def read_domain(path: Union[str, "os.PathLike[str]"]) -> Domain:
    """Reads a domain file.

    :raises PddlError: with file, line and column.
    """
    return DomainReader(read_file(path)).read()


def parse_domain(text: str, source: str = "domain") -> Domain:
    """Reads a domain from text.

    :raises PddlError: with `source`, line and column.
    """
    return DomainReader(read_expression(text, source)).read()


def open_definition(node: Expression, kind: str) -> Tuple[Word, List[Expression]]:
    """Name and sections of ``(define (domain x) ...)`` or ``(define (problem x) ...)``.

    :raises PddlError: it is something else.
    """
    if node.head != "define" or len(node) < 2:
        raise node.error(f"expected (define ({kind} <name>) ...)")
    title = node[1]
    if not isinstance(title, Expression) or title.head != kind or len(title) != 2:
        raise title.error(f"expected ({kind} <name>)")
    sections: List[Expression] = []
    for section in node[2:]:
        if not isinstance(section, Expression) or not section.head.startswith(":"):
            raise section.error("expected a section such as (:types ...)")
        for word in section[1:] if section.head == ":requirements" else []:
            if not isinstance(word, Word) or not word.startswith(":"):
                raise word.error("expected a requirement such as ':typing'")
        sections.append(section)
    return name_of(title[1], f"the name of the {kind}"), sections


class _AnyObject(Mapping[str, Tuple[str, ...]]):
    """The objects of a problem that is not known: each name may be that of one, which may have any type."""

    def __init__(self, domain: Domain) -> None:
        self._types = (OBJECT, *domain.types)

    def __getitem__(self, name: str) -> Tuple[str, ...]:
        return self._types

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


class _Around(NamedTuple):
    """What stands around an effect."""

    scope: Scope
    when: Optional[str]
    """START or END; OVER_ALL in a process; None where a durative action still owes the time."""
    variables: Tuple[Variable, ...] = ()
    conditions: Tuple[TimedCondition, ...] = ()


class DomainReader:
    """Turns the expression of a domain into the model. Use it once."""

    def __init__(self, node: Expression) -> None:
        name, self._sections = open_definition(node, "domain")
        self._domain = Domain(str(name))
        self._domain.digest = hashlib.sha256(node.text().encode()).hexdigest()
        self._domain.preferences = frozenset(preference_names(node))
        self._formulas = FormulaReader(self._domain)
        self._by_itself: Dict[str, Operator] = {}

    def read(self) -> Domain:
        """The domain.

        :raises PddlError: the first thing that is wrong.
        """
        readers: Dict[str, Callable[[Expression], None]] = {
            ":types": self._types,
            ":constants": self._constants,
            ":predicates": self._predicates,
            ":functions": self._functions,
        }
        actions = (":action", ":durative-action", *_BY_ITSELF)
        for section in self._sections:
            if section.head not in (*readers, *actions, ":requirements", ":constraints", ":derived"):
                raise section.error(f"unknown section '{section.head}'")
            if section.head == ":constraints" and len(section) == 1:
                raise section.error("expected (:constraints <constraint>)")
        # In this order, whatever the file's: each builds on the ones before.
        for head, reader in readers.items():
            for section in self._sections:
                if section.head == head:
                    reader(section)
        derived = [section for section in self._sections if section.head == ":derived"]
        for section in derived:
            self._derived(section)
        confused = self_negating(self._domain.derived)
        for section in derived:
            if confused is not None and section[1].head == confused:
                raise section.error(f"the derived predicate '{confused}' depends on its own negation")
        for section in self._sections:
            if section.head in actions:
                self._operator(section)
            elif section.head == ":constraints":  # the planner obeys them
                formulas = FormulaReader(self._domain, _AnyObject(self._domain))
                constraints = ConstraintReader(self._domain, formulas)
                for node in section[1:]:
                    constraints.read(node)
                self._domain.constraints += tuple(constraints.reads)
                self._domain.timed_constraints += tuple(constraints.timed)
        return self._domain

    def _types(self, section: Expression) -> None:
        types, what = self._domain.types, "the name of a type"
        for names, kinds in groups(section[1:]):
            words = [str(name_of(node, what)) for node in names]
            parents = [str(name_of(kind, what)) for kind in kinds]
            for word in words:
                types.declare(word, parents)
        try:
            types.complete()
        except TypeCycleError as error:
            raise section.error(str(error)) from error

    def _constants(self, section: Expression) -> None:
        constants = self._domain.constants
        for word, types in typed_list(section[1:], self._domain, variables=False):
            constants[str(word)] = tuple(dict.fromkeys((*constants.get(str(word), ()), *types)))

    def _signature(self, node: Node, what: str) -> Tuple[Word, Signature]:
        if not isinstance(node, Expression) or not node:
            raise node.error(f"expected a {what} in parentheses")
        name = name_of(node[0], f"the name of a {what}")
        inner = Expression(node.source, node.line, node.column)
        inner.extend(node[1:])
        return name, Signature(str(name), parameters(inner, self._domain, f"'{name}'"))

    def _predicates(self, section: Expression) -> None:
        for node in section[1:]:
            name, signature = self._signature(node, "predicate")
            if name in self._domain.predicates:
                raise name.error(f"the predicate '{name}' is declared twice")
            self._domain.predicates[str(name)] = signature

    def _functions(self, section: Expression) -> None:
        rest = iter(section[1:])
        for node in rest:
            if isinstance(node, Word):
                if node != "-":
                    raise node.error(f"expected a function in parentheses, found '{node}'")
                kind = next(rest, None)
                if kind != "number":
                    raise (kind or node).error(OBJECT_FLUENTS)
                continue
            name, signature = self._signature(node, "function")
            if self._domain.functions.get(str(name), signature) != signature:
                raise name.error(f"the function '{name}' is declared twice, with other parameters")
            if name in SPECIALS:
                raise name.error(f"'{name}' has a meaning in PDDL and cannot be the name of a function")
            self._domain.functions[str(name)] = signature

    def _derived(self, section: Expression) -> None:
        if len(section) != 3:
            raise section.error("expected (:derived (<predicate> ...) <condition>)")
        name, signature = self._signature(section[1], "predicate")
        declared = self._domain.predicates.get(str(name))
        if declared is None:
            raise name.error(f"the derived predicate '{name}' is not declared among the predicates")
        if len(declared.parameters) != len(signature.parameters):
            raise name.error(f"'{name}' takes {len(declared.parameters)} argument(s)")
        scope = {variable.name: variable.types for variable in signature.parameters}
        rule = Derived(signature, self._formulas.condition(section[2], scope))
        self._domain.derived.setdefault(str(name), []).append(rule)

    def _operator(self, section: Expression) -> None:
        if len(section) < 2:
            raise section.error("an action needs a name")
        name = name_of(section[1], "the name of an action")
        if name in self._domain.operators or name in self._by_itself:
            raise name.error(f"the action '{name}' is declared twice")
        durative = section.head == ":durative-action"
        parts = self._fields(section, name, durative)
        declared = (
            parameters(parts[":parameters"], self._domain, f"'{name}'") if ":parameters" in parts else ()
        )
        scope: Scope = {variable.name: variable.types for variable in declared}
        if durative:
            scope = {**IN_DURATIVE, **scope}
        conditions: List[TimedCondition] = []
        durations: List[Duration] = []
        if durative:
            if ":duration" not in parts:
                raise name.error(f"the durative action '{name}' has no :duration")
            durations = self._durations(parts[":duration"], scope)
            if ":condition" in parts:
                conditions = self._formulas.timed_condition(parts[":condition"], scope)
        elif ":precondition" in parts:
            conditions = [TimedCondition(START, self._formulas.condition(parts[":precondition"], scope))]
        effects: List[Effect] = []
        if ":effect" in parts:
            when = None if durative else OVER_ALL if section.head == ":process" else START
            effects = self._effects(parts[":effect"], _Around(scope, when))
        operators = self._by_itself if section.head in _BY_ITSELF else self._domain.operators
        operators[str(name)] = Operator(
            str(name), declared, durative, tuple(durations), tuple(conditions), tuple(effects)
        )

    @staticmethod
    def _fields(section: Expression, name: Word, durative: bool) -> Dict[str, Node]:
        allowed = (":parameters", ":effect") + (
            (":duration", ":condition") if durative else (":precondition",)
        )
        found: Dict[str, Node] = {}
        rest = iter(section[2:])
        for key in rest:
            if not isinstance(key, Word) or key not in allowed:
                shown = key if isinstance(key, Word) else key.text()[:40]
                raise key.error(f"expected one of {', '.join(allowed)} in '{name}', found '{shown}'")
            if key in found:
                raise key.error(f"'{key}' stands twice in '{name}'")
            value = next(rest, None)
            if value is None:
                raise key.error(f"nothing follows '{key}'")
            found[str(key)] = value
        return found

    def _durations(self, node: Node, scope: Scope) -> List[Duration]:
        if not isinstance(node, Expression):
            raise node.error("expected a constraint on ?duration in parentheses")
        if not node:
            return []
        if node.head == "and":
            return [found for part in node[1:] for found in self._durations(part, scope)]
        when = self._formulas.time_of(node)
        if when == OVER_ALL:
            raise node.error("a duration is bounded at start or at end")
        if when:
            return self._durations(node[2], scope)
        if node.head not in ("=", "<=", ">=") or len(node) != 3 or node[1] != "?duration":
            raise node.error("expected (= ?duration <number>), or <= or >=")
        bare = {name: types for name, types in scope.items() if types}  # no bound of itself
        return [Duration(node.head, self._formulas.numeric(node[2], bare))]

    def _effects(self, node: Node, around: _Around) -> List[Effect]:
        """Primitive effects below a node."""
        if not isinstance(node, Expression):
            raise node.error(f"expected an effect in parentheses, found '{node}'")
        if not node:
            return []
        if node.head == "and":
            return [effect for part in node[1:] for effect in self._effects(part, around)]
        if node.head in ("forall", "when") and len(node) != 3:
            raise node.error(f"'{node.head}' takes 2 parts, here are {len(node) - 1}")
        if node.head == "forall":
            inner = parameters(node[1], self._domain, "'forall'")
            wider = {**around.scope, **{variable.name: variable.types for variable in inner}}
            return self._effects(node[2], around._replace(scope=wider, variables=around.variables + inner))
        if node.head == "when":
            if around.when is None:
                more = tuple(self._formulas.timed_condition(node[1], around.scope))
            else:
                more = (TimedCondition(around.when, self._formulas.condition(node[1], around.scope)),)
            return self._effects(node[2], around._replace(conditions=around.conditions + more))
        time = self._formulas.time_of(node)
        if time:
            if around.when is not None or time == OVER_ALL:
                raise node.error("a time does not belong here")
            return self._effects(node[2], around._replace(when=time))
        return [self._primitive(node, around)]

    def _primitive(self, node: Expression, around: _Around) -> Effect:
        scope, when = around.scope, around.when
        # There may be a predicate of this name: its arguments are names.
        numeric = any(isinstance(part, Expression) for part in node[1:])
        if node.head in ASSIGNMENTS and (numeric or node.head not in self._domain.predicates):
            if len(node) != 3:
                raise node.error(f"'{node.head}' takes a function and a value")
            continuous = when in (None, OVER_ALL) and node.head in ("increase", "decrease")
            fluent = self._formulas.fluent(node[1], scope)
            value = self._formulas.numeric(node[2], {**scope, "#t": ()} if continuous else scope)
            lasts = continuous and any(part.name == "#t" for part in terms(value))
            if when is None and not lasts:
                raise node.error("expected (at start ...), (at end ...), or a change with the time, (* #t 2)")
            if when == OVER_ALL and not lasts:
                raise node.error(_OF_PROCESS)
            when = when or OVER_ALL
            return Effect(when, None, False, fluent, node.head, value, around.variables, around.conditions)
        if when in (None, OVER_ALL):
            raise node.error(_OF_PROCESS if when else "expected (at start ...) or (at end ...)")
        assert when is not None
        atom, negative = self._formulas.literal(node, scope, "no action can change it")
        return Effect(when, atom, negative, variables=around.variables, conditions=around.conditions)
