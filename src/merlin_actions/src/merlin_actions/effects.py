"""Applies the effects of actions to the knowledge base, and undoes those of an interrupted action."""

import threading
from typing import Callable, Dict, List, NamedTuple, Sequence, Tuple

from diagnostic_msgs.msg import KeyValue
from merlin_msgs.srv import ApplyEffects, ApplyEffectsRequest
from rosplan_knowledge_msgs.msg import DomainFormula, DomainOperator, KnowledgeItem

from merlin_actions.core.ending import Closing
from merlin_ros.deadline import Deadline
from merlin_ros.service_proxy import ServiceProxy, ServiceUnavailable
from merlin_sm.knowledge_client import ADD, REMOVE, KnowledgeClient, KnowledgeError, Update, fact
from merlin_sm.knowledge_text import to_pddl

APPLY_LIMIT = 10.0  # s of wall time for one transaction
RETURN_LIMIT = 30.0  # s of running time for a knowledge base that died to come back
RETRY = 0.3  # s of wall time between two attempts to reach it

_PHASES = {
    Closing.END: ApplyEffectsRequest.END,
    Closing.INTERRUPT: ApplyEffectsRequest.INTERRUPT,
    Closing.ROLLBACK: ApplyEffectsRequest.ROLLBACK,
}


class Opening(NamedTuple):
    """An execution as the knowledge base opens it."""

    parameters: Sequence[KeyValue]
    token: str
    """Names the execution."""
    owner: str
    """The node that carries it out."""
    while_running: Sequence[KnowledgeItem]
    """Literals that hold until it is closed."""
    if_interrupted: Sequence[KnowledgeItem]
    """Literals that hold after an interruption; none: what was before."""


class Effects:
    """What an operator does to the knowledge base; one instance per operator.

    Both methods raise :class:`KnowledgeError` or :class:`merlin_ros.service_proxy.ServiceError` when the
    knowledge was not changed.
    """

    def open(self, opening: Opening) -> None:
        """Applies what is true as soon as the action begins, and what holds while it runs."""
        raise NotImplementedError

    def close(self, opening: Opening, closing: Closing) -> None:
        """Applies what is true after it."""
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
            if_interrupted=[to_pddl(item) for item in opening.if_interrupted],
        )

    def close(self, opening: Opening, closing: Closing) -> None:
        """See :meth:`Effects.close`; one whose end the knowledge base refuses is closed as interrupted."""
        try:
            when_back(lambda: self._call(opening, _PHASES[closing]))
        except KnowledgeError:
            if closing is Closing.END:  # its effects did not come true
                self.close(opening, Closing.INTERRUPT)
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
        self._variables = {parameter.key for parameter in operator.formula.typed_parameters}
        end = [*operator.at_end_del_effects, *operator.at_end_add_effects]
        # ROSPlan reports a plain operator as at-start only; its effects have to wait until they came true.
        over_all = operator.over_all_simple_condition or operator.over_all_neg_condition
        plain = not end and not over_all
        self._start = [] if plain else self._steps(operator, "start")
        self._end = self._steps(operator, "start" if plain else "end")
        self._undo: Dict[str, List[Update]] = {}
        self._take_back: Dict[str, List[Update]] = {}

    def open(self, opening: Opening) -> None:
        """See :meth:`Effects.open`."""
        start = self._ground(self._start, opening.parameters)
        meanwhile = _updates(opening.while_running)
        self._undo[opening.token] = self._reverse(start)
        self._take_back[opening.token] = self._reverse(meanwhile)
        self._knowledge.update([*start, *meanwhile])

    def close(self, opening: Opening, closing: Closing) -> None:
        """See :meth:`Effects.close`."""
        undo = self._undo.pop(opening.token, [])
        updates = self._take_back.pop(opening.token, [])
        if closing is Closing.END:
            updates += self._ground(self._end, opening.parameters)
        elif closing is Closing.INTERRUPT and opening.if_interrupted:
            updates += _updates(opening.if_interrupted)
        else:
            updates += undo
        self._knowledge.update(updates)

    def _reverse(self, updates: Sequence[Update]) -> List[Update]:
        """What undoes some updates: only of what they change now."""
        held = self._knowledge.query([update.item for update in updates]) if updates else []
        return [
            Update(ADD if update.kind == REMOVE else REMOVE, update.item)
            for update, was_true in zip(updates, held)
            if was_true == (update.kind == REMOVE)
        ]

    @staticmethod
    def _steps(operator: DomainOperator, time: str) -> List[Tuple[int, DomainFormula]]:
        deletes = getattr(operator, f"at_{time}_del_effects")
        adds = getattr(operator, f"at_{time}_add_effects")
        return [(REMOVE, formula) for formula in deletes] + [(ADD, formula) for formula in adds]

    def _ground(
        self, steps: Sequence[Tuple[int, DomainFormula]], parameters: Sequence[KeyValue]
    ) -> List[Update]:
        binding = {parameter.key: parameter.value for parameter in parameters}
        # A key that is not a variable of the operator is a constant.
        return [
            Update(kind, fact(formula.name, *[binding.get(v.key, v.key) for v in formula.typed_parameters]))
            for kind, formula in steps
        ]


def _updates(literals: Sequence[KnowledgeItem]) -> List[Update]:
    """The updates that make literals true, deletions first."""
    updates = [
        Update(
            REMOVE if item.is_negative else ADD,
            fact(item.attribute_name, *[value.value for value in item.values]),
        )
        for item in literals
    ]
    return sorted(updates, key=lambda update: update.kind != REMOVE)


def when_back(call: Callable[[], None], limit: float = RETURN_LIMIT) -> None:
    """Calls the knowledge base; one that does not answer is called again until it is back.

    :param limit: s of running time.
    :raises merlin_ros.service_proxy.ServiceUnavailable: when it does not come back.
    """
    deadline = Deadline(limit)
    pause = threading.Event()
    while True:
        try:
            return call()
        except ServiceUnavailable:
            if deadline.expired:
                raise
        # The master gives no event when a service is offered again.
        if pause.wait(min(RETRY, deadline.remaining() + 0.01)):
            return None


def effects_of(operator: DomainOperator, knowledge: KnowledgeClient) -> Effects:
    """The effects of an operator, through the best service that the knowledge base offers.

    :raises ValueError: when they cannot be expressed.
    """
    if ServiceProxy(f"{knowledge.name}/apply_effects", ApplyEffects).available():
        return ServiceEffects(operator.formula.name, knowledge)
    return UpdateEffects(operator, knowledge)
