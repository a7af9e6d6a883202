# SPDX-License-Identifier: Apache-2.0
"""What a knowledge base holds: instances, facts, function values, timed items, goals, a metric.

PDDL knows no upper case, so everything is found by a lower-case key; the spelling it came with is kept.
Times are nanoseconds of ROS time.
"""

from dataclasses import dataclass
from typing import Any, List, Optional, Sequence, Tuple, Type, TypeVar, Union

from merlin_pddl.formula import And, Arithmetic, Atom, Comparison, Condition, Not, Numeric, to_pddl
from merlin_pddl.plan_text import call_text

Signed = TypeVar("Signed", Atom, Comparison)
#: Lower-case name and arguments of a fact or function value.
Key = Tuple[str, ...]

ASSIGN = "assign"
INCREASE = "increase"
DECREASE = "decrease"
SCALE_UP = "scale-up"
SCALE_DOWN = "scale-down"

#: Arithmetic of the changes that are not assignment.
OPERATIONS = {INCREASE: "+", DECREASE: "-", SCALE_UP: "*", SCALE_DOWN: "/"}


def arranged(name: str, labels: Sequence[str], pairs: Sequence[Tuple[str, str]]) -> Tuple[str, ...]:
    """The arguments of a predicate or function in the declared order.

    :param name: of the predicate or function, for the error.
    :param labels: as declared, without ``?``.
    :param pairs: key and value of each argument. Keys that are all declared name the arguments; without any
        declared one the order counts, as in ROSPlan.
    :raises ValueError: only some keys are declared, or one stands twice.
    """
    order = {label.lower(): number for number, label in enumerate(labels)}
    places = [order.get(key.lower().lstrip("?")) for key, _ in pairs]
    known = [place for place in places if place is not None]
    if not known:
        return tuple(value for _, value in pairs)
    if len(known) < len(places) or len(set(known)) < len(known):
        keys, wanted = ", ".join(repr(key) for key, _ in pairs), ", ".join(map(repr, labels))
        raise ValueError(
            f"the keys of '{name}' are {keys}, declared are {wanted}: "
            "name each argument once by its declared key, or none of them"
        )
    return tuple(value for _, (_, value) in sorted(zip(known, pairs), key=lambda placed: placed[0]))


class Row:
    """Something stored. `order` says which of two came first; `wire` is a cache of the serialiser."""

    __slots__ = ("order", "wire")

    def __init__(self) -> None:
        self.order = 0
        self.wire: Any = None

    @property
    def key(self) -> Any:
        """Its key in the table."""
        raise NotImplementedError


class Instance(Row):
    """An object of a type; an object of several types is several instances."""

    __slots__ = ("type_name", "name")

    def __init__(self, type_name: str, name: str) -> None:
        super().__init__()
        self.type_name = type_name
        self.name = name

    @property
    def key(self) -> Key:
        """Its key in the table."""
        return (self.type_name.lower(), self.name.lower())

    def text(self) -> str:
        """The instance as PDDL declares it."""
        return f"{self.name} - {self.type_name}"


class _Ground(Row):
    """A predicate or function with its arguments."""

    __slots__ = ("name", "args", "since", "labels")

    def __init__(
        self, name: str, args: Tuple[str, ...], since: int, labels: Optional[Tuple[str, ...]]
    ) -> None:
        super().__init__()
        self.name = name
        self.args = args
        self.since = since
        self.labels = labels  # as sent, where the domain has no such predicate or function

    @property
    def key(self) -> Key:
        """Its key in the table."""
        return (self.name.lower(), *[arg.lower() for arg in self.args])

    def text(self) -> str:
        """Name and arguments as PDDL."""
        return call_text(self.name, self.args)


class Fact(_Ground):
    """A predicate that holds, or that is said not to hold."""

    __slots__ = ("negative",)

    def __init__(
        self,
        name: str,
        args: Tuple[str, ...],
        negative: bool = False,
        since: int = 0,
        labels: Optional[Tuple[str, ...]] = None,
    ) -> None:
        super().__init__(name, args, since, labels)
        self.negative = negative

    def text(self) -> str:
        """The row as PDDL."""
        return f"(not {super().text()})" if self.negative else super().text()


class FunctionValue(_Ground):
    """The value of a numeric function. `op` is how it changes the stored value (in updates only)."""

    __slots__ = ("value", "op")

    def __init__(
        self,
        name: str,
        args: Tuple[str, ...],
        value: float,
        since: int = 0,
        op: str = ASSIGN,
        labels: Optional[Tuple[str, ...]] = None,
    ) -> None:
        super().__init__(name, args, since, labels)
        self.value = value
        self.op = op


class Timed(Row):
    """Something that becomes true at a time."""

    __slots__ = ("at", "item")

    def __init__(self, at: int, item: Union[Instance, Fact, FunctionValue]) -> None:
        super().__init__()
        self.at = at
        self.item = item

    @property
    def key(self) -> int:
        """Its key in the table."""
        return self.order


def _flat(value: Numeric) -> Numeric:
    """An expression without sums that begin with a sum, and products likewise."""
    if not isinstance(value, Arithmetic):
        return value
    first, *others = map(_flat, value.parts)
    if others and value.op in "+*" and isinstance(first, Arithmetic) and first.op == value.op:
        return Arithmetic(value.op, (*first.parts, *others))
    return Arithmetic(value.op, (first, *others))


class StoredGoal(Row):
    """What is to become true: a condition, or that an instance exists."""

    __slots__ = ("condition", "instance", "since")

    def __init__(
        self, condition: Optional[Condition] = None, instance: Optional[Instance] = None, since: int = 0
    ) -> None:
        super().__init__()
        self.condition = condition
        self.instance = instance
        self.since = since

    @property
    def key(self) -> str:
        """Its key in the table. Messages have no ``(+ a b c)``: it is the same as ``(+ (+ a b) c)``."""
        if self.comparison is None:
            return self.text().lower()
        found, negated = self.comparison
        flat = Comparison(found.op, _flat(found.left), _flat(found.right))
        return to_pddl(Not(flat) if negated else flat).lower()

    def text(self) -> str:
        """The condition as PDDL, or the declaration of the instance."""
        if self.instance is not None:
            return self.instance.text()
        assert self.condition is not None
        return to_pddl(self.condition)

    @property
    def literal(self) -> Optional[Tuple[Atom, bool]]:
        """Atom and whether it is negated, when the goal is that simple."""
        return self._signed(Atom)

    @property
    def comparison(self) -> Optional[Tuple[Comparison, bool]]:
        """Comparison and whether it is negated, when the goal is one."""
        return self._signed(Comparison)

    def _signed(self, kind: Type[Signed]) -> Optional[Tuple[Signed, bool]]:
        negated = isinstance(self.condition, Not)
        found = self.condition.part if isinstance(self.condition, Not) else self.condition
        return (found, negated) if isinstance(found, kind) else None


@dataclass(frozen=True)
class Metric:
    """What plans are judged by: `optimization` is ``minimize`` or ``maximize``."""

    optimization: str
    value: Numeric


def conjuncts(condition: Condition) -> List[Condition]:
    """The parts of a conjunction, however nested; anything else is its own only part."""
    if isinstance(condition, And):
        return [found for part in condition.parts for found in conjuncts(part)]
    return [condition]
