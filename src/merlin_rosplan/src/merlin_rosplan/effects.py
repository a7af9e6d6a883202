"""Applies what an operator does to the knowledge: numeric, conditional, quantified, continuous.

An execution is named by its token. START keeps under the token what it changed (for ROLLBACK), when it
happened (for continuous effects) and what its end effects depend on; END and ROLLBACK drop it. The notes are
stored with the knowledge, so an action that outlives the knowledge base still ends well.
"""

from typing import Any, Dict, List, Mapping, Optional, Tuple

from merlin_rosplan.domain import Operator
from merlin_rosplan.evaluation import Evaluator, arithmetic
from merlin_rosplan.formula import END, OVER_ALL, START, Atom, Effect, Fluent, TimedCondition
from merlin_rosplan.knowledge import ASSIGN, DECREASE, INCREASE, OPERATIONS, Fact, FunctionValue
from merlin_rosplan.knowledge_checks import KnowledgeError
from merlin_rosplan.knowledge_state import KnowledgeState
from merlin_rosplan.pddl_text import suggestion
from merlin_rosplan.transaction import Transaction

#: Tokens of ended executions that are remembered, so that a repeated END changes nothing.
REMEMBERED = 256

TOTAL_COST = Fluent("total-cost")

Bindings = Dict[str, str]


