"""Whether what a section shows is still fed: which sources are gone or hang, and since when."""

from typing import Dict, List, Mapping, NamedTuple, Optional

from merlin_monitor.state.events import Reporter, sentence
from merlin_monitor.state.health_section import HealthSection
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import say

#: Field of a section: None, or what its source is and since when nothing can be known.
SILENT = "silent"


class Source(NamedTuple):
    """Where a section has its news from."""

    connected: bool
    """Whether a publisher of its topic is connected."""
    node: str
    """Global name of the node that publishes it, empty when not known."""


class Freshness:
    """Marks sections whose source is gone or hangs.

    A section whose source was never there is not marked: it shows nothing.

    :param tree: of the sections.
    :param report: takes events.
    :param health: knows which nodes are silent on ``/diagnostics``.
    """

    def __init__(self, tree: StateTree, report: Reporter, health: HealthSection) -> None:
        self._tree = tree
        self._report = report
        self._health = health
        self._nodes: Dict[str, str] = {}  # section → node that was connected last
        self._alive_at: Dict[str, float] = {}  # section → ROS time of the last check that was good
        self._lost: Dict[str, str] = {}  # node → what is wrong with it

    def check(self, at: float, sources: Mapping[str, Source]) -> None:
        """Looks at all sources.

        :param at: s of ROS time.
        :param sources: by section.
        """
        lost: Dict[str, str] = {}
        for section, source in sources.items():
            if source.connected:
                self._nodes[section] = source.node or self._nodes.get(section, "")
            elif section not in self._nodes:
                continue
            node = self._nodes[section]
            wrong = self._wrong(source.connected, node)
            if wrong:
                lost[node] = wrong
                since = self._alive_at.get(section, at)
                self._tree.set(section, SILENT, {"node": node, "what": wrong, "since": since})
            else:
                self._alive_at[section] = at
                self._tree.set(section, SILENT, None)
        for node, wrong in lost.items():
            if self._lost.get(node) != wrong:
                said = say("{node} {what}", node=node or say("a node"), what=say(wrong))
                self._report(sentence("health", said, at, "failure"))
        for node in self._lost.keys() - lost.keys():
            self._report(sentence("health", say("{node} is connected again", node=node or say("a node")), at))
        self._lost = lost

    def others_silent(self) -> List[str]:
        """Nodes that are silent on ``/diagnostics`` and feed no section, without the leading slash."""
        sources = {node.strip("/") for node in self._nodes.values()}
        return [node for node in self._health.silent_nodes() if node not in sources]

    def _wrong(self, connected: bool, node: str) -> Optional[str]:
        if not connected:
            return "is gone"
        return "does not answer" if node.strip("/") in self._health.silent_nodes() else None
