# SPDX-License-Identifier: Apache-2.0
"""The section of the state machines: every container of every introspection server, and where it is."""

import re
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Set, Tuple

from merlin_monitor.drawing.graph_layout import inside
from merlin_monitor.state.history_events import Reporter, sentence
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import Phrase, say, with_reason
from merlin_monitor.text.userdata_text import UserDataTextError, userdata_rows
from merlin_sm.autonomy import LEVELS

SECTION = "machines"
SILENT_AFTER = 7.0  # s of wall time: three heartbeats
HELD_SILENT_AFTER = 5.0  # s of wall time: five heartbeats of a node that holds a machine
MOST_STEPS = 20  # of a run, the newest
MOST_ROWS = 12  # of the userdata of one step
LONGEST_ROW = 120  # characters of a value in them
NO_STATE = "None"  # SMACH's word for no active state, and for no target
_TERMINATED = re.compile(r"TERMINATED: (.+)\Z", re.DOTALL)


class _Decided(NamedTuple):
    """How an operator ended a state."""

    server: str
    """Node that shows the machine; further instances have a number in addition."""
    labels: List[str]
    outcome: str
    at: float
    said: Phrase


class MachineSection:
    """Keeps the section ``machines`` of the state.

    A container is known by its node, its server and its path: several nodes may give either the same name.

    :param structure_changed: called with the key of the root container whose picture is out of date, or that
        no longer exists.
    """

    def __init__(self, tree: StateTree, report: Reporter, structure_changed: Callable[[str], None]) -> None:
        self._tree = tree
        self._report = report
        self._structure_changed = structure_changed
        self._local_data: Dict[str, str] = {}
        self._steps: Dict[str, Dict[str, str]] = {}  # container → userdata after its last step
        self._seen: Dict[str, float] = {}
        self._outer: Dict[str, str] = {}  # container → the one that has it among its children
        self._holds_seen: Dict[str, float] = {}  # node → when it was heard last
        self._decided: List[_Decided] = []  # not found among the executed steps yet
        tree.put(SECTION, containers={}, layouts={}, holds={})

    def structure(self, server: str, message: Any, wall: float, node: str = "") -> None:
        """Takes a message with the fields of smach_msgs/SmachContainerStructure.

        :param server: its introspection server.
        :param wall: time in s that continues when the simulation does not.
        :param node: that has the server.
        """
        path = _rooted(message.path)
        key = container_key(server, path, node)
        edges = [
            [outcome, source, "" if target in ("", NO_STATE) else target]
            for outcome, source, target in zip(
                message.internal_outcomes, message.outcomes_from, message.outcomes_to
            )
        ]
        fields = {
            "server": server,
            "node": node,
            "path": path,
            "children": list(message.children),
            "edges": edges,
            "outcomes": sorted(set(message.container_outcomes)),
        }
        changed = self._set(key, fields)
        self._is_seen(key, wall)
        if changed:
            self._outer = {inner: outer for inner, outer in self._outer.items() if outer != key}
            self._outer.update(
                {container_key(server, inside(path, child), node): key for child in message.children}
            )
            self._structure_changed(self.root_of(key))

    def status(self, server: str, message: Any, at: float, wall: float, node: str = "") -> None:
        """Takes a message with the fields of smach_msgs/SmachContainerStatus."""
        path = _rooted(message.path)
        key = container_key(server, path, node)
        known = self._tree.get(SECTION, "containers", key, default={})
        active = [state for state in message.active_states if state != NO_STATE]
        before = known.get("active", [])
        ended = _TERMINATED.match(message.info)
        fields: Dict[str, Any] = {
            "server": server,
            "node": node,
            "path": path,
            "active": active,
            "initial": list(message.initial_states),
        }
        if ended:
            fields["outcome"] = ended.group(1)
        elif active and not before:
            fields["outcome"] = ""
            fields["last"] = {}
            fields["steps"] = {}
            self._steps[key] = {}
        if known and (active != before or ended):
            fields["last"] = _last_edges(known, fields, before, active, ended and ended.group(1))
            fields["since"] = at
        self._set(key, fields)
        self._is_seen(key, wall)
        if message.local_data != self._local_data.get(key):
            self._local_data[key] = message.local_data
            self._set(key, _userdata(message.local_data))
        left = [state for state in before if state not in active]
        if left:
            self._note_steps(key, {state: fields["last"][state] for state in left}, at)
        if known and active != before and self.root_of(key) == key:
            name = path.strip("/") or server
            self._report_change(name, active, ended and ended.group(1), at)

    def holds(self, message: Any, at: float, wall: float) -> None:
        """Takes a message with the fields of merlin_msgs/MachineHolds."""
        known = self._tree.get(SECTION, "holds", message.node, default={})
        self._holds_seen[message.node] = wall
        confirm = [list(each) for each in zip(message.confirm, message.confirm_outcomes)]
        fields = {
            "breakpoints": list(message.breakpoints),
            "held": list(message.held),
            "autonomy": message.autonomy,
            "confirm": confirm,
        }
        self._tree.set(SECTION, "holds", message.node, fields)
        held = [held_words(path) for path in message.held if path not in known.get("held", [])]
        waits = [unconfirmed_words(*each) for each in confirm if each not in known.get("confirm", [])]
        for said in [*held, *waits]:
            self._report(sentence("control", said, at))

    def outcome(self, message: Any, at: float) -> None:
        """Takes a message with the fields of merlin_msgs/StateOutcome."""
        self._report(sentence("control", _decided_words(message), at, by=message.operator))
        if message.refused:
            return
        how = "confirmed by {client}" if message.ended == message.outcome else "forced by {client}"
        said = say(how, client=message.operator) if message.operator else say("not confirmed")
        machine, *labels = message.state.split("/")
        server = f"{message.node.rpartition('/')[0]}/{machine.lower()}"
        decided = _Decided(server, labels, message.outcome, at, said)
        self._decided = [*self._decided, decided][-MOST_STEPS:]
        for key in self._tree.keys(SECTION, "containers"):
            self._mark_steps(key)

    @property
    def held(self) -> List[str]:
        """The states before which machines are held: ``NAVIGATE/DRIVE``."""
        nodes = self._tree.get(SECTION, "holds", default={})
        return [path for node in sorted(nodes) for path in nodes[node]["held"]]

    @property
    def unconfirmed(self) -> List[Tuple[str, str]]:
        """The states that wait until an operator confirms their outcome, with that."""
        nodes = self._tree.get(SECTION, "holds", default={})
        return [(path, outcome) for node in sorted(nodes) for path, outcome in nodes[node]["confirm"]]

    @property
    def may_be_held(self) -> bool:
        """Whether there are breakpoints, a level below ``full``, or something is held."""
        nodes = self._tree.get(SECTION, "holds", default={})
        return any(
            holds["held"]
            or holds["confirm"]
            or holds["breakpoints"]
            or holds["autonomy"] not in ("", LEVELS[-1])
            for holds in nodes.values()
        )

    def check_holds(self, wall: float) -> bool:
        """Forgets what silent nodes hold; returns whether there were any."""
        nodes = self._tree.get(SECTION, "holds", default={})
        gone = [
            node
            for node, holds in nodes.items()
            if (holds["held"] or holds["confirm"]) and wall - self._holds_seen[node] > HELD_SILENT_AFTER
        ]
        for node in gone:
            self.forget_holds(node)
        return bool(gone)

    def forget_holds(self, node: str) -> None:
        """Forgets the breakpoints, the level and what is held of a node that has ended."""
        self._tree.remove(SECTION, "holds", node)

    def server_gone(self, server: str, node: str = "") -> None:
        """Forgets the containers of a node's server that no longer exists."""
        for key in self._tree.keys(SECTION, "containers"):
            if key.startswith(container_key(server, "", node)):
                self._tree.remove(SECTION, "containers", key)
                self._tree.remove(SECTION, "layouts", key)
                for known in (self._seen, self._local_data, self._steps):
                    known.pop(key, None)
                self._outer = {inner: outer for inner, outer in self._outer.items() if outer != key}
                self._structure_changed(key)

    def check_silence(self, wall: float, paused: bool) -> None:
        """Marks containers that have been silent for long."""
        if paused:
            self._seen = dict.fromkeys(self._seen, wall)
        for key, seen in self._seen.items():
            self._set(key, {"silent": wall - seen > SILENT_AFTER})

    def root_of(self, key: str) -> str:
        """The key of the outermost known container around one."""
        seen: Set[str] = set()
        while key in self._outer and key not in seen:
            seen.add(key)
            key = self._outer[key]
        return key

    def containers_below(self, root: str) -> Dict[str, Dict[str, Any]]:
        """A root and the containers in it, by path."""
        found: Dict[str, Dict[str, Any]] = {}
        waiting = [root]
        seen: Set[str] = set()
        while waiting:
            key = waiting.pop()
            container = self._tree.get(SECTION, "containers", key)
            # Of a structure that is being taken in, the outcomes come last.
            if container is None or "outcomes" not in container or key in seen:
                continue
            seen.add(key)
            found[container["path"]] = container
            waiting += [_key_in(container, name) for name in container["children"]]
        return found

    def layout(self, root: str, picture: Optional[Dict[str, Any]]) -> None:
        """Takes the picture of a root."""
        if picture is not None and root in self._tree.keys(SECTION, "containers"):
            self._tree.set(SECTION, "layouts", root, picture)

    def active_leaf(self, name: str) -> str:
        """The innermost active state of the machine of an action: ``NAVIGATE/DRIVE``; empty when idle."""
        for key in self._tree.keys(SECTION, "containers"):
            container = self._tree.get(SECTION, "containers", key)
            path = container.get("path", "")
            last = path.strip("/").upper()
            if last == name.upper() or last.endswith(f"_{name.upper()}"):
                return self._descend(container)
        return ""

    def _descend(self, container: Dict[str, Any]) -> str:
        path = container["path"].strip("/")
        for _ in range(20):
            active = container.get("active") or []
            if not active:
                return path if "/" in path else ""
            path = inside(container["path"], active[0]).strip("/")
            inner = self._tree.get(SECTION, "containers", _key_in(container, active[0]))
            if inner is None:
                return path
            container = inner
        return path

    def _note_steps(self, key: str, left: Dict[str, List[str]], at: float) -> None:
        """Keeps with which outcomes states were left, and what of the userdata has another value since."""
        rows = dict(self._tree.get(SECTION, "containers", key, "userdata", default=[]))
        before = self._steps.get(key, {})
        self._steps[key] = rows
        changed = [
            [name, value if len(value) <= LONGEST_ROW else f"{value[: LONGEST_ROW - 1]}…"]
            for name, value in rows.items()
            if before.get(name) != value
        ][:MOST_ROWS]
        steps = self._tree.get(SECTION, "containers", key, "steps", default={})
        number = max(map(int, steps), default=0)
        for state, outcomes in left.items():
            number += 1
            step = {"state": state, "outcome": outcomes, "at": at, "userdata": changed}
            self._tree.set(SECTION, "containers", key, "steps", str(number), step)
            if len(steps) >= MOST_STEPS:
                self._tree.remove(SECTION, "containers", key, "steps", min(steps, key=int))
                steps = self._tree.get(SECTION, "containers", key, "steps")
        self._mark_steps(key)

    def _mark_steps(self, key: str) -> None:
        """Notes at the steps of a container what operators have decided; either message may come first."""
        container = self._tree.get(SECTION, "containers", key, default={})
        server, path = container.get("server", ""), container.get("path", "")
        within = path.strip("/").split("/")[1:]
        for decided in list(self._decided):
            if decided.labels[:-1] != within or not re.fullmatch(
                rf"{re.escape(decided.server)}(_\d+)?", server
            ):
                continue
            steps = self._tree.get(SECTION, "containers", key, "steps", default={})
            for number in sorted(steps, key=int, reverse=True):
                step = steps[number]
                if step["state"] == decided.labels[-1] and step["at"] >= decided.at and "said" not in step:
                    marked = {**step, "outcome": [decided.outcome], "said": decided.said}
                    self._tree.set(SECTION, "containers", key, "steps", number, marked)
                    self._decided.remove(decided)
                    break

    def _set(self, key: str, fields: Dict[str, Any]) -> bool:
        return self._tree.put(SECTION, "containers", key, **fields)

    def _is_seen(self, key: str, wall: float) -> None:
        self._seen[key] = wall
        self._set(key, {"silent": False})

    def _report_change(self, name: str, active: List[str], outcome: Optional[str], at: float) -> None:
        if active:
            said = say("in {state}", state=", ".join(active))
        else:
            said = say("ended with {outcome}", outcome=outcome) if outcome else say("ended")
        self._report(sentence("machine", with_reason(name, said), at))


