# SPDX-License-Identifier: Apache-2.0
"""What was so at a moment: the state as the monitor keeps it, read in the terms of the domain."""

import functools
import re
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from merlin_explain.claims import FACT, REQUEST, STEP, VALUE, Claim, Evidence, QuestionError, Words
from merlin_pddl.domain import Domain, Operator
from merlin_pddl.evaluation import Evaluator, WorldState
from merlin_pddl.formula import END, Atom, Condition, Not, ground, must_hold, numeric_text, terms, to_pddl
from merlin_pddl.knowledge import Key
from merlin_pddl.problem import Problem
from merlin_ros.work.passed_time import clock_text

WAITING = "waiting"
RUNNING = ("dispatched", "running")
ATOM = re.compile(r"\([^()]+\)")
EXACT = 0.5  # s between two looks; what happens between them has the time of the second one
SHORTEST = 0.01  # s; a planned duration below is none


class Step(NamedTuple):
    """A step of the plan. Times are s of ROS time, `start` and `duration` s of the plan.

    :ivar number: in the plan, from 1.
    :ivar key: its id.
    :ivar state: waiting, dispatched, running, succeeded, failed, cancelled or dropped.
    """

    number: int
    key: str
    text: str
    objects: Tuple[str, ...]
    state: str
    start: float
    duration: float
    began: Optional[float] = None
    ended: Optional[float] = None

    @property
    def name(self) -> str:
        """Its operator."""
        return self.text.strip("()").split()[0].lower()

    @property
    def due(self) -> Optional[float]:
        """When it ends as planned; None: it has not begun, or has no duration."""
        return None if self.began is None or self.duration <= SHORTEST else self.began + self.duration

    def evidence(self) -> Evidence:
        """The step in a plan."""
        return Evidence(STEP, self.text, self.number, time=self.start)


class Change(NamedTuple):
    """One change of a fact or a value, also one that waits for its time.

    :ivar sign: ``+``, ``-`` or ``=``.
    :ivar text: the fact, or function, as PDDL.
    :ivar client: node that asked for it; empty: not known.
    :ivar at: s of ROS time.
    :ivar version: of the knowledge base after it; 0: not known.
    :ivar after: of a change that is not recorded itself: when it had not happened yet, s of ROS time.
    """

    sign: str
    text: str
    client: str
    at: float
    version: int = 0
    after: Optional[float] = None

    def claim(self, words: Words, *shown: Evidence, by: str = "") -> Claim:
        """When it happened, and who made it.

        :param by: what made it, in words; empty: its client.
        """
        version = f", version {self.version} of the knowledge" if self.version else ""
        how = "ceased to be" if self.sign == "-" else "became"
        source = by or self.client or "a client that is not known"
        text = f"(not {self.text})" if self.sign == "-" else self.text
        fact = Evidence(FACT, f"{text}, by {self.client}", 0, self.version, self.at)
        when = f"at {clock_text(self.at)}"
        if self.after is not None and self.at - self.after > EXACT:
            when = f"between {clock_text(self.after)} and {clock_text(self.at)}"
        said = f"“{words.fact(self.text)}” {how} so {when}{version}, by {source}"
        return Claim("action" if by else "client", said, (fact, *shown))


