# SPDX-License-Identifier: Apache-2.0
"""Finds the panels, and lets them follow what they show; for the page's node and the terminal view."""

import importlib
import pkgutil
import re
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Set, Type, TypeVar

import rospy
from merlin_msgs.msg import SimStatus

from merlin_monitor import panels
from merlin_monitor.listeners.panel import Panel, Request
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panel_scripts import script_file
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.truth.worst_truth import SIMULATOR
from merlin_ros.actions.peers import sender_of
from merlin_ros.class_path import load_class
from merlin_ros.deadline import SIM_STATUS_TOPIC
from merlin_ros.master.master_link import ERRORS, bounded_master
from merlin_ros.parameters import ParameterError
from merlin_ros.work.threads import failure_text, start_thread

#: Below this parameter each launch file that is started beside the monitor's may name a panel.
OFFERED = "merlin/panels"
LOOK = 1.0  # s of wall time between two looks at the ROS graph: the master sends no events
SAMPLE = 0.25  # s of wall time between two samples of what has no messages
CHECKS = 0.5  # s of wall time between two looks at what is silent
COMPLAINTS = 30.0  # s of wall time between two lines about a panel that raises
_NAME = re.compile(r"[a-z][a-z0-9_]{0,40}\Z")
A = TypeVar("A")