def held_words(path: str) -> Phrase:
    """The sentence that a machine is held before a state.

    :param path: of the state: ``NAVIGATE/DRIVE``.
    """
    machine, _, state = path.partition("/")
    return say("held before state {state} of {machine}", state=state, machine=machine)


def unconfirmed_words(path: str, outcome: str) -> Phrase:
    """The sentence that the outcome of a state waits for an operator."""
    return say("{outcome} of {state} waits for an operator", outcome=outcome, state=path)


def _decided_words(message: Any) -> Phrase:
    """The result of an operator's decision, from a merlin_msgs/StateOutcome."""
    blanks = {"state": message.state, "outcome": message.outcome, "client": message.operator}
    if not message.operator:
        return say("{state} left with {outcome}, not confirmed: there was no console", **blanks)
    if message.refused:
        said = say("{client} wished {outcome} of {state}, which did not come true", **blanks)
        return with_reason(said, message.refused)
    if message.ended == message.outcome:
        return say("{state} left with {outcome}, confirmed by {client}", **blanks)
    said = say("{state} left with {outcome}, forced by {client}", **blanks)
    if not message.unset:
        return said
    return say("{what}; nothing has set {keys}", what=said, keys=", ".join(message.unset))


def container_key(server: str, path: str, node: str = "") -> str:
    """How a container is known."""
    return f"{node} {server} {path}"


