# SPDX-License-Identifier: Apache-2.0
"""What every stroke is."""

from typing import TYPE_CHECKING, List

from chaos.faults import Fault

if TYPE_CHECKING:
    from chaos.under_test.system import System


class NotRunning(Exception):
    """A node that has to run does not."""


class Stroke:
    """Does what one kind of fault does beside signals to processes. This one does nothing.

    Made when the moment has come, before the delay: what takes time is done by the constructor.

    :raises NotRunning: a node that it strikes does not run.
    """

    def __init__(self, system: "System", fault: Fault) -> None:
        self._system = system
        self._fault = fault

    def strike(self) -> None:
        """Does it; soon done."""

    def help(self) -> List[str]:
        """Repairs what does not end by itself, as an operator would; returns what."""
        return []

    def end(self) -> None:
        """Takes back what is still there; called once the fault is over, and may be called again."""

    def _running(self, node: str) -> int:
        """The process of a node.

        :raises NotRunning: it has none.
        """
        pid = self._system.pid(node)
        if pid is None:
            raise NotRunning(f"{node} does not run")
        return pid
