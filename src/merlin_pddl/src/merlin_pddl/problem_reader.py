# SPDX-License-Identifier: Apache-2.0
"""Reads a PDDL problem against its domain."""

import os
from typing import Dict, Mapping, Optional, Tuple, Union

from merlin_pddl.constraint_reader import ConstraintReader
from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import open_definition
from merlin_pddl.evaluation import arithmetic
from merlin_pddl.formula import Arithmetic, Condition, Fluent, Numeric, violated
from merlin_pddl.formula import Number as NumberValue
from merlin_pddl.formula_reader import IN_METRIC, FormulaReader, number_of, preference_names, typed_list
from merlin_pddl.knowledge import Fact, FunctionValue, Metric, Timed, conjuncts
from merlin_pddl.problem import Problem
from merlin_pddl.text_reader import MAX_DEPTH, Expression, Node, name_of, read_expression, read_file

NANOSECONDS = 1_000_000_000
#: s: ROS counts them in 32 bits.
LATEST = 2**32


#: Why a knowledge base takes no trajectory constraints, and what to do.
NO_TRAJECTORY = (
    "a knowledge base keeps what holds now and no trajectory, so it cannot keep (:constraints ...) of "
    "a problem: write them into the domain, where every plan obeys them, or plan for this file itself"
)


def read_problem(path: Union[str, "os.PathLike[str]"], domain: Domain) -> Problem:
    """Reads a problem file for a knowledge base.

    :raises PddlError: with file, line and column; also for trajectory constraints, which it cannot keep.
    """
    return ProblemReader(read_file(path), domain).read()


def parse_problem(text: str, domain: Domain, source: str = "problem", constraints: bool = False) -> Problem:
    """Reads a problem from text; with `constraints` one that is planned for as it is.

    :raises PddlError: with `source`, line and column.
    """
    return ProblemReader(read_expression(text, source), domain, constraints).read()


def parse_condition(
    text: str, domain: Domain, objects: Mapping[str, Tuple[str, ...]], source: str = "goal"
) -> Condition:
    """Reads a ground condition, as a goal is one.

    :raises PddlError: it is malformed, or names something that neither the domain nor `objects` knows.
    """
    node = read_expression(text, source, MAX_DEPTH - 5)  # a problem around it is read too
    return FormulaReader(domain, dict(objects)).condition(node, {})


class ProblemReader:
    """Turns the expression of a problem into the model. Use it once.

    :param constraints: take trajectory constraints; a knowledge base cannot.
    """

    def __init__(self, node: Expression, domain: Domain, constraints: bool = False) -> None:
        self._takes_constraints = constraints
        name, self._sections = open_definition(node, "problem")
        self._domain = domain
        self._problem = Problem(str(name), domain.name)
        self._formulas = FormulaReader(domain, self._problem.objects)
        self._values: Dict[Tuple[str, ...], float] = {}

    def read(self) -> Problem:
        """The problem.

        :raises PddlError: the first thing that is wrong.
        """
        readers = {
            ":domain": self._check_domain,
            ":objects": self._objects,
            ":init": self._init,
            ":goal": self._goal,
            ":metric": self._metric,
            ":constraints": self._constraints,
        }
        for section in self._sections:
            if section.head not in (*readers, ":requirements", ":length"):
                raise section.error(f"unknown section '{section.head}'")
        for head, reader in readers.items():
            found = [section for section in self._sections if section.head == head]
            if len(found) > 1 and head in (":domain", ":goal", ":metric"):
                raise found[1].error(f"'{head}' stands twice")
            for section in found:
                reader(section)
        return self._problem

    def _check_domain(self, section: Expression) -> None:
        if len(section) != 2:
            raise section.error("expected (:domain <name>)")
        name = name_of(section[1], "the name of the domain")
        if name != self._domain.name:
            raise name.error(f"the problem belongs to the domain '{name}', not to '{self._domain.name}'")

    def _objects(self, section: Expression) -> None:
        objects = self._problem.objects
        for word, types in typed_list(section[1:], self._domain, variables=False):
            objects[str(word)] = tuple(dict.fromkeys((*objects.get(str(word), ()), *types)))

    def _init(self, section: Expression) -> None:
        for node in section[1:]:
            if not isinstance(node, Expression):
                raise node.error(f"expected a fact in parentheses, found '{node}'")
            time = number_of(node[1]) if node.head == "at" and len(node) == 3 else None
            if time is None:
                found = self._item(node)
                if isinstance(found, FunctionValue):
                    self._values[found.key] = found.value
                    self._problem.values.append(found)
                else:
                    self._problem.facts.append(found)
            else:
                if not 0 <= time <= LATEST:
                    raise node.error(f"a timed fact lies between 0 and {LATEST} s after the start")
                self._problem.timed.append(Timed(int(time * NANOSECONDS), self._item(node[2])))

    def _item(self, node: Node) -> Union[Fact, FunctionValue]:
        if not isinstance(node, Expression):
            raise node.error(f"expected a fact in parentheses, found '{node}'")
        if node.head == "=":
            if len(node) != 3:
                raise node.error("expected (= (<function> ...) <number>)")
            fluent = self._formulas.fluent(node[1], {})
            value = self._constant(self._formulas.numeric(node[2], {}))
            if value is None:
                raise node[2].error("the value has no number yet")
            return FunctionValue(fluent.name, fluent.args, value)
        atom, negative = self._formulas.literal(node, {}, "it follows from other facts and is not stated")
        return Fact(atom.name, atom.args, negative)

    def _constant(self, value: Numeric) -> Optional[float]:
        """A numeric expression over what the lines above said."""
        if isinstance(value, NumberValue):
            return value.value
        if isinstance(value, Fluent):
            return self._values.get((value.name, *value.args))
        if isinstance(value, Arithmetic):
            return arithmetic(value.op, [self._constant(part) for part in value.parts])
        return None

    def _goal(self, section: Expression) -> None:
        if len(section) != 2:
            raise section.error("expected (:goal <condition>)")
        self._problem.goals.extend(conjuncts(self._formulas.condition(section[1], {})))

    def _constraints(self, section: Expression) -> None:
        if not self._takes_constraints:
            raise section.error(NO_TRAJECTORY)
        reader = ConstraintReader(self._domain, self._formulas)
        self._problem.constraints.extend(map(reader.read, section[1:]))

    def _metric(self, section: Expression) -> None:
        if len(section) != 3 or section[1] not in ("minimize", "maximize"):
            raise section.error("expected (:metric minimize <expression>) or maximize")
        value = self._formulas.numeric(section[2], IN_METRIC)
        for name in violated(value) - self._domain.preferences:
            if not any(name in preference_names(part) for part in self._sections if part.head != ":init"):
                raise section.error(f"there is no preference '{name}'")
        self._problem.metric = Metric(str(section[1]), value)
