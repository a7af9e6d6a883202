# SPDX-License-Identifier: Apache-2.0
"""What an operator does to the knowledge: numeric, conditional, quantified, continuous effects.

Also what it needs at its end, which is asked in the transaction that applies the end effects.
"""

from typing import Dict, List, Mapping, Optional, Union

from merlin_pddl.domain import Operator, open_advice, open_terms
from merlin_pddl.evaluation import TOTAL_COST, Evaluator, changed
from merlin_pddl.formula import END, START, Atom, Effect, Fluent, TimedCondition, ground, to_pddl
from merlin_pddl.knowledge import ASSIGN, Fact, FunctionValue, conjuncts
from merlin_pddl.text_reader import suggestion
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_state import KnowledgeTables
from merlin_rosplan.knowledge.recorded_changes import Note, RecordedChanges
from merlin_rosplan.knowledge.transaction import Transaction

Bindings = Dict[str, str]

#: For each effect at the end that depends on the start (by its number): the quantified objects it allows.
Allowed = Dict[str, List[List[str]]]


def find_operator(state: KnowledgeTables, name: str) -> Operator:
    """The operator of a name.

    :raises UpdateRefused: when the domain has no such operator.
    """
    operators = state.domain.operators
    found = operators.get(name.lower())
    if found is None:
        raise UpdateRefused(f"unknown operator '{name}'{suggestion(name.lower(), operators)}")
    return found


