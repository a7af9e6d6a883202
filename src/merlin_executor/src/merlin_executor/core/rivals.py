"""Finds another Executor on the same planning system: two would disturb each other's plans. Pure."""

from typing import Any, Collection, Dict, List, Mapping

STATUS_TYPE = "merlin_msgs/ExecutorStatus"


def rival_executors(
    me: str,
    dispatch_topic: str,
    publishers: Mapping[str, Collection[str]],
    types: Mapping[str, str],
) -> List[str]:
    """The other nodes that serve as an Executor and dispatch through the same dispatcher.

    An Executor is known by its status, whatever its namespace, and by what it publishes to the dispatcher.
    One that is still starting publishes no status.

    :param me: name of this node.
    :param dispatch_topic: ``<dispatcher>/action_dispatch``, resolved.
    :param publishers: topic → nodes, as the master lists them.
    :param types: topic → message type.
    :return: their names, sorted.
    """
    executors = {
        node for topic, kind in types.items() if kind == STATUS_TYPE for node in publishers.get(topic, ())
    }
    return sorted((executors & set(publishers.get(dispatch_topic, ()))) - {me})


def must_yield(me: str, rivals: Collection[str]) -> bool:
    """Whether this node gives way after all: both have begun to serve in the same moment."""
    return any(rival < me for rival in rivals)


def publishers_by_topic(system_state: Any) -> Dict[str, List[str]]:
    """The first part of the master's system state as a mapping."""
    return {topic: list(nodes) for topic, nodes in system_state[0]}
