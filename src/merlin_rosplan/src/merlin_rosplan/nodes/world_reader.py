# SPDX-License-Identifier: Apache-2.0
"""Reads a knowledge base as a whole: directly where it lives in this process, else over ROS."""

from typing import Optional, Tuple

from merlin_pddl.domain import Domain
from merlin_pddl.problem import Problem
from merlin_rosplan.messages.knowledge_snapshot import KnowledgeSnapshots
from merlin_rosplan.transport.component import Component


class WorldReader:
    """One knowledge base. For one thread at a time.

    :param name: its global name.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._client: Optional[KnowledgeSnapshots] = None

    def snapshot(self) -> Tuple[Domain, Problem]:
        """Domain and everything that is stored; the problem is the caller's.

        :raises KnowledgeBaseError: there is no usable answer.
        """
        if Component.in_process(self._name) is not None:
            # Not at the top: a planner or a problem interface in a node of its own has no knowledge base.
            from merlin_rosplan.nodes.knowledge_base import knowledge_base_in_process

            local = knowledge_base_in_process(self._name)
            if local is not None:
                return local.snapshot()
        if self._client is None:
            self._client = KnowledgeSnapshots(self._name)
        return self._client.snapshot()

    def shutdown(self) -> None:
        """Closes the connections."""
        if self._client is not None:
            self._client.close()
