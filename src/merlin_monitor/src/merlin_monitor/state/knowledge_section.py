# SPDX-License-Identifier: Apache-2.0
"""The section of what the robot knows: objects, facts, numeric values, goals, and their last changes."""

from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Tuple

from merlin_monitor.state.history_events import Reporter, sentence
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.fact_text import FACT, FUNCTION, INSTANCE, item_text, number_text
from merlin_monitor.text.phrase import Phrase, say
from merlin_monitor.text.wording import Wording

SECTION = "knowledge"
KINDS = ("objects", "facts", "values", "goals")
RECENT = 60  # changes that are shown as a list
FEW = 3  # changes of one transaction that are reported one by one

Entry = Dict[str, Any]
Table = Dict[str, Entry]
Changes = List[Tuple[str, str, str]]  # sign, kind and key of each


class Contents(NamedTuple):
    """Everything a knowledge base knows, as the messages of its services."""

    objects: Dict[str, str]  # name → type
    facts: List[Any]
    values: List[Any]
    goals: List[Any]


class KnowledgeSection:
    """Keeps the section ``knowledge`` of the state.

    :param report: takes the events.
    :param wording: makes the words; None: of the names.
    """

    def __init__(self, tree: StateTree, report: Reporter, wording: Optional[Wording] = None) -> None:
        self._wording = wording or Wording()
        self._tree = tree
        self._report = report
        self._number = 0
        self._version: Dict[str, int] = {}  # of the change that is taken in, as a field; empty: not known
        self._kept: Mapping[str, Table] = {}  # of an earlier life, until the first reading
        self._kept_at = 0.0  # s of ROS time
        self._clear({kind: {} for kind in KINDS})
        tree.set(SECTION, "recent", {})

    def remember(self, kept: Mapping[str, Table], at: float) -> None:
        """Takes the section of an earlier life of the monitor.

        :param at: its end, ROS time, s.
        """
        self._kept, self._kept_at = kept, at

    def source(self, text: str) -> None:
        """Says where the section comes from, one sentence."""
        self._tree.set(SECTION, "source", text)

    def domain(self, description: Dict[str, Any]) -> None:
        """Takes the domain: name, types, predicates, functions, operators."""
        self._tree.put(SECTION, domain=description, words=self._wording.shown())

    def replace(self, contents: Contents, by: str, at: float, first: bool) -> None:
        """Takes all there is, read by services.

        :param by: the node that is said to have changed what differs from before.
        :param at: ROS time, s.
        :param first: whether nothing was read before, so that nothing is reported as changed.
        """
        new: Dict[str, Table] = {
            "objects": {name: {"type": kind} for name, kind in contents.objects.items()},
            "facts": {item_text(item): {} for item in contents.facts},
            "values": {item_text(item): {"value": item.function_value} for item in contents.values},
            "goals": {item_text(item): {} for item in contents.goals},
        }
        if first:
            self._compare_with_kept(new, by, at)
            self._clear(new)
            self._tree.set(SECTION, "recent", {})
            return
        changes: Changes = []
        self._version = {}
        for kind in KINDS:
            for key in [key for key in self._tables[kind] if key not in new[kind]]:
                self._remove(kind, key, by, at, changes)
            for key, entry in new[kind].items():
                self._put(kind, key, entry, by, at, changes)
        self._report_changes(changes, by, at)

    def _compare_with_kept(self, new: Dict[str, Table], by: str, at: float) -> None:
        """What is as it was in an earlier life was changed when it was then, the rest since its end."""
        kept, self._kept = self._kept, {}
        for kind in KINDS if any(kept.get(kind) for kind in KINDS) else ():
            for key, entry in new[kind].items():
                was = kept.get(kind, {}).get(key)
                if was is not None and all(was.get(field) == value for field, value in entry.items()):
                    entry.update(was)
                else:
                    entry.update(by=by, at=at, after=self._kept_at)

    def changed(self, message: Any, at: float) -> None:
        """Takes a message with the fields of merlin_msgs/KnowledgeChanges.

        :param at: ROS time of the change, s.
        """
        by = message.client
        self._version = {"version": message.version}
        changes: Changes = []
        if message.cleared:
            changes += [("-", kind, key) for kind in KINDS for key in self._tables[kind]]
            self._clear({kind: {} for kind in KINDS})
        for item in message.removed:
            self._remove(_kind(item), item_text(item), by, at, changes)
        for item in message.goals_removed:
            self._remove("goals", item_text(item), by, at, changes)
        for item in (*message.added, *message.changed):
            kind = _kind(item)
            entry: Entry = {"type": item.instance_type} if kind == "objects" else {}
            entry = {"value": item.function_value} if kind == "values" else entry
            self._put(kind, item_text(item), entry, by, at, changes)
        for item in message.goals_added:
            self._put("goals", item_text(item), {}, by, at, changes)
        self._tree.set(SECTION, "version", message.version)
        self._report_changes(changes, by, at)

    def _clear(self, tables: Dict[str, Table]) -> None:
        """Replaces all there is."""
        self._tables = tables
        self._tree.put(SECTION, **tables)

    def _remove(self, kind: str, key: str, by: str, at: float, changes: Changes) -> None:
        if key in self._tables[kind]:
            self._change("-", kind, key, {}, by, at)
            changes.append(("-", kind, key))

    def _put(self, kind: str, key: str, entry: Entry, by: str, at: float, changes: Changes) -> None:
        known = self._tables[kind].get(key)
        if known is None or any(known.get(field) != value for field, value in entry.items()):
            sign = "+" if known is None else "="
            self._change(sign, kind, key, entry, by, at)
            changes.append((sign, kind, key))

    def _change(self, sign: str, kind: str, key: str, entry: Entry, by: str, at: float) -> None:
        text = key
        if sign == "-":
            self._tables[kind].pop(key, None)
            self._tree.remove(SECTION, kind, key)
        else:
            entry = {**entry, "by": by, "at": at, **self._version}
            self._tables[kind][key] = entry
            self._tree.set(SECTION, kind, key, entry)
            if kind == "values":
                text = f"{key} = {number_text(entry['value'])}"
        self._number += 1
        change = {"sign": sign, "kind": kind, "text": text, "by": by, "at": at, **self._version}
        if text != key:
            change.update(key=key, value=entry["value"])
        self._tree.set(SECTION, "recent", str(self._number), change)
        for old in self._tree.keys(SECTION, "recent")[:-RECENT]:
            self._tree.remove(SECTION, "recent", old)

    def _report_changes(self, changes: Changes, by: str, at: float) -> None:
        if not changes:
            return
        said: Phrase = [self._words(*change) for change in changes[:FEW]]
        if len(changes) > FEW:
            said = say("{first} and {count} more", first=said, count=str(len(changes) - FEW))
        client = by or say("an unknown client")
        self._report(sentence("knowledge", say("{what}, by {client}", what=said, client=client), at))

    def _words(self, sign: str, kind: str, key: str) -> Phrase:
        words = self._wording
        what = words.value(key) if kind == "values" else words.fact(key)
        if kind == "goals":
            what = say("goal {text}", text=words.goal(key))
        elif kind == "objects":
            what = say("object {text}", text=what)
        if sign == "-":
            return say("{what} removed", what=what)
        if kind == "values" and key in self._tables[kind]:
            return say("{what} is {value}", what=what, value=number_text(self._tables[kind][key]["value"]))
        return say("{what} added", what=what) if sign == "+" else say("{what} changed", what=what)


def _kind(item: Any) -> str:
    return {INSTANCE: "objects", FACT: "facts", FUNCTION: "values"}.get(item.knowledge_type, "facts")


def added(operator: Any) -> List[List[str]]:
    """The facts that an operator makes true, with its variables; from a DomainOperator message."""
    effects = [*operator.at_start_add_effects, *operator.at_end_add_effects]
    return [[fact.name, *(parameter.key for parameter in fact.typed_parameters)] for fact in effects]


def formulas(items: Iterable[Any]) -> Dict[str, List[List[str]]]:
    """Signatures by name: ``{"robot_at": [["p", "place"]]}``, from DomainFormula messages."""
    return {
        item.name: [[parameter.key, parameter.value] for parameter in item.typed_parameters] for item in items
    }