class EffectApplier:
    """Applies the effects of one ground operator inside a transaction.

    :param transaction: takes the changes.
    :param operator: of the domain.
    :param parameters: objects by label of the operator's parameters.
    :raises UpdateRefused: when an object is unknown or a parameter is missing.
    """

    def __init__(self, transaction: Transaction, operator: Operator, parameters: Mapping[str, str]) -> None:
        self._transaction = transaction
        self._state: KnowledgeTables = transaction.state
        self._operator = operator
        self._bindings = self._bind({key.lower(): value for key, value in parameters.items()})

    def _bind(self, parameters: Mapping[str, str]) -> Bindings:
        bindings: Bindings = {}
        for parameter in self._operator.parameters:
            value = parameters.get(parameter.label, "")
            if not value:
                raise UpdateRefused(
                    f"the parameter '{parameter.label}' of '{self._operator.name}' is missing"
                )
            if self._state.spelling(value) is None:
                raise UpdateRefused(
                    f"unknown object '{value}' for '{parameter.label}' of '{self._operator.name}'"
                )
            bindings[parameter.name] = value.lower()
        return bindings

    @property
    def parameters(self) -> List[List[str]]:
        """Label and object of every parameter, in the operator's order."""
        return [
            [parameter.label, self._spelled(self._bindings[parameter.name])]
            for parameter in self._operator.parameters
        ]

    def duration(self) -> Optional[float]:
        """The planned duration, s, when the operator fixes it."""
        evaluator = self._evaluator({})
        for duration in self._operator.durations:
            if duration.op == "=":
                return evaluator.number(duration.value, self._bindings)
        return None

    def allowed_at_start(self, specials: Mapping[str, float]) -> Allowed:
        """What effects at the end that depend on the start allow now."""
        evaluator = self._evaluator(specials)
        found: Allowed = {}
        for number, effect in enumerate(self._operator.effects):
            begin = [timed for timed in effect.conditions if timed.when == START]
            if effect.when != START and begin:
                found[str(number)] = [
                    _objects(effect, bindings)
                    for bindings in evaluator.extend(effect.variables, self._bindings)
                    if self._hold(evaluator, begin, bindings)
                ]
        return found

    def apply(self, when: str, specials: Mapping[str, float], allowed: Allowed) -> List[Note]:
        """Applies the effects of a time; all of them see the state before.

        :param when: START; OVER_ALL for the continuous effects, with all the time that has passed; END.
        :param specials: values of ``?duration`` and ``#t``, s.
        :param allowed: what :meth:`allowed_at_start` said when the execution began.

        Returns how to take them back.

        :raises UpdateRefused: when an effect has no number.
        """
        evaluator = self._evaluator(specials)
        found: List[Union[Fact, FunctionValue]] = []
        for number, effect in enumerate(self._operator.effects):
            if effect.when != when:
                continue
            started = allowed.get(str(number))
            for bindings in evaluator.extend(effect.variables, self._bindings):
                if started is None:
                    applies = self._hold(evaluator, list(effect.conditions), bindings)
                else:
                    rest = [timed for timed in effect.conditions if timed.when != START]
                    applies = _objects(effect, bindings) in started and self._hold(evaluator, rest, bindings)
                if applies:
                    found += self._changes(effect, evaluator, bindings)
        changes = RecordedChanges(self._transaction)
        changes.bring_about([item for item in found if isinstance(item, Fact)])
        for item in found:
            if isinstance(item, FunctionValue):
                self._set(changes, item)
        return changes.notes

    def check_end(self, specials: Mapping[str, float]) -> None:
        """Checks the at-end conditions of a durative operator.

        :param specials: values of ``?duration`` and ``#t``, s.
        :raises UpdateRefused: when some do not hold; names them.
        """
        evaluator = self._evaluator(specials)
        false = [
            part
            for timed in self._operator.conditions
            if timed.when == END
            for part in conjuncts(timed.condition)
            if not evaluator.holds(part, self._bindings)
        ]
        if false:
            objects = {name: self._spelled(value) for name, value in self._bindings.items()}
            texts = [to_pddl(ground(part, objects)) for part in false]
            raise UpdateRefused(f"at its end {', '.join(f'{text} does not hold' for text in texts)}")

    @staticmethod
    def _hold(evaluator: Evaluator, conditions: List[TimedCondition], bindings: Bindings) -> bool:
        return all(evaluator.holds(timed.condition, bindings) for timed in conditions)

    def _evaluator(self, specials: Mapping[str, float]) -> Evaluator:
        return Evaluator(self._state.domain, self._state, specials)

    def _changes(
        self, effect: Effect, evaluator: Evaluator, bindings: Bindings
    ) -> List[Union[Fact, FunctionValue]]:
        """What an effect changes: one thing, or nothing."""
        target = effect.atom or effect.fluent
        assert target is not None
        if self._state.sensed.get(target.name) is not None:
            return []  # the sensing interface keeps it
        args = tuple(self._spelled(bindings.get(arg, arg)) for arg in target.args)
        if isinstance(target, Atom):
            return [Fact(target.name, args, effect.negative)]
        assert isinstance(target, Fluent) and effect.value is not None
        operand = evaluator.number(effect.value, bindings)
        if operand is None:
            reason = "a function it uses has no value, or it divides by zero"
            for term in open_terms(self._operator, effect):
                if evaluator.number(term) is None:
                    reason = open_advice(effect, term)
            raise UpdateRefused(
                f"the effect of '{self._operator.name}' on ({' '.join((target.name, *args))}) has no number: "
                f"{reason}"
            )
        current = self._state.value((target.name, *[arg.lower() for arg in args]))
        if effect.op != ASSIGN and current is None:
            if target == TOTAL_COST:
                return []  # it only rates plans; it has no value, so no condition reads it
            raise UpdateRefused(f"({' '.join((target.name, *args))}) has no value that could {effect.op}")
        return [FunctionValue(target.name, args, operand, op=effect.op)]

    def _spelled(self, name: str) -> str:
        return self._state.spelling(name) or name

    def _set(self, changes: RecordedChanges, value: FunctionValue) -> None:
        before = self._state.value(value.key)
        result = changed(value.op, before, value.value)
        if result is None:
            raise UpdateRefused(f"{value.text()}: {before} {value.op} {value.value} is not a number")
        changes.set(FunctionValue(value.name, value.args, result), value.op)


def _objects(effect: Effect, bindings: Mapping[str, str]) -> List[str]:
    """What the quantified variables of an effect stand for."""
    return [bindings[variable.name] for variable in effect.variables]
