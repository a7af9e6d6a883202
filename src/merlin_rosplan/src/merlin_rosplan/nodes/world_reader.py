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
        local = getattr(Component.in_process(self._name), "snapshot", None)
        if local is not None:
            found: Tuple[Domain, Problem] = local()
            return found
        if self._client is None:
            self._client = KnowledgeSnapshots(self._name)
        return self._client.snapshot()

    def shutdown(self) -> None:
        """Closes the connections."""
        if self._client is not None:
            self._client.close()