class PanelBoard:
    """All panels of a monitor, and what changes without an event: topics, the time, a silent node.

    :param state: the model.
    :param further: panels of applications, as ``package.module:Class``.
    :param offered: whether the panels below `OFFERED` are added, also those that are named later.
    :param ros: that they follow; None: that of this node.
    :param only: these panels alone; None: all of this package.
    :raises ParameterError: when one of these cannot be used.
    """

    def __init__(
        self,
        state: MonitorModel,
        further: Iterable[str] = (),
        offered: bool = False,
        ros: Optional[RosSystem] = None,
        only: Optional[Iterable[Type[Panel]]] = None,
    ) -> None:
        self._state = state
        self._offered = OfferedPanels(further) if offered else None
        classes = [*(own_panels() if only is None else only), *map(foreign_panel, further)]
        classes.sort(key=lambda panel: panel.place)
        names = [panel.name for panel in classes]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ParameterError(f"~panels: there are two panels called {', '.join(sorted(twice))}")
        self.scripts: Dict[str, Path] = {panel.name: script_of(panel) for panel in classes}
        """File that draws a panel, by its name."""
        self._ros = asked = ros or RosSystem()
        self._panels = [panel(state, asked) for panel in classes]  # later ones: by the thread that looks
        self._checked = 0.0  # s of wall time; of the thread that beats
        self._complained: Dict[str, float] = {}  # panel → s of wall time
        self._stopped = threading.Event()
        self._simulator: Any = None  # its subscriber
        self._simulator_node = ""
        simulated = bool(asked.parameter("/use_sim_time", False))
        if simulated:  # elsewhere its topic says nothing
            take = self._take_simulator
            self._simulator = asked.subscribe(SIM_STATUS_TOPIC, SimStatus, take, queue_size=10)
        state.tree.put("meta", robot=asked.namespace.strip("/"), simulated=simulated, started=time.time())
        self._add_offered()
        self._describe()

    def start(self, beats: bool = True) -> None:
        """Begins to follow.

        :param beats: whether it also samples and checks.
        """
        for panel in self._panels:
            panel.start()
        rospy.on_shutdown(self.stop)
        start_thread("topic watch", self._repeat, self.look, LOOK)
        if beats:
            start_thread("pulse", self._repeat, self.beat, SAMPLE)

    def stop(self) -> None:
        """Ends the threads."""
        self._stopped.set()

    def _repeat(self, call: Callable[[], object], period: float) -> None:
        while not self._stopped.is_set():
            try:
                call()
            except Exception as error:  # the master may be gone; a page without these threads is grey forever
                if not rospy.is_shutdown():
                    rospy.logwarn_throttle(30.0, f"monitor: {failure_text(error)}")
            self._stopped.wait(period)

    def requests(self) -> Dict[str, Request]:
        """What operators may ask of the panels; of two of a name, that of the first panel."""
        found: Dict[str, Request] = {}
        for offered in self._each(lambda panel: panel.requests()).values():
            found = {**offered, **found}
        return found

    def _each(self, call: Callable[[Panel], A], first: int = 0) -> Dict[str, A]:
        """What a call of each panel returns, by their names, without those that raise, which the log names.

        :param first: of them.
        """
        found: Dict[str, A] = {}
        for panel in self._panels[first:]:
            try:
                found[panel.name] = call(panel)
            except Exception as error:  # of a foreign panel, or of one of ours that read something strange
                now = time.monotonic()
                silent = now < self._complained.get(panel.name, -COMPLAINTS) + COMPLAINTS
                if not silent and not rospy.is_shutdown():
                    self._complained[panel.name] = now
                    rospy.logerr(f"panel {panel.name}: {failure_text(error)}")
        return found

    def look(self) -> None:
        """Looks once which topics there are."""
        topics = self._ros.look()
        if topics is None:
            return
        known = len(self._panels)
        if self._add_offered():
            self._each(lambda panel: panel.start(), known)
            self._describe()
        self._each(lambda panel: panel.look(topics))

    def beat(self) -> None:
        """Samples, and checks when it is time for that."""
        self._each(lambda panel: panel.sample())
        ros, now = self._ros, self._ros.wall()
        if now - self._checked >= CHECKS:
            self._checked = now
            self._state.tree.set("meta", "clock_set", round(ros.clock_set(), 1))
            sources = self._each(lambda panel: panel.source())
            fed = {name: source for name, source in sources.items() if source is not None}
            self._state.inbox.put(self._check, ros.time(), ros.silence_clock(), now, fed, self._owners())

    def _check(
        self,
        at: float,
        silence: float,
        now: float,
        sources: Mapping[str, Source],
        owners: Mapping[str, Source],
    ) -> None:
        self._state.tree.set("meta", "time", round(at, 1))
        self._each(lambda panel: panel.check(at, silence))
        self._state.freshness.check(at, sources, owners)
        self._state.now.refresh()
        self._state.refresh_problems(silence)
        self._state.checked_at = now

    def _owners(self) -> Dict[str, Source]:
        owners: Dict[str, Source] = {}
        for own in self._each(lambda panel: panel.owners()).values():
            owners.update(own)
        if self._simulator is not None:
            owners[SIMULATOR] = Source(bool(self._simulator.get_num_connections()), self._simulator_node)
        return owners

    def _take_simulator(self, message: SimStatus) -> None:
        self._simulator_node = sender_of(message)
        shown = {"paused": message.paused, "factor": round(message.achieved_factor, 1)}
        self._state.inbox.put(self._state.tree.set, "meta", "simulator", shown)

    def _add_offered(self) -> bool:
        """Makes the panels that are offered and not there yet; whether there were any."""
        known = len(self._panels)
        for kind in [] if self._offered is None else self._offered.new(self.scripts):
            try:
                self._panels.append(kind(self._state, self._ros))
            except Exception as error:  # of a foreign panel
                rospy.logerr(f"panel {kind.name}: {failure_text(error)}; the page goes without it")
            else:
                self.scripts[kind.name] = script_of(kind)
        return len(self._panels) > known

    def _describe(self) -> None:
        """Sends the page the list of panels; an open page that shows others draws itself anew."""
        panels = sorted(self._panels, key=lambda panel: panel.place)
        self._state.tree.set("meta", "panels", [panel.described() for panel in panels])


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


def panel_paths(value: Any) -> List[str]:
    """The panels of other packages, as a launch file names them.

    :param value: of the parameter ``~panels``.
    :raises ParameterError: when it is not a list of texts.
    """
    if not isinstance(value, list) or not all(isinstance(path, str) for path in value):
        raise ParameterError(f"parameter ~panels is {value!r}; give [package.module:Class, …]")
    return value


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
