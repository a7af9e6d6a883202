# SPDX-License-Identifier: Apache-2.0
"""The section of the health: what every part reports on /diagnostics, and which part is silent."""

from typing import Any, Collection, Dict, FrozenSet, List

from merlin_monitor.state.history_events import Reporter, sentence
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import say, with_reason
from merlin_monitor.text.request_words import name_of
from merlin_ros.health import ENDED, STALE

SECTION = "health"
LEVELS = ("ok", "warning", "error", "stale")
SILENT_AFTER = 2.5  # s of wall time; our nodes report once per second
PERIODS = 2.5  # of its own, after which a part that reports less often is silent
FIRST_PERIOD = 2.0  # s, assumed of a part that has reported once
LONGEST_PERIOD = 30.0  # s
REGULAR = 3  # reports, from when a part is expected to report again
MOST_PARTS = 500
MILD = ("ok", "warning")
CALM = 60.0  # s of wall time between two events of a part that changes between these levels


class _Part:
    """A part, beside what is shown of it: the node that reports it, and how often it does."""

    def __init__(self, wall: float) -> None:
        self.node = ""  # its global name
        self.seen = wall
        self.period = FIRST_PERIOD
        self.reports = 0
        self.reported = (wall - CALM, "ok")  # when its level was reported, and which

    def reports_again(self, wall: float, node: str) -> None:
        """Learns how often it does; one long pause is forgotten within a few reports."""
        if self.reports:
            self.period = max(min(LONGEST_PERIOD, wall - self.seen), self.period / 2)
        self.reports, self.seen, self.node = self.reports + 1, wall, node


class HealthSection:
    """Keeps the section ``health`` of the state."""

    def __init__(self, tree: StateTree, report: Reporter) -> None:
        self._tree = tree
        self._report = report
        self._parts: Dict[str, _Part] = {}
        #: Silent nodes of which it is not known how often they report, by their global names.
        self.doubtful: FrozenSet[str] = frozenset()
        self._hanging: Collection[str] = ()  # those of them that hang
        tree.set(SECTION, "parts", {})

    def diagnostics(self, message: Any, at: float, wall: float, node: str = "") -> None:
        """Takes a message with the fields of diagnostic_msgs/DiagnosticArray.

        :param node: that sent it; empty: not known.
        """
        ended = set()
        for status in message.status:
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            if (level, status.message) == (STALE, ENDED):
                if status.name in self._parts:
                    ended.add(f"/{status.name.partition(': ')[0]}")
                    self._forget(status.name)
                continue
            if status.name not in self._parts and len(self._parts) >= MOST_PARTS:
                continue
            word = name_of(LEVELS, level)
            was_silent = self._tree.get(SECTION, "parts", status.name, "silent", default=False)
            self._parts.setdefault(status.name, _Part(wall)).reports_again(wall, node)
            values = [[pair.key, pair.value] for pair in status.values]
            shown = {"level": word, "message": status.message, "values": values, "silent": False}
            self._tree.put(SECTION, "parts", status.name, **shown)
            if was_silent:
                heard = say("{part} is heard again", part=status.name)
                self._report(sentence("health", with_reason(heard, status.message), at))
            self._report_level(status.name, at, wall, was_silent)
        self._report_ended(ended, at)

    def silent_nodes(self) -> List[str]:
        """Nodes of which every part is silent, without the leading slash.

        Of those that have not reported regularly only the ones that hang: others may report now and then.
        The name of a part begins with that of its node, a colon and a blank, as diagnostic_updater writes it.
        """
        silent: Dict[str, bool] = {}
        for name, known in self._parts.items():
            if known.reports < REGULAR and known.node not in self._hanging:
                continue
            node = name.partition(": ")[0]
            part = bool(self._tree.get(SECTION, "parts", name, "silent", default=False))
            silent[node] = silent.get(node, True) and part
        return [node for node, is_silent in silent.items() if is_silent]

    def begin_anew(self, node: str) -> None:
        """A node that was gone is there again: the silence of its former life says nothing of it.

        :param node: its global name.
        """
        for name, part in self._parts.items():
            if name.partition(": ")[0] == node.strip("/"):
                part.reports = 0

    def hang(self, nodes: Collection[str]) -> None:
        """Takes which of the doubtful nodes hang."""
        self._hanging = nodes

    def check_silence(self, at: float, wall: float, nodes: Collection[str] = ()) -> None:
        """Marks parts that have been silent for long, and forgets those of nodes that ended in order.

        :param nodes: those that the master knows as publishers of ``/diagnostics``: one that ends in order
            takes itself off, one that dies or hangs does not. Empty: not known.
        """
        ended, doubtful = set(), set()
        for name, part in list(self._parts.items()):
            silent = wall - part.seen > max(SILENT_AFTER, PERIODS * part.period)
            if silent and nodes and part.node and part.node not in nodes:
                ended.add(part.node)
                self._forget(name)
                continue
            if silent and part.reports < REGULAR and part.node:
                doubtful.add(part.node)
            if self._tree.set(SECTION, "parts", name, "silent", silent) and silent:
                self._report(sentence("health", say("{part} has fallen silent", part=name), at, "failure"))
            self._report_level(name, at, wall, silent)
        self.doubtful = frozenset(doubtful)
        self._report_ended(ended, at)

    def _report_ended(self, nodes: Collection[str], at: float) -> None:
        for node in sorted(nodes):
            self._report(sentence("health", say("{node} has ended", node=node), at))

    def _forget(self, name: str) -> None:
        del self._parts[name]
        self._tree.remove(SECTION, "parts", name)

    def _report_level(self, name: str, at: float, wall: float, known: bool) -> None:
        """Reports a new level; when a part alternates, the level that it has after a while.

        :param known: whether the level was reported in another event.
        """
        level = self._tree.get(SECTION, "parts", name, "level")
        reported, before = self._parts[name].reported
        if known:
            self._parts[name].reported = wall, level
        if known or level == before or level in MILD and before in MILD and wall - reported < CALM:
            return
        self._parts[name].reported = wall, level
        message = self._tree.get(SECTION, "parts", name, "message")
        mark = "" if level in MILD else "failure"
        said = say("{part}: {level}", part=name, level=say(level))
        self._report(sentence("health", with_reason(said, message), at, mark))
