# SPDX-License-Identifier: Apache-2.0
"""What an update of ROSPlan's messages does to the knowledge."""

from rosplan_knowledge_msgs.msg import KnowledgeItem
from rosplan_knowledge_msgs.srv import KnowledgeUpdateServiceRequest as Request

from merlin_pddl.domain import Domain
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.transaction import Transaction
from merlin_rosplan.messages.knowledge_messages import KnowledgeReader, Objects

_CONDITIONS = (KnowledgeItem.EXPRESSION, KnowledgeItem.INEQUALITY)


class UpdateReader:
    """Applies updates, one by one, inside a transaction.

    :param domain: for items that come as PDDL text.
    :param objects: gives all objects with their types.
    :param strict: refuse what means nothing; else pass over it, as ROSPlan does.
    """

    def __init__(self, domain: Domain, objects: Objects, strict: bool) -> None:
        self._reader = KnowledgeReader(domain, keys=strict)
        self._objects = objects
        self._strict = strict

    def apply(self, transaction: Transaction, kind: int, message: KnowledgeItem) -> None:
        """Applies one update.

        :raises UpdateRefused: it is refused.
        """
        if kind in (Request.ADD_KNOWLEDGE, Request.REMOVE_KNOWLEDGE):
            adding = kind == Request.ADD_KNOWLEDGE
            if message.knowledge_type in _CONDITIONS and not (adding and self._strict):
                return  # a condition is not knowledge: ROSPlan does nothing with it
            item = self._reader.item(message)
            at = message.initial_time.to_nsec()
            (transaction.add if adding else transaction.remove)(item, at)
        elif kind == Request.ADD_GOAL:
            transaction.add_goal(self._reader.goal(message, self._objects))
        elif kind == Request.REMOVE_GOAL:
            transaction.remove_goal(self._reader.goal(message, self._objects))
        elif kind == Request.ADD_METRIC:
            transaction.set_metric(self._reader.metric(message))
        elif kind == Request.REMOVE_METRIC:
            transaction.set_metric(None)
        elif self._strict:
            raise UpdateRefused(f"there is no update_type {kind}")