class Moment(WorldState):
    """A moment.

    :param state: sections of the monitor's state.
    :param domain: with its operators.
    :ivar timed: changes that wait for their time, where that is known.
    """

    def __init__(self, state: Mapping[str, Any], domain: Domain, timed: Sequence[Change] = ()) -> None:
        self.state = state
        self.domain = domain
        self.timed = timed
        self._steps: Optional[List[Step]] = None

    @property
    def at(self) -> float:
        """Its ROS time, s."""
        return float(self.section("meta").get("time") or 0.0)

    @property
    def version(self) -> int:
        """Of the knowledge base; 0: not known."""
        return int(self.section("knowledge").get("version") or 0)

    def section(self, name: str) -> Mapping[str, Any]:
        """A section; empty: there is none."""
        return self.state.get(name) or {}

    @property
    def executor(self) -> Mapping[str, Any]:
        """The Executor's status; empty: not known."""
        return self.section("now").get("executor") or {}

    @property
    def requests(self) -> List[Mapping[str, Any]]:
        """The requests that run in one plan, first the one that the Executor's status names."""
        executor = self.executor
        return [executor, *executor.get("together", ())] if executor.get("request") else []

    @property
    def queue(self) -> List[Mapping[str, Any]]:
        """The requests that wait, in their order."""
        return list(self.section("queue").get("waiting") or [])

    @property
    def steps(self) -> List[Step]:
        """The steps of the plan, in its order."""
        if self._steps is None:
            plan = self.section("plan")
            steps = plan.get("steps") or {}
            found = [steps[key] for key in plan.get("order") or [] if key in steps]
            self._steps = [_step(number, each) for number, each in enumerate(found, 1)]
        return self._steps

    def step(self, text: str) -> Optional[Step]:
        """The step with this text, the first that has not ended; None: the plan has none."""
        found = [step for step in self.steps if key_of(step.text) == key_of(text)]
        going = [step for step in found if step.state in (WAITING, *RUNNING)]
        return next(iter(going + found), None)

    def before(self, step: Step) -> Iterator[Tuple[Step, bool]]:
        """The steps for which a step waits by the plan, and whether for their ends, not their starts."""
        by_key = {each.key: each for each in self.steps}
        for first, second, *what in self.section("plan").get("edges") or []:
            if second == step.key and first in by_key and "end" not in what:
                yield by_key[first], "start" not in what

    # --- the knowledge --------------------------------------------------------------------------------------

    @functools.cached_property
    def _facts(self) -> Dict[str, str]:
        """The facts by their texts in small letters, of 10 000 there four times as soon as their keys."""
        return {text.lower(): text for text in self.section("knowledge").get("facts") or {}}

    @functools.cached_property
    def _values(self) -> Dict[str, str]:
        return {text.lower(): text for text in self.section("knowledge").get("values") or {}}

    def holds(self, key: Key) -> bool:
        """Whether a fact is stored."""
        return _text(key) in self._facts

    def value(self, key: Key) -> Optional[float]:
        """The value of a function, None when it has none."""
        text = self._values.get(_text(key))
        return None if text is None else self.section("knowledge")["values"][text]["value"]

    def typed(self) -> Dict[str, Tuple[str, ...]]:
        """The objects with their types."""
        known = self.section("knowledge").get("objects") or {}
        problem = Problem(
            "", "", {name: (str(each.get("type", "")).lower(),) for name, each in known.items()}
        )
        return problem.typed(self.domain.constants)

    def objects(self, types: Tuple[str, ...]) -> List[str]:
        """The objects of any of these types or of types below them."""
        return [name for name, actual in self.typed().items() if self.domain.accepts(types, actual)]

    def with_fact(self, key: Key, holds: bool) -> "Moment":
        """The same moment with one fact changed."""
        other = Moment(self.state, self.domain, self.timed)
        other._facts = {known: text for known, text in self._facts.items() if known != _text(key)}
        if holds:
            other._facts[_text(key)] = _text(key)
        return other

    def entry(self, text: str) -> Optional[Mapping[str, Any]]:
        """What is known of a fact or of a function's value; None: it does not hold, or has none."""
        knowledge, key = self.section("knowledge"), _text(key_of(text))
        for table, names in (("facts", self._facts), ("values", self._values)):
            if key in names:
                return (knowledge.get(table) or {}).get(names[key], {})
        return None

    def true(self, condition: Condition, duration: float = 0.0) -> bool:
        """Whether a ground condition holds."""
        return Evaluator(self.domain, self, {"?duration": duration}).holds(condition)

    def fact_evidence(self, text: str) -> Evidence:
        """A fact or a value as it is."""
        entry = self.entry(text) or {}
        if entry.get("value") is not None:  # else it is no finite number
            text = f"(= {text} {numeric_text(entry['value'])})"
        version = int(entry.get("version") or self.version)
        return Evidence(VALUE if "value" in entry else FACT, text, 0, version, float(entry.get("at") or 0.0))

    def condition_evidence(self, condition: Condition) -> Tuple[Evidence, ...]:
        """A ground condition as it is judged, with the values that it compares."""
        said = f"{'' if self.true(condition) else 'false: '}{to_pddl(condition)}"
        values = dict.fromkeys(
            to_pddl(term) for term in terms(condition) if term.name in self.domain.functions
        )
        return (
            Evidence(FACT, said, 0, self.version, self.at),
            *(self.fact_evidence(text) for text in values if self.entry(text) is not None),
        )

    # --- operators ------------------------------------------------------------------------------------------

    def unmet(self, step: Step) -> List[Condition]:
        """The ground conditions of a step that do not hold, but for those at its end."""
        operator, bindings = self._operator(step)
        found = [
            ground(part, bindings)
            for timed in (operator.conditions if operator else ())
            if timed.when != END
            for part in must_hold(timed.condition)
        ]
        return [each for each in found if not self.true(each, step.duration)]

    def objects_of(self, step: Step) -> Dict[str, str]:
        """The objects of a step by the labels of its operator."""
        return {name.lstrip("?"): value for name, value in self._operator(step)[1].items()}

    def brings(self, step: Step, condition: Condition) -> bool:
        """Whether an effect of a step that is still to come certainly makes a literal true."""
        atom, positive = (condition.part, False) if isinstance(condition, Not) else (condition, True)
        coming = self.effects(step, at_end=step.state in RUNNING)
        return isinstance(atom, Atom) and (key_of(to_pddl(atom)), positive) in coming

    def effects(self, step: Step, at_end: bool = False) -> Set[Tuple[Key, bool]]:
        """The facts that a step makes true (True) or false, and the functions that it changes (True).

        :param at_end: only those at its end. Conditional and quantified effects never count.
        """
        operator, bindings = self._operator(step)
        effects = operator.effects if operator else ()
        at_end = at_end and operator is not None and operator.durative
        plain = [
            each
            for each in effects
            if not (each.variables or each.conditions) and (each.when == END or not at_end)
        ]
        changed = [(each.atom or each.fluent, not each.negative) for each in plain]
        return {(key_of(to_pddl(ground(what, bindings))), positive) for what, positive in changed}

    def _operator(self, step: Step) -> Tuple[Optional[Operator], Dict[str, str]]:
        """The operator of a step, None when the domain has none such, and the objects for its variables."""
        operator = self.domain.operators.get(step.name)
        if operator is None or len(operator.parameters) != len(step.objects):
            return None, {}
        return operator, {each.name: value for each, value in zip(operator.parameters, step.objects)}