class EffectApplier:
    """Applies the effects of one execution of an operator inside a transaction.

    Parameters
    ----------
    transaction: takes the changes.
    operator_name: PDDL operator.
    parameters: objects by label of the operator's parameters.
    token: names the execution; empty: START can not be rolled back.

    Raises
    ------
    KnowledgeError: operator or object is unknown, or a parameter is missing.
    """

    def __init__(
        self, transaction: Transaction, operator_name: str, parameters: Mapping[str, str], token: str
    ) -> None:
        self._transaction = transaction
        self._state: KnowledgeState = transaction.state
        self._token = token
        operators = self._state.domain.operators
        found = operators.get(operator_name.lower())
        if found is None:
            hint = suggestion(operator_name.lower(), operators)
            raise KnowledgeError(f"unknown operator '{operator_name}'{hint}")
        self._operator: Operator = found
        self._bindings = self._bind({key.lower(): value for key, value in parameters.items()})

    def _bind(self, parameters: Mapping[str, str]) -> Bindings:
        bindings: Bindings = {}
        for parameter in self._operator.parameters:
            value = parameters.get(parameter.label, "")
            if not value:
                raise KnowledgeError(
                    f"the parameter '{parameter.label}' of '{self._operator.name}' is missing"
                )
            if self._state.spelling(value) is None:
                raise KnowledgeError(
                    f"unknown object '{value}' for '{parameter.label}' of '{self._operator.name}'"
                )
            bindings[parameter.name] = value.lower()
        return bindings

    # --- phases ---------------------------------------------------------------------------------

    def start(self) -> str:
        """At-start effects of a durative operator; nothing for a plain one. Returns what is worth telling."""
        if not self._operator.durative:
            return ""
        known = self._note()
        if known is not None:
            if known.get("ended"):
                raise KnowledgeError(f"the execution '{self._token}' has ended")
            return "started already"
        evaluator = self._evaluator({})
        duration = self._duration(evaluator)
        specials = {} if duration is None else {"?duration": duration}
        later = self._conditions_at_start(self._evaluator(specials))
        changes = self._apply(START, specials, later)
        if self._token:
            note: Dict[str, object] = {
                "operator": self._operator.name,
                "since": self._transaction.now,
                "duration": duration,
                "later": later,
                "undo": changes,
            }
            self._transaction.note(self._state.executions, self._token, note)
        return ""

    def end(self) -> str:
        """At-end effects of a durative operator, all effects of a plain one."""
        note = self._note()
        if note is not None and note.get("ended"):
            return "ended already"
        if not self._operator.durative:
            self._apply(START, {}, {})
        else:
            self._apply(END, self._specials(note), (note or {}).get("later", {}))
        self._remember_end()
        return ""

    def rollback(self) -> str:
        """Restores what START changed, where nobody has changed it since."""
        note = self._note()
        if note is None or note.get("ended"):
            return "nothing to restore"
        kept = []
        for entry in reversed(note["undo"]):
            if entry["kind"] == "fact":
                self._restore_fact(entry)
            elif not self._restore_value(entry):
                kept.append(entry["key"][0])
        self._remember_end()
        return f"changed by others since, not restored: {', '.join(kept)}" if kept else ""

    # --- notes ----------------------------------------------------------------------------------

    def _note(self) -> Optional[Dict[str, Any]]:
        row = self._state.executions.get(self._token) if self._token else None
        if row is None:
            return None
        if row.data.get("operator") != self._operator.name:
            raise KnowledgeError(
                f"the token '{self._token}' belongs to the operator '{row.data.get('operator')}'"
            )
        return row.data

    def _remember_end(self) -> None:
        if not self._token:
            return
        ended: Dict[str, object] = {"operator": self._operator.name, "ended": True}
        self._transaction.note(self._state.executions, self._token, None)
        self._transaction.note(self._state.executions, self._token, ended)
        old = [row for row in self._state.executions.all() if row.data.get("ended")]
        for row in old[: max(0, len(old) - REMEMBERED)]:
            self._transaction.note(self._state.executions, row.name, None)

    def _specials(self, note: Optional[Dict[str, Any]]) -> Dict[str, float]:
        if note is None:
            duration = self._duration(self._evaluator({}))
            return {} if duration is None else {"?duration": duration, "#t": duration}
        elapsed = max(0.0, (self._transaction.now - note["since"]) / 1e9)
        duration = note["duration"]
        return {"?duration": elapsed if duration is None else duration, "#t": elapsed}

    def _duration(self, evaluator: Evaluator) -> Optional[float]:
        """The planned duration, s, when the operator fixes it."""
        for duration in self._operator.durations:
            if duration.op == "=":
                return evaluator.number(duration.value, self._bindings)
        return None

    def _evaluator(self, specials: Mapping[str, float]) -> Evaluator:
        return Evaluator(self._state.domain, self._state, specials)

    # --- effects --------------------------------------------------------------------------------

    def _conditions_at_start(self, evaluator: Evaluator) -> Dict[str, List[List[str]]]:
        """For effects at the end that depend on the start: the quantified objects it allows them for."""
        found: Dict[str, List[List[str]]] = {}
        for number, effect in enumerate(self._operator.effects):
            begin = [timed for timed in effect.conditions if timed.when == START]
            if effect.when != START and begin:
                found[str(number)] = [
                    _objects(effect, bindings)
                    for bindings in evaluator.extend(effect.variables, self._bindings)
                    if self._hold(evaluator, begin, bindings)
                ]
        return found

    @staticmethod
    def _hold(evaluator: Evaluator, conditions: List[TimedCondition], bindings: Bindings) -> bool:
        return all(evaluator.holds(timed.condition, bindings) for timed in conditions)

    def _apply(
        self, when: str, specials: Mapping[str, float], later: Mapping[str, List[List[str]]]
    ) -> List[Dict[str, Any]]:
        """Applies the effects of a time; all of them see the state before. Returns how to undo them."""
        evaluator = self._evaluator(specials)
        deletes: List[Fact] = []
        adds: List[Fact] = []
        values: List[Tuple[FunctionValue, str]] = []
        for number, effect in enumerate(self._operator.effects):
            if effect.when != when and not (when == END and effect.when == OVER_ALL):
                continue
            started = later.get(str(number))
            for bindings in evaluator.extend(effect.variables, self._bindings):
                if started is None:
                    applies = self._hold(evaluator, list(effect.conditions), bindings)
                else:
                    rest = [timed for timed in effect.conditions if timed.when != START]
                    applies = _objects(effect, bindings) in started and self._hold(evaluator, rest, bindings)
                if applies:
                    self._collect(effect, evaluator, bindings, deletes, adds, values)
        undo: List[Dict[str, Any]] = []
        for fact in deletes:
            self._delete(fact, undo)
        for fact in adds:
            self._add(fact, undo)
        for value, op in values:
            self._set(value, op, undo)
        return undo

    def _collect(
        self,
        effect: Effect,
        evaluator: Evaluator,
        bindings: Bindings,
        deletes: List[Fact],
        adds: List[Fact],
        values: List[Tuple[FunctionValue, str]],
    ) -> None:
        target = effect.atom or effect.fluent
        assert target is not None
        if self._state.sensed.get(target.name) is not None:
            return  # the sensing interface keeps it
        args = tuple(self._spelled(bindings.get(arg, arg)) for arg in target.args)
        if isinstance(target, Atom):
            (deletes if effect.negative else adds).append(Fact(target.name, args))
            return
        assert isinstance(target, Fluent) and effect.value is not None
        operand = evaluator.number(effect.value, bindings)
        if operand is None:
            raise KnowledgeError(
                f"the effect of '{self._operator.name}' on ({' '.join((target.name, *args))}) has no number: "
                "a function it uses has no value, or it divides by zero"
            )
        current = self._state.value((target.name, *[arg.lower() for arg in args]))
        if effect.op != ASSIGN and current is None:
            if target == TOTAL_COST:
                return  # it only judges plans; nobody gave it a value, so nobody asks for it
            raise KnowledgeError(f"({' '.join((target.name, *args))}) has no value that could {effect.op}")
        values.append((FunctionValue(target.name, args, operand), effect.op))

    def _spelled(self, name: str) -> str:
        return self._state.spelling(name) or name

    def _delete(self, fact: Fact, undo: List[Dict[str, Any]]) -> None:
        if self._state.holds(fact.key):
            undo.append({"kind": "fact", "name": fact.name, "args": list(fact.args), "was": "true"})
            self._transaction.drop(self._state.facts, fact.key)

    def _add(self, fact: Fact, undo: List[Dict[str, Any]]) -> None:
        known = self._state.facts.get(fact.key)
        if known is None or known.negative:
            was = "absent" if known is None else "negative"
            undo.append({"kind": "fact", "name": fact.name, "args": list(fact.args), "was": was})
            self._transaction.add_fact(fact)

    def _set(self, value: FunctionValue, op: str, undo: List[Dict[str, Any]]) -> None:
        before = self._state.value(value.key)
        result: Optional[float] = value.value
        if op != ASSIGN:
            result = arithmetic(OPERATIONS[op], (before, value.value))
        if result is None:
            raise KnowledgeError(f"{value.text()}: {before} {op} {value.value} is no number")
        self._transaction.add_value(FunctionValue(value.name, value.args, result))
        relative = op in (INCREASE, DECREASE)
        delta = result - before if relative and before is not None else None
        undo.append(
            {
                "kind": "value",
                "name": value.name,
                "args": list(value.args),
                "key": list(value.key),
                "before": before,
                "after": result,
                "delta": delta,
            }
        )

    def _restore_fact(self, entry: Dict[str, Any]) -> None:
        fact = Fact(entry["name"], tuple(entry["args"]), entry["was"] == "negative")
        if entry["was"] == "absent":
            self._transaction.drop(self._state.facts, fact.key)
        elif all(self._state.spelling(arg) is not None for arg in fact.args):
            self._transaction.add_fact(fact)

    def _restore_value(self, entry: Dict[str, Any]) -> bool:
        """Restores a value; False when others assigned it meanwhile. Relative changes are taken back."""
        key = tuple(entry["key"])
        current = self._state.value(key)
        name, args = entry["name"], tuple(entry["args"])
        if current == entry["after"]:
            if entry["before"] is None:
                self._transaction.drop(self._state.values, key)
            else:
                self._transaction.add_value(FunctionValue(name, args, entry["before"]))
            return True
        if current is None or entry["delta"] is None:
            return False
        self._transaction.add_value(FunctionValue(name, args, current - entry["delta"]))
        return True


def _objects(effect: Effect, bindings: Mapping[str, str]) -> List[str]:
    """What the quantified variables of an effect stand for."""
    return [bindings[variable.name] for variable in effect.variables]
