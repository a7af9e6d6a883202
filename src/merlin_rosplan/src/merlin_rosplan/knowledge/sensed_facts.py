# SPDX-License-Identifier: Apache-2.0
"""What sensors say about the world: results of sensing functions as facts, and which of them are news."""

import itertools
import math
from typing import Any, Callable, Dict, Iterable, List, Sequence, Set, Tuple, Union

Value = Union[bool, float]
Fact = Tuple[str, Tuple[str, ...]]  # predicate or function, objects

WILDCARDS = ("*", "_")


class SensingError(ValueError):
    """A configuration or a result that makes no sense; the text says what."""


def parameter_choices(
    given: Sequence[Any], types: Sequence[str], instances: Callable[[str], Sequence[str]]
) -> List[List[str]]:
    """The objects that each parameter may stand for.

    :param given: from the configuration: an object's name, a list of names, or ``*`` (``_``) for all
        instances; when empty every parameter is a wildcard.
    :param types: of the parameters.
    :param instances: gives the instances of a type.
    :raises SensingError: their numbers differ.
    """
    given = given or [WILDCARDS[0]] * len(types)
    if len(given) != len(types):
        raise SensingError(f"params has {len(given)} entries, the predicate {len(types)} parameters")
    choices = []
    for entry, kind in zip(given, types):
        named = entry if isinstance(entry, list) else [entry]
        choices.append(list(instances(kind)) if entry in WILDCARDS else [str(name) for name in named])
    return choices


def facts_of(
    predicate: str,
    result: Any,
    choices: Sequence[Sequence[str]],
    report: Callable[[str], None] = lambda text: None,
) -> Dict[Fact, Value]:
    """A sensing function's result as facts, without what is not finite: no knowledge base of ours takes it.

    :param result: a bool or a number, numpy's too, for the only possible combination of objects, or for all
        of them; a list of ``("arg1:arg2", value)``; None for nothing.
    :param choices: of :func:`parameter_choices`.
    :param report: called with a sentence where something is left out.
    :raises SensingError: the result is something else, or names the wrong number of objects.
    """
    facts = _facts_of(predicate, result, choices)
    finite = {fact: value for fact, value in facts.items() if -math.inf < value < math.inf}
    if len(finite) < len(facts):
        report("what is not a finite number is left out")
    return finite


def _facts_of(predicate: str, result: Any, choices: Sequence[Sequence[str]]) -> Dict[Fact, Value]:
    if result is None:
        return {}
    result = _plain(result)
    if isinstance(result, (bool, int, float)):
        return {(predicate, arguments): result for arguments in itertools.product(*choices)}
    if not isinstance(result, (list, tuple)):
        raise SensingError(
            f"the result is {result!r}, expected a bool, a number or a list of (objects, value)"
        )
    facts: Dict[Fact, Value] = {}
    for entry in result:
        if not isinstance(entry, (list, tuple)) or len(entry) != 2:
            raise SensingError(f"{entry!r} in the result is not a pair ('object:object', value)")
        names, value = entry[0], _plain(entry[1])
        arguments = tuple(str(names).split(":")) if str(names) else ()
        if len(arguments) != len(choices):
            raise SensingError(f"'{names}' in the result names {len(arguments)} objects, not {len(choices)}")
        if not isinstance(value, (bool, int, float)):
            raise SensingError(f"the value of '{names}' is {value!r}, expected a bool or a number")
        facts[predicate, arguments] = value
    return facts


def _plain(value: Any) -> Any:
    """Converts numpy's bools and numbers to Python's."""
    return value.item() if type(value).__module__ == "numpy" and not getattr(value, "shape", True) else value


class SensedFacts:
    """What was sensed last, and what of it was not sent to the knowledge base. Not thread-safe."""

    def __init__(self) -> None:
        self._values: Dict[Fact, Value] = {}
        self._news: Set[Fact] = set()

    @property
    def has_news(self) -> bool:
        """Whether something has to be sent."""
        return bool(self._news)

    def sense(self, facts: Dict[Fact, Value]) -> bool:
        """Takes what was sensed; returns whether it is news."""
        for fact, value in facts.items():
            known = self._values.get(fact)
            if known is None or known != value or isinstance(known, bool) != isinstance(value, bool):
                self._values[fact] = value
                self._news.add(fact)
        return bool(self._news)

    def forget_sent(self, names: Iterable[str] = ()) -> bool:
        """Another client changed these predicates (none: all): they are sent again, if there are any."""
        wanted = {name.lower() for name in names}
        self._news |= {fact for fact in self._values if not wanted or fact[0].lower() in wanted}
        return bool(self._news)

    def take_news(self) -> Dict[Fact, Value]:
        """What has to be sent; counts as sent from now on."""
        news = {fact: self._values[fact] for fact in sorted(self._news)}
        self._news.clear()
        return news

    def keep_news(self, facts: Iterable[Fact]) -> None:
        """These could not be sent."""
        self._news |= set(facts)
