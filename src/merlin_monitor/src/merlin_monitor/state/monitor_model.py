# SPDX-License-Identifier: Apache-2.0
"""Everything that is shown, without ROS: the tree and the sections that keep it."""

import concurrent.futures
import contextlib
from typing import Any, Callable, Container, Dict, List, Mapping, Optional

from merlin_monitor.drawing.graph_layout import DrawnGraph, LayoutThread, machine_graph, plan_graph
from merlin_monitor.history.pictures import Pictures
from merlin_monitor.state.freshness import Freshness
from merlin_monitor.state.guard_section import GuardSection
from merlin_monitor.state.health_section import HealthSection
from merlin_monitor.state.history_events import Event, Reporter, sentence
from merlin_monitor.state.history_store import NEWEST, HistoryError, HistorySection, HistoryStore
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.knowledge_section import KnowledgeSection
from merlin_monitor.state.machine_section import MachineSection
from merlin_monitor.state.map_section import MapSection
from merlin_monitor.state.now_section import NowSection
from merlin_monitor.state.plan_section import PlanSection
from merlin_monitor.state.plan_steps import Edges, ShownStep
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import say
from merlin_monitor.text.sentences import SentencesError
from merlin_monitor.text.wording import Wording
from merlin_monitor.truth.problems import Acknowledged, problems_of
from merlin_ros.work.passed_time import clock_text

PLAN_PICTURE = "plan"
#: Section → its fields that say what is wrong.
PROBLEM_FIELDS = {
    "guard": ("state", "reason", "warning"),
    "now": ("mission", "lost", "silent_nodes"),
    "health": ("parts",),
    "plan": ("planner",),
    "map": ("stands", "trouble"),
}
STARTUP = 10.0  # s of wall time for the history's first answer


