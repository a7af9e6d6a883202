# SPDX-License-Identifier: Apache-2.0
"""The journal of executions: what began, what it changed, and how it is closed, each in one transaction.

An execution of an operator is named by its token. START opens it and notes with the knowledge what is needed
to close it without its owner: the changes it made, the facts that hold while it runs, the facts that hold
once it was interrupted. END, ROLLBACK and INTERRUPT close it; so an execution that outlives the knowledge
base, or whose owner died, is closed as if nothing had happened in between.
"""

from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from merlin_pddl.formula import END, OVER_ALL, START
from merlin_pddl.knowledge import Fact
from merlin_pddl.text_reader import Expression, Node, PddlError, name_of, read_expression
from merlin_rosplan.knowledge.effect_applier import Allowed, EffectApplier, find_operator
from merlin_rosplan.knowledge.interruption import Count, apply_continuous, apply_counts, passed, split
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_state import KnowledgeTables
from merlin_rosplan.knowledge.knowledge_state import Note as StoredNote
from merlin_rosplan.knowledge.recorded_changes import Note, RecordedChanges, fact_of, take_back
from merlin_rosplan.knowledge.transaction import Transaction

#: Tokens of closed executions that are remembered, so that a repeated END changes nothing.
REMEMBERED = 256

#: A literal as it stands in the journal: predicate, arguments, whether it is negated.
Literal = List[Any]

_Row = Dict[str, Any]


class OpenExecution(NamedTuple):
    """An execution that has begun and is not closed."""

    token: str
    operator: str
    #: label and object, in the operator's order
    parameters: Tuple[Tuple[str, str], ...]
    owner: str
    #: ns of ROS time
    began: int
    #: literals that hold only while it runs, as PDDL text
    meanwhile: Tuple[str, ...] = ()


def open_executions(state: KnowledgeTables, owner: str = "") -> List[OpenExecution]:
    """The executions that are open, oldest first.

    :param owner: only of this node, with or without its leading slash; empty: of every node.
    """
    return [
        OpenExecution(
            row.name,
            row.data["operator"],
            tuple((label, value) for label, value in row.data.get("parameters", ())),
            row.data.get("owner", ""),
            row.data["since"],
            tuple(_fact(literal).text() for literal in row.data.get("holds", ())),
        )
        for row in state.executions.all()
        if not row.data.get("ended")
        and (not owner or row.data.get("owner", "").lstrip("/") == owner.lstrip("/"))
    ]


