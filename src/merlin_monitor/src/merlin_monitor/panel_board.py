# SPDX-License-Identifier: Apache-2.0
"""Finds the panels, and lets them follow what they show; for the page's node and the terminal view."""

import importlib
import pkgutil
import re
import time
from pathlib import Path
from typing import Dict, Iterable, List, Optional, Set, Type

import rospy

from merlin_monitor import panels
from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel, Request
from merlin_monitor.listeners.pulse import Pulse
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panel_scripts import script_file
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_ros.class_path import load_class
from merlin_ros.master.master_link import ERRORS, bounded_master
from merlin_ros.parameters import ParameterError

#: Below this parameter each launch file that is started beside the monitor's may name a panel.
OFFERED = "merlin/panels"
_NAME = re.compile(r"[a-z][a-z0-9_]{0,40}\Z")


class PanelBoard:
    """All panels of a monitor.

    :param state: the model.
    :param further: panels of applications, as ``package.module:Class``.
    :param offered: whether the panels below `OFFERED` are added, also those that are named later.
    :param ros: that they follow; None: that of this node.
    :raises ParameterError: when one of these cannot be used.
    """

    def __init__(
        self,
        state: MonitorModel,
        further: Iterable[str] = (),
        offered: bool = False,
        ros: Optional[RosSystem] = None,
    ) -> None:
        self._state = state
        self._offered = OfferedPanels(further) if offered else None
        classes = sorted([*own_panels(), *map(foreign_panel, further)], key=lambda panel: panel.place)
        names = [panel.name for panel in classes]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ParameterError(f"~panels: there are two panels called {', '.join(sorted(twice))}")
        self.scripts: Dict[str, Path] = {panel.name: script_of(panel) for panel in classes}
        """File that draws a panel, by its name."""
        self._watch = GraphWatch(self._look, ros)
        self._panels = [panel(state, self._watch) for panel in classes]  # later ones: by the watch's thread
        asked = self._watch.ros
        self._pulse = Pulse(state, self._panels, self._sources, asked)
        for field, value in (
            ("robot", asked.namespace.strip("/")),
            ("simulated", bool(asked.parameter("/use_sim_time", False))),
            ("started", time.time()),
        ):
            state.tree.set("meta", field, value)
        self._add_offered()
        self._describe()

    def start(self) -> None:
        """Begins to follow."""
        for panel in self._panels:
            panel.start()
        self._watch.start()
        self._pulse.start()

    def requests(self) -> Dict[str, Request]:
        """What operators may ask of the panels."""
        return {name: call for panel in list(self._panels) for name, call in panel.requests().items()}

    def look(self) -> None:
        """Looks once which topics there are, without threads."""
        self._watch.look()

    def beat(self) -> None:
        """Samples and checks once, without threads."""
        self._pulse.beat()

    def _sources(self) -> Dict[str, Source]:
        found = ((panel.name, panel.source()) for panel in self._panels)
        return {name: source for name, source in found if source is not None}

    def _add_offered(self) -> bool:
        """Makes the panels that are offered and not there yet; whether there were any."""
        added = [] if self._offered is None else self._offered.new(self.scripts)
        for kind in added:
            self.scripts[kind.name] = script_of(kind)
            self._panels.append(kind(self._state, self._watch))
        return bool(added)

    def _describe(self) -> None:
        """Sends the page the list of panels; an open page that shows others draws itself anew."""
        panels = sorted(self._panels, key=lambda panel: panel.place)
        self._state.tree.set("meta", "panels", [panel.described() for panel in panels])

    def _look(self, topics: Dict[str, str]) -> None:
        known = len(self._panels)
        if self._add_offered():
            for panel in self._panels[known:]:
                panel.start()
            self._describe()
        for panel in self._panels:
            panel.look(topics)


class OfferedPanels:
    """Panels that other launch files name in parameters, while the monitor runs or before.

    :param known: class paths of panels that the page has already.
    """

    def __init__(self, known: Iterable[str] = ()) -> None:
        self._parameter = rospy.resolve_name(OFFERED)
        self._seen: Set[str] = set(known)

    def new(self, names: Iterable[str]) -> List[Type[Panel]]:
        """The panels that are new since the last call; the log names each unusable one, once.

        :param names: of the panels that there are.
        """
        try:
            found = bounded_master().getParam(self._parameter)
        except ERRORS:  # the master is gone, or there is no such parameter
            return []
        paths = [str(path) for path in found.values()] if isinstance(found, dict) else []
        kinds: List[Type[Panel]] = []
        for path in paths:
            if path in self._seen:
                continue
            self._seen.add(path)
            try:
                kind = foreign_panel(path)
                script_of(kind)
                if kind.name in {*names, *(other.name for other in kinds)}:
                    raise ParameterError(f"there are two panels called {kind.name}")
            except ParameterError as error:
                rospy.logwarn(f"{self._parameter}: {error}; the page goes without it")
            else:
                kinds.append(kind)
        return kinds


def own_panels() -> List[Type[Panel]]:
    """The panels of this package, one in each module of ``merlin_monitor.panels``."""
    found: List[Type[Panel]] = []
    for module_info in pkgutil.iter_modules(panels.__path__):
        module = importlib.import_module(f"{panels.__name__}.{module_info.name}")
        found += [
            kind
            for kind in vars(module).values()
            if isinstance(kind, type) and issubclass(kind, Panel) and kind.__module__ == module.__name__
        ]
    return found


def foreign_panel(path: str) -> Type[Panel]:
    """A panel of another package, ``package.module:Class``.

    :raises ParameterError: when the parameter is missing or cannot be used.
    """
    try:
        kind = load_class(path)
    except ValueError as error:
        raise ParameterError(f"~panels: {error}") from error
    if not issubclass(kind, Panel):
        raise ParameterError(f"~panels: {path!r} is not a merlin_monitor.listeners.panel.Panel")
    if not _NAME.match(kind.name):
        raise ParameterError(f"~panels: {path!r} has the name {kind.name!r}; use a-z, 0-9 and _")
    return kind


def script_of(panel: Type[Panel]) -> Path:
    """The file that draws a panel.

    :raises ParameterError: when it does not exist.
    """
    try:
        return script_file(str(panel.described()["script"]))
    except ValueError as error:
        raise ParameterError(f"panel {panel.name}: {error}") from error
