# SPDX-License-Identifier: Apache-2.0
"""What a knowledge base says of its changes, for a dispatch."""

from typing import TYPE_CHECKING, Any, Callable, Dict, Iterable, Tuple

from merlin_msgs.msg import KnowledgeChanges
from rosplan_knowledge_msgs.msg import KnowledgeItem, StatusUpdate

from merlin_rosplan.dispatch.dispatch_environment import KnowledgeChanged
from merlin_rosplan.transport.component import Component

if TYPE_CHECKING:
    from merlin_rosplan.knowledge.transaction import StateChange


class KnowledgeEvents:
    """Tells one dispatcher what has changed; in the same process without ROS.

    A message to its own process takes two changes of thread, beside the answer of the interface that has made
    the change: robots wait for the dispatch.

    :param component: the dispatcher.
    :param put: called with each event, in the thread that hears of the change.
    """

    def __init__(self, component: Component, put: Callable[[KnowledgeChanged], None]) -> None:
        self._put = put
        name = component.knowledge_base
        store = getattr(Component.in_process(name), "store", None)
        if store is not None:
            store.listen(self._changed)
            return
        self._changes = component.subscriber(f"{name}/changes", KnowledgeChanges, self._receive_changes)
        component.subscriber(f"{name}/status/update", StatusUpdate, self._receive_update)

    def _changed(self, change: "StateChange") -> None:
        from merlin_pddl.knowledge import Fact, Instance

        rows = (*change.added, *change.removed, *change.changed)
        facts = {row.key: False for row in change.removed if isinstance(row, Fact)}
        facts.update((row.key, not row.negative) for row in change.added if isinstance(row, Fact))
        self._tell(change.cleared, ("" if isinstance(row, Instance) else row.name for row in rows), facts)

    def _receive_changes(self, message: KnowledgeChanges) -> None:
        items = (*message.added, *message.removed, *message.changed)
        facts = {_key(item): False for item in message.removed if item.knowledge_type == item.FACT}
        facts.update(
            (_key(item), not item.is_negative) for item in message.added if item.knowledge_type == item.FACT
        )
        self._tell(message.cleared, (item.attribute_name for item in items), facts)

    def _receive_update(self, _: StatusUpdate) -> None:
        # A knowledge base that publishes the changes themselves says there what they were.
        connected = self._changes.get_num_connections() > 0
        self._put(KnowledgeChanged(frozenset() if connected else None))

    def _tell(self, cleared: Any, names: Iterable[str], facts: Dict[Tuple[str, ...], bool]) -> None:
        changed = None if cleared else frozenset(name.lower() for name in names)
        self._put(KnowledgeChanged(changed, frozenset(facts.items())))


def _key(item: KnowledgeItem) -> Tuple[str, ...]:
    return tuple(word.lower() for word in (item.attribute_name, *(value.value for value in item.values)))
