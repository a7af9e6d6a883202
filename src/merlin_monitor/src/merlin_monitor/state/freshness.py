# SPDX-License-Identifier: Apache-2.0
"""Whether what a section shows is still fed: which sources are gone or hang, and since when."""

from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Set, Tuple

from merlin_monitor.state.health_section import HealthSection
from merlin_monitor.state.history_events import Reporter, sentence
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import say
from merlin_monitor.truth.worst_truth import (
    BRIDGES,
    EXECUTOR,
    GUARD,
    MACHINES,
    MISSION,
    NAVIGATION,
    PLANNING,
    SIMULATOR,
)

#: Field of a section: None, or what its source is and since when nothing can be known.
SILENT = "silent"
#: Field of the present: owners that have no section of their own, while they are gone or hang.
LOST = "lost"
#: These owners.
ALONE = (SIMULATOR, BRIDGES, MACHINES, NAVIGATION, MISSION)
#: The others → the sections that they feed.
SECTIONS = {EXECUTOR: ("now",), PLANNING: ("plan", "knowledge")}
#: Sections and owners that say all anew to whoever connects: until then what they said is of a life before.
LATCHED = ("now", "queue", MISSION)

#: What is wrong with a source.
IS_GONE, HANGS = "is gone", "does not answer"


class Source(NamedTuple):
    """Where a section has its news from."""

    connected: bool
    """Whether a publisher of its topic is connected."""
    node: str
    """Global name of the node that publishes it, empty when not known."""
    others: Tuple[str, ...] = ()
    """Further nodes that publish such topics: one that hangs is enough."""


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
        self._nodes: Dict[str, str] = {}  # section or owner → node that was connected last
        self._others: Dict[str, Tuple[str, ...]] = {}  # the same → its other nodes
        self._gone: Set[str] = set()  # those that were not connected, and have not said anything since
        self._alive_at: Dict[str, float] = {}  # the same → ROS time of the last check that was good
        self._lost: Dict[str, str] = {}  # node → what is wrong with it

    def check(self, at: float, sources: Mapping[str, Source], owners: Mapping[str, Source] = {}) -> None:
        """Looks at all sources.

        :param at: s of ROS time.
        :param sources: by section.
        :param owners: those that feed no section, while they matter.
        """
        lost: Dict[str, str] = {}
        for section, source in sources.items():
            if source.connected or section in self._nodes:
                self._tree.set(section, SILENT, self._look(section, source, at, lost))
        self._tree.set("now", LOST, self._lost_owners(at, owners, lost))
        for node, wrong in lost.items():
            if self._lost.get(node) != wrong:
                said = say("{node} {what}", node=node or say("a node"), what=say(wrong))
                self._report(sentence("health", said, at, "failure"))
        for node in self._lost.keys() - lost.keys():
            self._report(sentence("health", say("{node} is connected again", node=node or say("a node")), at))
        self._lost = lost

    def heard(self, name: str) -> None:
        """A source of `LATCHED` says what is the case: what it said in a life before is over."""
        if name in self._gone:
            self._gone.discard(name)
            self._health.begin_anew(self._nodes[name])

    def lost(self) -> Dict[str, str]:
        """What is wrong with the owners that are gone or hang; the guard is asked by itself."""
        found = {owner: str(lost["what"]) for owner, lost in (self._tree.get("now", LOST) or {}).items()}
        for owner, sections in SECTIONS.items():
            silent = filter(None, (self._tree.get(section, SILENT) for section in sections))
            for wrong in sorted({each["what"] for each in silent}, key=(IS_GONE, HANGS).index)[:1]:
                found[owner] = wrong  # one that is gone is silent, too
        if self._tree.get("guard", "state") == "silent":
            found[GUARD] = HANGS
        return found

    def others_silent(self) -> List[str]:
        """Nodes that are silent on ``/diagnostics`` and feed nothing else, without the leading slash."""
        nodes = (*self._nodes.values(), *(node for others in self._others.values() for node in others))
        sources = {node.strip("/") for node in nodes}
        return [node for node in self._health.silent_nodes() if node not in sources]

    def _lost_owners(
        self, at: float, owners: Mapping[str, Source], lost: Dict[str, str]
    ) -> Dict[str, Dict[str, Any]]:
        for owner in [owner for owner in ALONE if owner not in owners]:
            self._nodes.pop(owner, None)  # it has ended
        known = {owner: each for owner, each in owners.items() if each.connected or owner in self._nodes}
        found = {owner: self._look(owner, source, at, lost) for owner, source in known.items()}
        return {owner: wrong for owner, wrong in found.items() if wrong is not None}

    def _look(self, name: str, source: Source, at: float, lost: Dict[str, str]) -> Optional[Dict[str, Any]]:
        """What is wrong with a source that was there, and since when; it is noted in `lost`, too."""
        if source.connected:
            self._nodes[name] = source.node or self._nodes.get(name, "")
            self._others[name] = source.others
            if name not in LATCHED:
                self.heard(name)
        else:
            self._gone.add(name)
        nodes = (source.node or self._nodes[name], *self._others[name])
        node = next((each for each in nodes if self._wrong(True, each)), nodes[0])
        wrong = self._wrong(name not in self._gone, node)
        if wrong:
            lost[node] = wrong
            return {"node": node, "what": wrong, "since": self._alive_at.get(name, at)}
        self._alive_at[name] = at
        return None

    def _wrong(self, connected: bool, node: str) -> Optional[str]:
        if not connected:
            return IS_GONE
        return HANGS if node.strip("/") in self._health.silent_nodes() else None
