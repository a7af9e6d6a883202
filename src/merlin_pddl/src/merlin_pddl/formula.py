# SPDX-License-Identifier: Apache-2.0
"""Conditions, numeric expressions and effects of PDDL as values.

Terms are strings: a variable starts with a question mark, anything else is an object.
"""

from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Set, Tuple, Union

from merlin_pddl.plan_text import call_text

START = "start"
OVER_ALL = "over all"
END = "end"


@dataclass(frozen=True)
class Variable:
    """A typed name: parameter, quantified variable, constant or object. More than one type means `either`."""

    name: str
    types: Tuple[str, ...] = ("object",)

    @property
    def label(self) -> str:
        """The name without a question mark."""
        return self.name.lstrip("?")


@dataclass(frozen=True)
class Number:
    """A number that stands in a formula."""

    value: float


@dataclass(frozen=True)
class Fluent:
    """A numeric function with its arguments."""

    name: str
    args: Tuple[str, ...] = ()


@dataclass(frozen=True)
class Arithmetic:
    """``+ - * /`` over one (only ``-``) or more operands."""

    op: str
    parts: Tuple["Numeric", ...]


@dataclass(frozen=True)
class Special:
    """``#t``, ``?duration``, ``total-time``, ``(is-violated x)``; ``total-cost`` unless it is a function."""

    name: str
    args: Tuple[str, ...] = ()


Numeric = Union[Number, Fluent, Arithmetic, Special]


@dataclass(frozen=True)
class Atom:
    """A predicate with its arguments."""

    name: str
    args: Tuple[str, ...] = ()


@dataclass(frozen=True)
class Equal:
    """Two terms name the same object."""

    left: str
    right: str


@dataclass(frozen=True)
class Comparison:
    """``> >= < <= =`` between numbers."""

    op: str
    left: Numeric
    right: Numeric


@dataclass(frozen=True)
class Not:
    """Negation."""

    part: "Condition"


@dataclass(frozen=True)
class And:
    """Conjunction; true when empty."""

    parts: Tuple["Condition", ...] = ()


@dataclass(frozen=True)
class Or:
    """Disjunction; false when empty."""

    parts: Tuple["Condition", ...] = ()


@dataclass(frozen=True)
class Forall:
    """Holds for all objects of the variables' types."""

    variables: Tuple[Variable, ...]
    part: "Condition"


@dataclass(frozen=True)
class Exists:
    """Holds for some objects of the variables' types."""

    variables: Tuple[Variable, ...]
    part: "Condition"


@dataclass(frozen=True)
class Preference:
    """A wish: it costs when violated, and never makes a condition false."""

    name: str
    part: "Condition"


Condition = Union[Atom, Equal, Comparison, Not, And, Or, Forall, Exists, Preference]
Formula = Union[Condition, Numeric]

#: What holds when a comparison does not.
OPPOSITE = {">": "<=", ">=": "<", "<": ">=", "<=": ">"}


@dataclass(frozen=True)
class TimedCondition:
    """A condition of an operator and when it must hold; a plain operator's hold at its start."""

    when: str
    condition: Condition


@dataclass(frozen=True)
class Effect:
    """One primitive effect, with the quantifiers and conditions that stood around it.

    Exactly one of `atom` (with `negative`) and `fluent` (with `op` and `value`) is set. `when` is START or
    END, or OVER_ALL for a continuous effect; `condition` holds the `when` conditions, each with its time.
    """

    when: str
    atom: Optional[Atom] = None
    negative: bool = False
    fluent: Optional[Fluent] = None
    op: str = "assign"
    value: Optional[Numeric] = None
    variables: Tuple[Variable, ...] = ()
    conditions: Tuple[TimedCondition, ...] = field(default=())


def numeric_text(value: float) -> str:
    """A number as PDDL writes it: no exponent, no needless digits, exact when read back."""
    if abs(value) < 1e15 and value == int(value):  # neither infinite nor no number at all
        return str(int(value))
    text = repr(float(value))
    if "e" not in text:
        return text
    return f"{Decimal(text):f}" + (".0" if abs(value) >= 1 else "")  # no exponent: few planners read one


def _variables_text(variables: Tuple[Variable, ...]) -> str:
    return " ".join(f"{variable.name} - {types_text(variable.types)}" for variable in variables)


def types_text(types: Tuple[str, ...]) -> str:
    """A type, or ``(either a b)``."""
    return types[0] if len(types) == 1 else f"(either {' '.join(types)})"


