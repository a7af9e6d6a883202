"""The section of the state machines: every container of every introspection server, and where it is."""

import re
from typing import Any, Callable, Dict, List, Optional, Set

from merlin_monitor.state.events import Event, Tell
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.userdata_text import UserDataTextError, userdata_rows

SECTION = "machines"
SILENT_AFTER = 7.0  # s of wall time: three heartbeats
NO_STATE = "None"  # SMACH's word for no active state, and for no target
_TERMINATED = re.compile(r"TERMINATED: (.+)\Z", re.DOTALL)


class MachineSection:
    """Keeps the section ``machines`` of the state.

    A container is known by its server and its path, so that machines of two nodes with one path stay apart.

    :param structure_changed: called with the key of the root container whose picture is out of date, or that
        is no more.
    """

    def __init__(self, tree: StateTree, tell: Tell, structure_changed: Callable[[str], None]) -> None:
        self._tree = tree
        self._tell = tell
        self._structure_changed = structure_changed
        self._local_data: Dict[str, str] = {}
        self._seen: Dict[str, float] = {}
        tree.set(SECTION, "containers", {})
        tree.set(SECTION, "layouts", {})

    def structure(self, server: str, message: Any, wall: float) -> None:
        """Takes a message with the fields of smach_msgs/SmachContainerStructure.

        :param server: its introspection server.
        :param wall: time in s that goes on when the simulation does not.
        """
        key = container_key(server, message.path)
        edges = [
            [outcome, source, "" if target in ("", NO_STATE) else target]
            for outcome, source, target in zip(
                message.internal_outcomes, message.outcomes_from, message.outcomes_to
            )
        ]
        fields = {
            "server": server,
            "path": message.path,
            "children": list(message.children),
            "edges": edges,
            "outcomes": sorted(set(message.container_outcomes)),
        }
        changed = self._set(key, fields)
        self._is_seen(key, wall)
        if changed:
            self._structure_changed(self.root_of(key))

    def status(self, server: str, message: Any, at: float, wall: float) -> None:
        """Takes a message with the fields of smach_msgs/SmachContainerStatus."""
        key = container_key(server, message.path)
        known = self._tree.get(SECTION, "containers", key, default={})
        active = [state for state in message.active_states if state != NO_STATE]
        before = known.get("active", [])
        ended = _TERMINATED.match(message.info)
        fields: Dict[str, Any] = {
            "server": server,
            "path": message.path,
            "active": active,
            "initial": list(message.initial_states),
        }
        if ended:
            fields["outcome"] = ended.group(1)
        elif active and not before:
            fields["outcome"] = ""
            fields["last"] = {}
        if known and (active != before or ended):
            fields["last"] = _last_edges(known, fields, before, active, ended and ended.group(1))
            fields["since"] = at
        self._set(key, fields)
        self._is_seen(key, wall)
        if message.local_data != self._local_data.get(key):
            self._local_data[key] = message.local_data
            self._set(key, _userdata(message.local_data))
        if known and active != before and len(message.path.strip("/").split("/")) == 1:
            self._tell_change(message.path, active, ended and ended.group(1), at)

    def server_gone(self, server: str) -> None:
        """Forgets the containers of a server that is no more."""
        for key in self._tree.keys(SECTION, "containers"):
            if self._tree.get(SECTION, "containers", key, "server") == server:
                self._tree.remove(SECTION, "containers", key)
                self._tree.remove(SECTION, "layouts", key)
                self._seen.pop(key, None)
                self._local_data.pop(key, None)
                self._structure_changed(key)

    def check_silence(self, wall: float, paused: bool) -> None:
        """Marks containers that have not been heard of for long."""
        if paused:
            self._seen = dict.fromkeys(self._seen, wall)
        for key, seen in self._seen.items():
            self._set(key, {"silent": wall - seen > SILENT_AFTER})

    def root_of(self, key: str) -> str:
        """The key of the outermost known container around one."""
        server, _, path = key.partition(" ")
        containers = set(self._tree.keys(SECTION, "containers"))
        parts = path.strip("/").split("/")
        for length in range(1, len(parts)):
            outer = container_key(server, "/" + "/".join(parts[:length]))
            if outer in containers:
                return outer
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
            inside = container["path"].rstrip("/")
            waiting += [
                container_key(container["server"], f"{inside}/{name}") for name in container["children"]
            ]
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
            path = f"{container['path'].strip('/')}/{active[0]}"
            inner = self._tree.get(SECTION, "containers", container_key(container["server"], f"/{path}"))
            if inner is None:
                return path
            container = inner
        return path

    def _set(self, key: str, fields: Dict[str, Any]) -> bool:
        changed = [self._tree.set(SECTION, "containers", key, name, value) for name, value in fields.items()]
        return any(changed)

    def _is_seen(self, key: str, wall: float) -> None:
        self._seen[key] = wall
        self._set(key, {"silent": False})

    def _tell_change(self, path: str, active: List[str], outcome: Optional[str], at: float) -> None:
        name = path.strip("/")
        if active:
            self._tell(Event("machine", f"{name}: in {', '.join(active)}", at))
        else:
            self._tell(Event("machine", f"{name}: ended{f' with {outcome}' if outcome else ''}", at))


def container_key(server: str, path: str) -> str:
    """How a container is known."""
    return f"{server} {path}"


def _last_edges(
    known: Dict[str, Any],
    fields: Dict[str, Any],
    before: List[str],
    active: List[str],
    outcome: Optional[str],
) -> Dict[str, List[str]]:
    """Which outcome each state left with last: state → outcomes that fit what was seen.

    SMACH does not tell outcomes, only where the machine is; several may lead to one place.
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
