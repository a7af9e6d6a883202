# SPDX-License-Identifier: Apache-2.0
"""What an operator changes in the knowledge by hand: what it contradicts, and how it is set back."""

from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Set, Tuple

from rosplan_knowledge_msgs.msg import DomainOperator, KnowledgeItem

from merlin_monitor.text.fact_text import action_text
from merlin_planning.knowledge_client import REMOVE, KnowledgeClient, Update

Key = Tuple[str, ...]  # name and objects, lower-case
#: Of an operator: what is needed until its end, and what it changes.
_FIELDS = [f"{when}_{kind}_condition" for when in ("over_all", "at_end") for kind in ("simple", "neg")] + [
    f"{when}_{kind}_effects" for when in ("at_start", "at_end") for kind in ("add", "del", "assign")
]


class HandChanges:
    """Changes that are not made yet, beside the knowledge as it is.

    :param knowledge: is asked what holds now.
    :param updates: facts that become true or false, and values.
    :raises ServiceError: the knowledge base does not answer.
    """

    def __init__(self, knowledge: KnowledgeClient, updates: Sequence[Update]) -> None:
        self._knowledge = knowledge
        self.new: List[Update] = []
        """Those that change anything."""
        back = []
        for update in updates:
            before, after = self._before(update.item), _after(update)
            if before != after:
                self.new.append(update)
                if before is not None:  # a number that there was not cannot be taken away
                    back.append(_text(update.item, before))
        self.back = f"(and {' '.join(back)})" if len(back) > 1 else "".join(back)
        """What sets all of it back, as PDDL text; empty: nothing can be set back."""

    def contradicted(self, running: Iterable[Mapping[str, Any]]) -> str:
        """The running actions that need or change the same, as PDDL text; empty: none.

        :param running: name and parameters of each action.
        :raises ServiceError: the knowledge base does not answer.
        """
        changed = {_key(update.item) for update in self.new}
        return "; ".join(
            action_text(action)
            for action in running
            if changed & _touched(self._knowledge.operator(action["name"]), dict(action["parameters"]))
        )

    def _before(self, item: KnowledgeItem) -> Optional[float]:
        if item.knowledge_type == KnowledgeItem.FACT:
            return float(self._knowledge.query([item])[0])
        values = {_key(each): each.function_value for each in self._knowledge.functions(item.attribute_name)}
        return values.get(_key(item))


def _after(update: Update) -> float:
    if update.item.knowledge_type == KnowledgeItem.FACT:
        return float(update.kind != REMOVE)
    return float(update.item.function_value)


def _text(item: KnowledgeItem, value: float) -> str:
    term = f"({' '.join([item.attribute_name, *(pair.value for pair in item.values)])})"
    if item.knowledge_type == KnowledgeItem.FACT:
        return term if value else f"(not {term})"
    return f"(= {term} {value!r})"


def _key(item: KnowledgeItem) -> Key:
    return (item.attribute_name.lower(), *(pair.value.lower() for pair in item.values))


def _touched(operator: DomainOperator, parameters: Dict[str, str]) -> Set[Key]:
    bound = {label.lower(): value.lower() for label, value in parameters.items()}
    found = set()
    for field in _FIELDS:
        for formula in getattr(operator, field):
            term = getattr(formula, "LHS", formula)
            names = [pair.key.lower() for pair in term.typed_parameters]
            found.add((term.name.lower(), *(bound.get(name, name) for name in names)))
    return found
