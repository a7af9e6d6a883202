# SPDX-License-Identifier: Apache-2.0
"""Applies the effects of actions to the knowledge base, and undoes those of an interrupted action."""

import threading
from typing import Callable, Dict, List, NamedTuple, Sequence

from diagnostic_msgs.msg import KeyValue
from merlin_msgs.srv import ApplyEffects, ApplyEffectsRequest
from rosplan_knowledge_msgs.msg import DomainFormula, DomainOperator, KnowledgeItem

from merlin_actions.core.effect_changes import EffectChanges, FactChange
from merlin_actions.core.ending import Closing
from merlin_planning.knowledge_client import ADD, REMOVE, KnowledgeClient, KnowledgeError, Update, fact
from merlin_planning.knowledge_text import to_pddl
from merlin_ros.service_proxy import ServiceProxy, when_back

APPLY_LIMIT = 10.0  # s of wall time for one transaction


class Opening(NamedTuple):
    """An execution as the knowledge base opens it."""

    parameters: Sequence[KeyValue]
    token: str
    """Id of the execution in the journal of the knowledge base."""
    owner: str
    """The node that carries it out."""
    while_running: Sequence[KnowledgeItem]
    """Literals that hold until it is closed."""
    if_interrupted: Sequence[KnowledgeItem]
    """Literals that hold after an interruption; none: what was before."""
    counts: Sequence[str] = ()
    """Numeric effects of an interruption, as PDDL text."""
    robot: str = ""
    """That runs it, of several."""
    if_stopped_at: Sequence[str] = ()
    """Literals for a robot that was stopped at a point of interest, which is ``?here`` in them."""

    @property
    def binding(self) -> Dict[str, str]:
        """Variable without ``?`` → object."""
        return {parameter.key: parameter.value for parameter in self.parameters}


class Effects:
    """What an operator does to the knowledge base; one instance per operator.

    Both methods raise :class:`KnowledgeError` when the knowledge was not changed, and
    :class:`merlin_ros.service_proxy.ServiceError` when it may not have been.
    """

    def open(self, opening: Opening) -> None:
        """Applies what is true as soon as the action begins, and what holds while it runs.

        Where no answer came, it is to be closed all the same.
        """
        raise NotImplementedError

    def close(self, opening: Opening, closing: Closing, on_gone: Callable[[], None]) -> None:
        """Applies what is true after it.

        :param on_gone: called once when the knowledge base does not answer and is waited for.
        """
        raise NotImplementedError


class ServiceEffects(Effects):
    """Effects through ``<kb>/apply_effects``, which journals the execution.

    A knowledge base that died is waited for when an execution is closed: it comes back with its state file,
    and what it knows has to become true again.
    """

    def __init__(self, operator: str, knowledge: KnowledgeClient) -> None:
        self._operator = operator
        self._apply = ServiceProxy(f"{knowledge.name}/apply_effects", ApplyEffects, timeout=APPLY_LIMIT)

    def open(self, opening: Opening) -> None:
        """See :meth:`Effects.open`."""
        self._call(
            opening,
            ApplyEffectsRequest.START,
            owner=opening.owner,
            while_running=[to_pddl(item) for item in opening.while_running],
            if_interrupted=[*(to_pddl(item) for item in opening.if_interrupted), *opening.counts],
        )

    def close(self, opening: Opening, closing: Closing, on_gone: Callable[[], None]) -> None:
        """See :meth:`Effects.close`; one whose end the knowledge base refuses is closed as interrupted."""
        try:
            when_back(lambda: self._call(opening, int(closing)), on_gone=on_gone)
        except KnowledgeError:
            if closing is Closing.END:  # its effects did not come true
                self.close(opening, Closing.INTERRUPT, on_gone)
            raise

    def _call(self, opening: Opening, phase: int, **fields: object) -> None:
        answer = self._apply(
            operator_name=self._operator,
            parameters=list(opening.parameters),
            phase=phase,
            token=opening.token,
            **fields,
        )
        if not answer.success:
            raise KnowledgeError(f"effects of {self._operator}: {answer.message}")


class UpdateEffects(Effects):
    """Effects through ``update_array``, for a knowledge base without ``apply_effects`` (original ROSPlan).

    :raises ValueError: for an operator with effects that ROSPlan's messages cannot carry.
    """

    def __init__(self, operator: DomainOperator, knowledge: KnowledgeClient) -> None:
        name = operator.formula.name
        if (
            operator.at_start_assign_effects
            or operator.at_end_assign_effects
            or operator.probabilistic_effects
        ):
            raise ValueError(
                f"operator {name} has numeric or probabilistic effects, which {knowledge.name} cannot apply; "
                "use MERLIN's knowledge base"
            )
        self._knowledge = knowledge
        # ROSPlan's messages do not say that an operator is plain.
        later = (
            operator.at_end_del_effects,
            operator.at_end_add_effects,
            operator.over_all_simple_condition,
            operator.over_all_neg_condition,
        )
        start = [
            *_changes(operator.at_start_del_effects, False),
            *_changes(operator.at_start_add_effects, True),
        ]
        end = [*_changes(operator.at_end_del_effects, False), *_changes(operator.at_end_add_effects, True)]
        self._lock = threading.Lock()  # guards the changes, and keeps a query and its update together
        self._changes = EffectChanges(start, end, plain=not any(later))

    def open(self, opening: Opening) -> None:
        """See :meth:`Effects.open`."""
        if opening.counts:
            raise KnowledgeError(
                f"{self._knowledge.name} cannot apply {', '.join(opening.counts)} of if_interrupted; "
                "use MERLIN's knowledge base"
            )
        while_running = _literals(opening.while_running)
        with self._lock:
            self._update(self._changes.open(opening.token, opening.binding, while_running, self._true_now))

    def close(self, opening: Opening, closing: Closing, on_gone: Callable[[], None]) -> None:
        """See :meth:`Effects.close`; it does not wait."""
        if_interrupted = _literals(opening.if_interrupted)
        with self._lock:
            self._update(self._changes.close(opening.token, opening.binding, closing, if_interrupted))

    def _update(self, changes: Sequence[FactChange]) -> None:
        self._knowledge.update(
            [
                Update(ADD if change.becomes_true else REMOVE, fact(change.name, *change.arguments))
                for change in changes
            ]
        )

    def _true_now(self, changes: Sequence[FactChange]) -> List[bool]:
        return self._knowledge.query([fact(change.name, *change.arguments) for change in changes])


def _changes(formulas: Sequence[DomainFormula], becomes_true: bool) -> List[FactChange]:
    return [
        FactChange(becomes_true, formula.name, tuple(pair.key for pair in formula.typed_parameters))
        for formula in formulas
    ]


def _literals(items: Sequence[KnowledgeItem]) -> List[FactChange]:
    return [
        FactChange(not item.is_negative, item.attribute_name, tuple(pair.value for pair in item.values))
        for item in items
    ]


def effects_of(operator: DomainOperator, knowledge: KnowledgeClient) -> Effects:
    """The effects of an operator, through the best service that the knowledge base offers.

    :raises ValueError: when they cannot be expressed.
    :raises merlin_ros.service_proxy.ServiceError: when the master does not say what it offers.
    """
    # One that is busy and takes no connection is ours all the same.
    if ServiceProxy(f"{knowledge.name}/apply_effects", ApplyEffects).offered():
        return ServiceEffects(operator.formula.name, knowledge)
    return UpdateEffects(operator, knowledge)