_WRITERS: Dict[type, Callable[..., str]] = {
    Number: lambda f: numeric_text(f.value),
    Fluent: lambda f: call_text(f.name, f.args),
    Arithmetic: lambda f: f"({f.op} {' '.join(map(to_pddl, f.parts))})",
    Special: lambda f: call_text(f.name, f.args) if f.name not in ("#t", "?duration") else f.name,
    Atom: lambda f: call_text(f.name, f.args),
    Equal: lambda f: f"(= {f.left} {f.right})",
    Comparison: lambda f: f"({f.op} {to_pddl(f.left)} {to_pddl(f.right)})",
    Not: lambda f: f"(not {to_pddl(f.part)})",
    And: lambda f: f"({' '.join(('and', *map(to_pddl, f.parts)))})",
    Or: lambda f: f"({' '.join(('or', *map(to_pddl, f.parts)))})",
    Forall: lambda f: f"(forall ({_variables_text(f.variables)}) {to_pddl(f.part)})",
    Exists: lambda f: f"(exists ({_variables_text(f.variables)}) {to_pddl(f.part)})",
    Preference: lambda f: f"(preference {f.name} {to_pddl(f.part)})",
}


def to_pddl(formula: Formula) -> str:
    """A condition or numeric expression as PDDL text."""
    return _WRITERS[type(formula)](formula)


def ground(formula: Any, bindings: Mapping[str, str]) -> Any:
    """A condition or numeric expression with objects for free variables; others stay.

    :param bindings: may have a number for ``?duration``.
    """
    if isinstance(formula, Special) and formula.name in bindings:
        return Number(float(bindings[formula.name]))
    if isinstance(formula, (Atom, Fluent)):
        return replace(formula, args=tuple(bindings.get(term, term) for term in formula.args))
    if isinstance(formula, Equal):
        return Equal(bindings.get(formula.left, formula.left), bindings.get(formula.right, formula.right))
    if isinstance(formula, Comparison):
        return Comparison(formula.op, ground(formula.left, bindings), ground(formula.right, bindings))
    if isinstance(formula, (And, Or)):
        return type(formula)(tuple(ground(part, bindings) for part in formula.parts))
    if isinstance(formula, Arithmetic):
        return Arithmetic(formula.op, tuple(ground(part, bindings) for part in formula.parts))
    if isinstance(formula, (Forall, Exists)):
        hidden = {variable.name for variable in formula.variables}
        bindings = {name: value for name, value in bindings.items() if name not in hidden}
    if isinstance(formula, (Not, Forall, Exists, Preference)):
        return replace(formula, part=ground(formula.part, bindings))
    return formula


def walk(formula: Any) -> Iterator[Any]:
    """A condition or numeric expression, and every one that stands in it, from the left."""
    yield formula
    inner: Sequence[Formula] = ()
    if isinstance(formula, (And, Or, Arithmetic)):
        inner = formula.parts
    elif isinstance(formula, Comparison):
        inner = (formula.left, formula.right)
    elif isinstance(formula, (Not, Forall, Exists, Preference)):
        inner = (formula.part,)
    for part in inner:
        yield from walk(part)


def terms(formula: Formula) -> List[Union[Atom, Fluent, Special]]:
    """The predicates, functions and specials that stand in a condition or numeric expression."""
    return [each for each in walk(formula) if isinstance(each, (Atom, Fluent, Special))]


def preferences(condition: Condition) -> List[Preference]:
    """The preferences that stand in a condition."""
    return [each for each in walk(condition) if isinstance(each, Preference)]


def violated(metric: Numeric) -> Set[str]:
    """The preferences whose violations a metric counts."""
    return {name for term in terms(metric) if term.name == "is-violated" for name in term.args}


def must_hold(condition: Condition) -> List[Condition]:
    """The conditions that must all hold for one; negations move inwards, preferences are left out."""
    if isinstance(condition, And):
        return [found for part in condition.parts for found in must_hold(part)]
    if isinstance(condition, Or) and len(condition.parts) == 1:
        return must_hold(condition.parts[0])
    if isinstance(condition, Not):
        part = condition.part
        if isinstance(part, Not):
            return must_hold(part.part)
        if isinstance(part, Or):
            return [found for inner in part.parts for found in must_hold(Not(inner))]
        if isinstance(part, Comparison) and part.op in OPPOSITE:
            return [Comparison(OPPOSITE[part.op], part.left, part.right)]
    return [] if isinstance(condition, Preference) else [condition]
