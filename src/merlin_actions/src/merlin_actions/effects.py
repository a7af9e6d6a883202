"""Brings the effects of actions into the knowledge base, and undoes those of an interrupted one."""

from typing import Dict, List, Sequence, Tuple

from diagnostic_msgs.msg import KeyValue
from merlin_msgs.srv import ApplyEffects, ApplyEffectsRequest
from rosplan_knowledge_msgs.msg import DomainFormula, DomainOperator

from merlin_sm.knowledge_client import ADD, REMOVE, KnowledgeClient, KnowledgeError, Update, fact
from merlin_sm.service_proxy import ServiceProxy

APPLY_LIMIT = 10.0  # s of wall time for one transaction


class Effects:
    """What an operator does to the knowledge base; one instance per operator.

    Every method raises :class:`KnowledgeError` or :class:`merlin_sm.service_proxy.ServiceError` when the
    knowledge was not changed.
    """

    def start(self, parameters: Sequence[KeyValue], token: str) -> None:
        """Applies what is true as soon as the action begins; nothing for a plain operator."""
        raise NotImplementedError

    def end(self, parameters: Sequence[KeyValue], token: str) -> None:
        """Applies what is true once it has succeeded."""
        raise NotImplementedError

    def rollback(self, parameters: Sequence[KeyValue], token: str) -> None:
        """Undoes what :meth:`start` with the same token changed."""
        raise NotImplementedError


class ServiceEffects(Effects):
    """Effects through ``<kb>/apply_effects``: numeric, conditional and quantified ones included."""

    def __init__(self, operator: str, knowledge: KnowledgeClient) -> None:
        self._operator = operator
        self._apply = ServiceProxy(f"{knowledge.name}/apply_effects", ApplyEffects, timeout=APPLY_LIMIT)

    def start(self, parameters: Sequence[KeyValue], token: str) -> None:
        """See :meth:`Effects.start`."""
        self._call(parameters, ApplyEffectsRequest.START, token)

    def end(self, parameters: Sequence[KeyValue], token: str) -> None:
        """See :meth:`Effects.end`."""
        self._call(parameters, ApplyEffectsRequest.END, token)

    def rollback(self, parameters: Sequence[KeyValue], token: str) -> None:
        """See :meth:`Effects.rollback`."""
        self._call(parameters, ApplyEffectsRequest.ROLLBACK, token)

    def _call(self, parameters: Sequence[KeyValue], phase: int, token: str) -> None:
        answer = self._apply(
            operator_name=self._operator, parameters=list(parameters), phase=phase, token=token
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

    def start(self, parameters: Sequence[KeyValue], token: str) -> None:
        """See :meth:`Effects.start`."""
        updates = self._ground(self._start, parameters)
        held = self._knowledge.query([update.item for update in updates])
        self._undo[token] = [
            Update(ADD if update.kind == REMOVE else REMOVE, update.item)
            for update, was_true in zip(updates, held)
            if was_true == (update.kind == REMOVE)
        ]
        self._knowledge.update(updates)

    def end(self, parameters: Sequence[KeyValue], token: str) -> None:
        """See :meth:`Effects.end`."""
        self._undo.pop(token, None)
        self._knowledge.update(self._ground(self._end, parameters))

    def rollback(self, parameters: Sequence[KeyValue], token: str) -> None:
        """See :meth:`Effects.rollback`."""
        self._knowledge.update(self._undo.pop(token, []))

    @staticmethod
    def _steps(operator: DomainOperator, time: str) -> List[Tuple[int, DomainFormula]]:
        deletes = getattr(operator, f"at_{time}_del_effects")
        adds = getattr(operator, f"at_{time}_add_effects")
        return [(REMOVE, formula) for formula in deletes] + [(ADD, formula) for formula in adds]

    def _ground(
        self, steps: Sequence[Tuple[int, DomainFormula]], parameters: Sequence[KeyValue]
    ) -> List[Update]:
        binding = {parameter.key: parameter.value for parameter in parameters}
        # A key that is no variable of the operator is a constant: it stands for itself.
        return [
            Update(kind, fact(formula.name, *[binding.get(v.key, v.key) for v in formula.typed_parameters]))
            for kind, formula in steps
        ]


def effects_of(operator: DomainOperator, knowledge: KnowledgeClient) -> Effects:
    """The effects of an operator, through the best service that the knowledge base offers.

    :raises ValueError: when they cannot be expressed.
    """
    if ServiceProxy(f"{knowledge.name}/apply_effects", ApplyEffects).available():
        return ServiceEffects(operator.formula.name, knowledge)
    return UpdateEffects(operator, knowledge)
