"""Finds the panels, and lets them follow what they show; for the page's node and the terminal view."""

import importlib
import pkgutil
import re
import time
from pathlib import Path
from typing import Dict, Iterable, List, Type

import rospkg
import rospy

from merlin_monitor import panels
from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.pulse import Pulse
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_ros.class_path import load_class
from merlin_ros.parameters import ParameterError

OWN_SCRIPT = "package://merlin_monitor/web/panels/{}.js"
_NAME = re.compile(r"[a-z][a-z0-9_]{0,40}\Z")
_SCRIPT = re.compile(r"package://([A-Za-z0-9_-]+)/(.+\.js)\Z")


class PanelBoard:
    """All panels of a monitor.

    :param state: the model.
    :param further: panels of applications, as ``package.module:Class``.
    :raises ParameterError: when one of these cannot be used.
    """

    def __init__(self, state: MonitorModel, further: Iterable[str] = ()) -> None:
        classes = sorted([*own_panels(), *map(foreign_panel, further)], key=lambda panel: panel.place)
        names = [panel.name for panel in classes]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ParameterError(f"~panels: there are two panels called {', '.join(sorted(twice))}")
        self.scripts: Dict[str, Path] = {panel.name: script_of(panel) for panel in classes}
        """File that draws a panel, by its name."""
        self._watch = GraphWatch(self._look)
        self._panels = [panel(state, self._watch) for panel in classes]
        self._pulse = Pulse(state, self._panels, self._sources)
        robot = rospy.get_namespace().strip("/")
        for field, value in (
            ("robot", robot),
            ("simulated", bool(rospy.get_param("/use_sim_time", False))),
            ("started", time.time()),
            ("panels", [panel.described() for panel in classes]),
        ):
            state.tree.set("meta", field, value)

    def start(self) -> None:
        """Begins to follow."""
        for panel in self._panels:
            panel.start()
        self._watch.start()
        self._pulse.start()

    def _sources(self) -> Dict[str, Source]:
        found = ((panel.name, panel.source()) for panel in self._panels)
        return {name: source for name, source in found if source is not None}

    def _look(self, topics: Dict[str, str]) -> None:
        for panel in self._panels:
            panel.look(topics)


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

    :raises ParameterError: when there is none, or it cannot be used.
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
    script = panel.script or OWN_SCRIPT.format(panel.name)
    match = _SCRIPT.match(script)
    if match is None:
        raise ParameterError(f"panel {panel.name}: {script!r} is not package://<package>/<path>.js")
    try:
        path = Path(rospkg.RosPack().get_path(match.group(1))) / match.group(2)
    except rospkg.ResourceNotFound as error:
        raise ParameterError(f"panel {panel.name}: there is no package {error}") from error
    if not path.is_file():
        raise ParameterError(f"panel {panel.name}: there is no file {path}")
    return path