class Executions:
    """Opens and closes executions inside a transaction.

    Every method returns a sentence for the caller, and raises :class:`UpdateRefused` when the request
    is refused as a whole.

    :param transaction: takes the changes.
    """

    def __init__(self, transaction: Transaction) -> None:
        self._transaction = transaction
        self._state: KnowledgeTables = transaction.state

    def start(
        self,
        token: str,
        operator_name: str,
        parameters: Mapping[str, str],
        owner: str = "",
        while_running: Sequence[str] = (),
        if_interrupted: Sequence[str] = (),
    ) -> str:
        """At-start effects of a durative operator, none of a plain one; then what holds while it runs.

        :param token: names the execution; empty: it is not journalled.
        :param parameters: objects by label of the operator's parameters.
        :param owner: the node that carries it out.
        :param while_running: ground PDDL literals that hold until it is closed.
        :param if_interrupted: ground PDDL literals that hold after it was interrupted, and numeric effects
            that count then, with ``#t`` (s that have passed, at most the planned ones) and ``?duration``.
        """
        operator = find_operator(self._state, operator_name)
        applier = EffectApplier(self._transaction, operator, parameters)
        if not token and (while_running or if_interrupted):
            raise UpdateRefused("an execution with while_running or if_interrupted needs a token")
        known = self._row(token, operator.name)
        if known is not None:
            if known.get("ended"):
                raise UpdateRefused(f"the execution '{token}' has ended")
            _check_objects(token, known, applier)
            return "started already"
        declared, counts = split(if_interrupted, self._state)
        holds, interrupted = self._literals(while_running), self._literals(declared)
        duration = applier.duration() if operator.durative else None
        allowed: Allowed = {}
        undo: List[Note] = []
        if operator.durative:
            specials = {} if duration is None else {"?duration": duration}
            allowed = applier.allowed_at_start(specials)
            undo = applier.apply(START, specials, allowed)
        running = RecordedChanges(self._transaction)
        running.bring_about(map(_fact, holds))
        if token:
            row: Dict[str, object] = {
                "operator": operator.name,
                "parameters": applier.parameters,
                "owner": owner,
                "since": self._transaction.now,
                "passed": self._transaction.passed,
                "duration": duration,
                "later": allowed,
                "undo": undo,
                "holds": holds,
                "running": running.notes,
                "interrupted": interrupted,
                "counts": counts,
            }
            self._transaction.note(self._state.executions, token, row)
        return ""

    def end(self, token: str, operator_name: str, parameters: Mapping[str, str]) -> str:
        """At-end effects of a durative operator, all effects of a plain one.

        A durative one whose at-end conditions do not hold is refused: it stays open. They see what its
        continuous effects have changed. A token that is not known counts as begun now: the knowledge base may
        have lost its journal.
        """
        operator = find_operator(self._state, operator_name)
        row = self._row(token, operator.name)
        if row is not None and row.get("ended"):
            return "ended already"
        applier = EffectApplier(self._transaction, operator, parameters)
        if row is not None:
            _check_objects(token, row, applier)
            self._no_longer_running(token, row)
        if operator.durative:
            specials, allowed = self._specials(row, applier), (row or {}).get("later", {})
            applier.apply(OVER_ALL, specials, allowed)
            applier.check_end(specials)
            applier.apply(END, specials, allowed)
        else:
            applier.apply(START, {}, {})
        if token:
            self._close(token, operator.name)
        return ""

    def rollback(self, token: str, operator_name: str = "") -> str:
        """Restores what START changed, where others have not assigned it since.

        A START that comes behind it is refused: its client has given it up, and it may come late.
        """
        row = self._open_row(token, operator_name)
        if row is None:
            operator = self._state.domain.operators.get(operator_name.lower())
            if token and operator is not None and self._state.executions.get(token) is None:
                self._close(token, operator.name)
            return "nothing to restore"
        self._no_longer_running(token, row)
        return self._restore(token, row)

    def interrupt(self, token: str, operator_name: str = "") -> str:
        """What `if_interrupted` of START says holds from now on; without that, as :meth:`rollback`.

        Continuous effects count for the time that has passed.
        """
        row = self._open_row(token, operator_name)
        if row is None:
            return "nothing to interrupt"
        self._no_longer_running(token, row)
        declared = list(map(_fact, row.get("interrupted", [])))
        counts: List[Count] = row.get("counts", [])
        specials = passed(self._elapsed(row), row.get("duration"))
        operator = find_operator(self._state, row["operator"])
        notes = [apply_continuous(self._transaction, operator, dict(row.get("parameters", ())), specials)]
        if not declared and not counts:
            notes.append(self._restore(token, row))
            return "; ".join(filter(None, notes))
        # An execution has to come to its end whatever happened to the objects it was about.
        possible = [fact for fact in declared if fact.negative or self._transaction.acceptable(fact)]
        RecordedChanges(self._transaction).bring_about(possible)
        failed = apply_counts(self._transaction, counts, specials)
        self._close(token, row["operator"])
        gone = [fact.text() for fact in declared if fact not in possible]
        notes.append(f"not applied, because an object is gone: {', '.join(gone)}" if gone else "")
        notes.append(f"not applied, because there is no number: {', '.join(failed)}" if failed else "")
        return "; ".join(filter(None, notes))

    # --- rows -----------------------------------------------------------------------------------

    def _row(self, token: str, operator_name: str) -> Optional[_Row]:
        row = self._state.executions.get(token) if token else None
        if row is None:
            return None
        if row.data.get("operator") != operator_name:
            raise UpdateRefused(f"the token '{token}' belongs to the operator '{row.data.get('operator')}'")
        return row.data

    def _open_row(self, token: str, operator_name: str) -> Optional[_Row]:
        row = self._state.executions.get(token) if token else None
        if row is None or row.data.get("ended"):
            return None
        return self._row(token, operator_name.lower() or str(row.data["operator"]))

    def _restore(self, token: str, row: _Row) -> str:
        kept = take_back(self._transaction, row["undo"])
        self._close(token, row["operator"])
        return f"changed by others since, not restored: {', '.join(kept)}" if kept else ""

    def _close(self, token: str, operator_name: str) -> None:
        executions = self._state.executions
        self._transaction.note(executions, token, None)
        self._transaction.note(executions, token, {"operator": operator_name, "ended": True})
        ended = [row for row in executions.all() if row.data.get("ended")]
        for row in ended[: max(0, len(ended) - REMEMBERED)]:
            self._transaction.note(executions, row.name, None)

    def _specials(self, row: Optional[_Row], applier: EffectApplier) -> Dict[str, float]:
        if row is None:
            duration = applier.duration()
            return {} if duration is None else {"?duration": duration, "#t": duration}
        elapsed, duration = self._elapsed(row), row["duration"]
        return {"?duration": elapsed if duration is None else duration, "#t": elapsed}

    def _elapsed(self, row: _Row) -> float:
        """How long an execution has run, s; the clock may have been set meanwhile."""
        if "passed" in row:
            return max(0.0, self._transaction.passed - row["passed"])
        return max(0.0, (self._transaction.now - row["since"]) / 1e9)

    # --- literals -------------------------------------------------------------------------------

    def _no_longer_running(self, token: str, row: _Row) -> None:
        """Undoes `while_running`; facts that another open execution needs pass on to that execution."""
        mine: List[Note] = []
        for note in row.get("running", []):
            heir = self._heir(token, note)
            if heir is None:
                mine.append(note)
            else:
                self._bequeath(note, self._state.executions.rows[token], self._state.executions.rows[heir])
        take_back(self._transaction, mine)

    def _bequeath(self, note: Note, mine: StoredNote, heir: StoredNote) -> None:
        running: List[Note] = heir.data["running"]
        both = [note, *running] if mine.order < heir.order else [*running, note]
        self._transaction.note(self._state.executions, heir.name, {**heir.data, "running": both})

    def _heir(self, token: str, note: Note) -> Optional[str]:
        wanted = (fact_of(note).key, note["was"] == "true")
        for row in self._state.executions.all():
            if row.name != token and not row.data.get("ended"):
                held = map(_fact, row.data.get("holds", ()))
                if any((fact.key, fact.negative) == wanted for fact in held):
                    return row.name
        return None

    def _literals(self, texts: Sequence[str]) -> List[Literal]:
        found: List[Literal] = []
        for text in texts:
            try:
                for fact in _read_literals(read_expression(text)):
                    checked = self._transaction.checked(fact)
                    assert isinstance(checked, Fact)
                    if self._state.sensed.get(checked.name.lower()) is None:
                        found.append([checked.name, list(checked.args), checked.negative])
            except (PddlError, UpdateRefused) as error:
                raise UpdateRefused(f"'{text}': {error}") from error
        return found


def _check_objects(token: str, row: _Row, applier: EffectApplier) -> None:
    began = [value for _, value in row.get("parameters", applier.parameters)]
    if [value.lower() for value in began] != [value.lower() for _, value in applier.parameters]:
        raise UpdateRefused(f"the token '{token}' belongs to ({' '.join([row['operator'], *began])})")


def _read_literals(node: Node) -> List[Fact]:
    if not isinstance(node, Expression):
        raise node.error(f"expected a literal in parentheses, found '{node}'")
    if node.head == "and":
        return [fact for part in node[1:] for fact in _read_literals(part)]
    negative = node.head == "not"
    atom = node[1] if negative and len(node) == 2 else node
    if not isinstance(atom, Expression) or not atom or atom.head in ("not", "="):
        raise node.error("expected a literal such as (checked kitchen) or (not (checked kitchen))")
    names = [str(name_of(part, "a name")) for part in atom]
    return [Fact(names[0], tuple(names[1:]), negative)]


def _fact(literal: Literal) -> Fact:
    name, args, negative = literal
    return Fact(name, tuple(args), negative)