def _key_in(container: Dict[str, Any], label: str) -> str:
    return container_key(container["server"], inside(container["path"], label), container["node"])


def _rooted(path: str) -> str:
    return f"/{path.lstrip('/')}"


def _last_edges(
    known: Dict[str, Any],
    fields: Dict[str, Any],
    before: List[str],
    active: List[str],
    outcome: Optional[str],
) -> Dict[str, List[str]]:
    """Which outcome each state left with last: state → outcomes that fit what was seen.

    SMACH does not publish outcomes, only where the machine is; several may lead to one place.
    """
    last: Dict[str, List[str]] = dict(fields.get("last", known.get("last") or {}))
    for state in before:
        if state in active:
            continue
        fitting = [
            label
            for label, source, target in known.get("edges", [])
            if source == state and _leads(label, target, active, outcome)
        ]
        last[state] = sorted(set(fitting))
    return last


def _leads(label: str, target: str, active: List[str], outcome: Optional[str]) -> bool:
    if active:
        return target in active
    return (target or label) == outcome if outcome else True


def _userdata(local_data: str) -> Dict[str, Any]:
    try:
        rows = userdata_rows(local_data)
    except UserDataTextError as error:
        return {"userdata": [], "userdata_error": str(error)}
    return {"userdata": [list(row) for row in rows], "userdata_error": ""}