def key_of(text: str) -> Key:
    """The key of a fact or function, of its PDDL text."""
    return tuple(text.lower().replace("(", " ").replace(")", " ").split())


def _text(key: Key) -> str:
    return f"({' '.join(key)})"


def in_words(text: str, domain: Domain, words: Words) -> str:
    """A text with words, in quotes, in the place of the actions and facts in it."""

    def put(found: "re.Match[str]") -> str:
        name = key_of(found[0])[0]
        known = words.step if name in domain.operators else words.fact if name in domain.predicates else None
        return f"“{known(found[0])}”" if known else found[0]

    return ATOM.sub(put, text)


def request_evidence(request: Mapping[str, Any], at: float = 0.0) -> Evidence:
    """A request with its goals."""
    return Evidence(REQUEST, f"{' '.join(request['goals'])}, {request['request']}", time=at)


def matches(about: str, request: Mapping[str, Any]) -> bool:
    """Whether a text is one of a request's goals, or its id."""
    return about == request.get("request") or key_of(about) in map(key_of, request.get("goals") or [])


def checked_about(about: str) -> str:
    """What is asked about, with balanced parentheses.

    :raises QuestionError: it is no PDDL text.
    """
    if about and (not about.startswith("(") or about.count("(") != about.count(")") or not key_of(about)):
        raise QuestionError(f"'{about}' is not PDDL; write it like \"(robot_at kitchen)\"")
    return about


def _step(number: int, shown: Mapping[str, Any]) -> Step:
    objects = tuple(value.lower() for _, value in shown["parameters"])
    times = (shown.get("began"), shown.get("ended"))
    begin = float(shown["start"]), float(shown["duration"])
    return Step(number, str(shown["id"]), shown["text"], objects, shown["state"], *begin, *times)