class MonitorModel:
    """The model. Its sections are changed in the thread of `inbox` only, but for the pictures, which come
    from the layout's thread, and the history, which comes from its own; the tree is read from anywhere.

    :param inbox: takes the changes in.
    :param history: becomes its own; None: no history is kept.
    """

    def __init__(self, inbox: Inbox, history: Optional[HistoryStore] = None) -> None:
        self.inbox = inbox
        self.tree = StateTree()
        self.pictures = Pictures(self._keep_picture)
        """PNGs of panels, by the names under which the page fetches them."""
        self._history = HistorySection(self.tree)
        self.history = history
        self.on_event: Reporter = lambda event: None
        self._layouts = LayoutThread(self._laid_out)
        self.wording = Wording()
        """What actions, facts and goals are called."""
        self._domain: Dict[str, Any] = {}
        self.knowledge = KnowledgeSection(self.tree, self.report, self.wording)
        self.plan = PlanSection(self.tree, self.report, self.wording)
        self.machines = MachineSection(self.tree, self.report, self._machine_changed)
        self.map = MapSection(self.tree, self.pictures)
        self.health = HealthSection(self.tree, self.report)
        self.freshness = Freshness(self.tree, self.report, self.health)
        self.now = NowSection(self.tree, self.report, self.plan, self.machines, self.freshness)
        self.guard = GuardSection(self.tree, self.report)
        self._acknowledged = Acknowledged()
        self._refreshed = 0.0  # when problems were looked at, s of a clock of the panels
        self.on_guard: Callable[[str, bool], None] = lambda robot, there: None
        """Called with each robot whose guard is found or is gone, in the watch's thread."""
        self.checked_at = float("-inf")
        """When all sections were checked last, s of ``time.monotonic``; old when the model hangs."""
        if history is not None:
            history.on_events = self._history.add

    def start(self) -> None:
        """Begins to take messages in and to draw; shows what earlier runs left in the history."""
        if self.history is not None:
            # A page without the past is still one that can stop the robot.
            with contextlib.suppress(HistoryError, concurrent.futures.TimeoutError):
                self._history.add(self.history.page(limit=NEWEST).result(STARTUP))
            self.tree.set("meta", "run", self.history.run)
            self._take_up(self.history.last_state(STARTUP))
            self.history.follow(self.tree)
        self._layouts.start()
        self.inbox.start()

    def _take_up(self, kept: Mapping[str, Any]) -> None:
        """Remembers what the earlier life knew; what is heard decides whether it is still so."""
        now, meta = kept.get("now", {}), kept.get("meta", {})
        self.plan.remember(kept.get("plan", {}))
        self.now.remember(now)
        self.knowledge.remember(kept.get("knowledge", {}), meta.get("time") or 0.0)
        for problem in now.get("problems", []):
            if problem["by"]:
                self._acknowledged.acknowledge(problem["key"], problem["by"])
        if kept:
            if meta.get("set_back"):
                self.tree.set("meta", "set_back", meta["set_back"])
            said = say("the monitor was started again")
            self.report(sentence("monitor", said, meta.get("time") or 0.0))

    def stop(self) -> None:
        """Ends the threads; all events are on disk then."""
        self.inbox.stop()
        self._layouts.stop()
        if self.history is not None:
            self.history.close()

    def report(self, event: Event) -> None:
        """Remembers an event, and passes it on to `on_event`."""
        self.on_event(event)
        if self.history is not None:
            self.history.add(event)

    def _keep_picture(self, name: str, version: str, picture: bytes) -> None:
        if self.history is not None:
            self.history.add_picture(name, version, picture)

    def refresh_problems(self, wall: float) -> None:
        """Says anew what is wrong.

        :param wall: s of ``ros.silence_clock()``.
        """
        self._refreshed = wall
        panels = self.tree.get("meta", "panels") or []
        names = {*PROBLEM_FIELDS, *(panel["name"] for panel in panels)}
        sections = {name: self._of_problems(name) for name in names}
        if self.history is not None:
            self.tree.set("meta", "run", self.history.run)  # another one in another file
            sections["history"] = {**sections.get("history", {}), **self.history.problems}
        problems = problems_of(sections, panels, clock_text)
        self.tree.set("now", "problems", self._acknowledged.of(problems, wall))

    def acknowledge(self, key: str, by: str, at: float) -> None:
        """An operator knows about a problem.

        :param at: s of ROS time.
        """
        known = {each["key"]: each["said"] for each in self.tree.get("now", "problems") or []}
        if key in known:
            self._acknowledged.acknowledge(key, by)
            self.refresh_problems(self._refreshed)
            said = say("{client} knows: {what}", client=by, what=known[key])
            self.report(sentence("control", said, at, by=by))

    def _of_problems(self, name: str) -> Dict[str, Any]:
        """The fields of a section that tell problems: most of it does not."""
        fields = ("silent", *PROBLEM_FIELDS.get(name, ()))
        return {field: self.tree.get(name, field) for field in fields if self.tree.get(name, field)}

    def planned(self, steps: List[ShownStep], edges: Edges, at: float) -> None:
        """Takes a new plan and has it drawn."""
        self.plan.planned(steps, edges, at)
        self.now.refresh()
        self._draw_plan()

    def domain(self, description: Dict[str, Any], warn: Callable[[str], object] = lambda text: None) -> None:
        """Takes the domain, with which the words are made.

        :param warn: takes, once, which sentences do not fit it.
        """
        if description == self._domain:
            return
        self._domain = description
        faults = self.wording.learn(description)
        if faults:
            warn(f"monitor: {SentencesError(faults)}; such words are made of the names")
        self.knowledge.domain(description)
        self._reword()

    def places(self, names: Container[str]) -> None:
        """Takes the names of the places, with which the words are made."""
        self.wording.places = names
        self._reword()

    def _reword(self) -> None:
        self.plan.reword()
        self.now.reword()
        if self.plan.count:
            self._draw_plan()

    def _draw_plan(self) -> None:
        shown = self.plan.in_words()
        pairs = [edge[:2] for edge in self.tree.get("plan", "edges")]
        self._layouts.ask(PLAN_PICTURE, lambda: plan_graph(shown, pairs))

    def _machine_changed(self, root: str) -> None:
        self._layouts.ask(root, lambda: self._machine_graph(root))

    def _machine_graph(self, root: str) -> Optional[DrawnGraph]:
        containers = self.machines.containers_below(root)
        path = self.tree.get("machines", "containers", root, "path")
        return machine_graph(containers, path) if path in containers else None

    def _laid_out(self, name: str, picture: Optional[Dict[str, Any]], reason: str) -> None:
        if name == PLAN_PICTURE:
            self.tree.put("plan", layout=picture, layout_error=reason)
        else:
            self.machines.layout(name, picture if picture is not None or not reason else {"error": reason})
