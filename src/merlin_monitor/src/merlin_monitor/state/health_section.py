# SPDX-License-Identifier: Apache-2.0
"""The section of the health: what every part reports on /diagnostics, and which part is silent."""

from typing import Any, Collection, Dict, FrozenSet, List, Tuple

from merlin_monitor.state.history_events import Reporter, sentence
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import say, with_reason
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


class HealthSection:
    """Keeps the section ``health`` of the state."""

    def __init__(self, tree: StateTree, report: Reporter) -> None:
        self._tree = tree
        self._report = report
        self._seen: Dict[str, float] = {}
        self._periods: Dict[str, float] = {}
        self._reports: Dict[str, int] = {}
        self._reported: Dict[str, Tuple[float, str]] = {}  # part → when its level was reported, and which
        self._nodes: Dict[str, str] = {}  # part → global name of the node that reports it
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
                if status.name in self._seen:
                    ended.add(f"/{status.name.partition(': ')[0]}")
                    self._forget(status.name)
                continue
            if status.name not in self._seen and len(self._seen) >= MOST_PARTS:
                continue
            word = LEVELS[level] if 0 <= level < len(LEVELS) else str(level)
            was_silent = self._tree.get(SECTION, "parts", status.name, "silent", default=False)
            self._note_period(status.name, wall)
            self._seen[status.name] = wall
            self._nodes[status.name] = node
            values = [[pair.key, pair.value] for pair in status.values]
            fields = {"level": word, "message": status.message, "values": values, "silent": False}
            self._tree.update(SECTION, "parts", status.name, fields)
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
        for name, reports in self._reports.items():
            if reports < REGULAR and self._nodes[name] not in self._hanging:
                continue
            node = name.partition(": ")[0]
            part = bool(self._tree.get(SECTION, "parts", name, "silent", default=False))
            silent[node] = silent.get(node, True) and part
        return [node for node, is_silent in silent.items() if is_silent]

    def begin_anew(self, node: str) -> None:
        """A node that was gone is there again: the silence of its former life says nothing of it.

        :param node: its global name.
        """
        for name in self._reports:
            if name.partition(": ")[0] == node.strip("/"):
                self._reports[name] = 0

    def hang(self, nodes: Collection[str]) -> None:
        """Takes which of the doubtful nodes hang."""
        self._hanging = nodes

    def check_silence(self, at: float, wall: float, nodes: Collection[str] = ()) -> None:
        """Marks parts that have been silent for long, and forgets those of nodes that ended in order.

        :param nodes: those that the master knows as publishers of ``/diagnostics``: one that ends in order
            takes itself off, one that dies or hangs does not. Empty: not known.
        """
        ended, doubtful = set(), set()
        for name, seen in list(self._seen.items()):
            silent = wall - seen > max(SILENT_AFTER, PERIODS * self._periods[name])
            if silent and nodes and self._nodes[name] and self._nodes[name] not in nodes:
                ended.add(self._nodes[name])
                self._forget(name)
                continue
            if silent and self._reports[name] < REGULAR and self._nodes[name]:
                doubtful.add(self._nodes[name])
            if self._tree.set(SECTION, "parts", name, "silent", silent) and silent:
                self._report(sentence("health", say("{part} has fallen silent", part=name), at, "failure"))
            self._report_level(name, at, wall, silent)
        self.doubtful = frozenset(doubtful)
        self._report_ended(ended, at)

    def _report_ended(self, nodes: Collection[str], at: float) -> None:
        for node in sorted(nodes):
            self._report(sentence("health", say("{node} has ended", node=node), at))

    def _forget(self, name: str) -> None:
        for kept in (self._seen, self._periods, self._reports, self._reported, self._nodes):
            kept.pop(name, None)
        self._tree.remove(SECTION, "parts", name)

    def _report_level(self, name: str, at: float, wall: float, known: bool) -> None:
        """Reports a new level; when a part alternates, the level that it has after a while.

        :param known: whether the level was reported in another event.
        """
        level = self._tree.get(SECTION, "parts", name, "level")
        reported, before = self._reported.get(name, (wall - CALM, "ok"))
        if known or level == before or name not in self._reported and level == "ok":
            self._reported[name] = (wall if known else reported, level)
            return
        if level in MILD and before in MILD and wall - reported < CALM:
            return
        self._reported[name] = wall, level
        message = self._tree.get(SECTION, "parts", name, "message")
        mark = "" if level in MILD else "failure"
        said = say("{part}: {level}", part=name, level=say(level))
        self._report(sentence("health", with_reason(said, message), at, mark))

    def _note_period(self, name: str, wall: float) -> None:
        """Learns how often a part reports; one long pause is forgotten within a few reports."""
        self._reports[name] = self._reports.get(name, 0) + 1
        if name not in self._seen:
            self._periods[name] = FIRST_PERIOD
            return
        last = min(LONGEST_PERIOD, wall - self._seen[name])
        self._periods[name] = max(last, self._periods[name] / 2)
