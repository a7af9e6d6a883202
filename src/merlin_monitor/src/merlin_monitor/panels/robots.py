"""The panel of the robots of one plan: which of them does what, and why one takes no actions."""

from typing import Any, Dict, List

from merlin_msgs.msg import DispatchStatus, RobotHost

from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.state.events import Reporter, sentence
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.fact_text import atom_text
from merlin_monitor.text.phrase import say, with_reason
from merlin_sm.robot_roster import RobotRoster, sender_of

SECTION = "robots"
SILENT = 2.0  # s of wall time after which a host is gone, as for the bridges
MOST_OPERATORS = 1000  # whose parameters are remembered; a node may name them without end


class RobotsSection:
    """Keeps the section ``robots`` of the state: those that have sent a message, and their parameters."""

    def __init__(self, tree: StateTree, report: Reporter) -> None:
        self._tree = tree
        self._report = report
        self._heard: Dict[str, Dict[str, float]] = {}  # robot -> node of a host -> s of wall time
        self._away: Dict[str, str] = {}
        self._parameters: Dict[str, str] = {}  # operator -> variable
        self._running: List[Any] = []
        self._roster = RobotRoster()

    def host(self, word: Any, at: float, wall: float) -> None:
        """Takes a message with the fields of merlin_msgs/RobotHost.

        :param wall: s of ``ros.wall()``.
        """
        admission = self._roster.admit(word.robot, sender_of(word), wall)
        if admission.forgotten:
            self._forget(admission.forgotten)
        if not admission.counts:
            return
        hosts = self._heard.setdefault(word.robot, {})
        if word.leaving:
            hosts.pop(word.node, None)
        else:
            hosts[word.node] = wall
        parameters = dict(zip(word.operators, word.robot_parameters))
        if not parameters.items() <= self._parameters.items():
            kept = [*self._parameters.items(), *parameters.items()][-MOST_OPERATORS:]
            self._parameters = dict(kept)
            self._tree.set(SECTION, "parameters", dict(self._parameters))
        away = word.out or self._why_away(word.robot, "its host has ended")
        if away != self._away.get(word.robot):
            self._put(word.robot, away, at)

    def dispatcher(self, message: Any, at: float) -> None:
        """Takes a message with the fields of merlin_msgs/DispatchStatus."""
        self._running = list(message.running)
        for robot in self._heard:
            self._tree.set(SECTION, "robots", robot, "does", self._does(robot))

    def check_silence(self, at: float, wall: float) -> None:
        """Notices hosts that are silent."""
        for robot, hosts in self._heard.items():
            silent = [node for node, heard in hosts.items() if wall - heard > SILENT]
            for node in silent:
                del hosts[node]
            away = self._why_away(robot, "its host is silent")
            if silent and away != self._away.get(robot):
                self._put(robot, away, at)

    def _forget(self, robot: str) -> None:
        self._heard.pop(robot, None)
        self._away.pop(robot, None)
        self._tree.remove(SECTION, "robots", robot)

    def _why_away(self, robot: str, gone: str) -> str:
        hosts = sorted(self._heard[robot])
        if len(hosts) > 1:
            return f"two hosts say that they are it: {' and '.join(hosts)}"
        return "" if hosts else gone

    def _does(self, robot: str) -> List[str]:
        found: List[str] = []
        for action in self._running:
            values = {parameter.key: parameter.value for parameter in action.parameters}
            if values.get(self._parameters.get(action.name, "")) == robot:
                found.append(atom_text(action.name, list(values.values())))
        return found

    def _put(self, robot: str, away: str, at: float) -> None:
        before = self._away.get(robot)
        self._away[robot] = away
        self._tree.set(SECTION, "robots", robot, {"away": away, "does": self._does(robot)})
        if away:
            said = with_reason(say("robot {robot} takes no actions", robot=robot), away)
            self._report(sentence("health", said, at, "failure"))
        elif before:
            self._report(sentence("health", say("robot {robot} takes actions again", robot=robot), at))


class RobotsPanel(Panel):
    """The robots; shown where hosts say that they are robots of the plan."""

    name, place = SECTION, 3

    def __init__(self, state: MonitorModel, watch: GraphWatch) -> None:
        super().__init__(state, watch)
        self._section = RobotsSection(state.tree, state.report)
        knowledge_base = str(self.ros.parameter("~knowledge_base", "rosplan_knowledge_base"))
        dispatcher = str(self.ros.parameter("~plan_dispatcher", "rosplan_plan_dispatcher"))
        self._hosts = self.subscribe(f"{knowledge_base}/robots", RobotHost, self._host)
        self._status = self.subscribe(
            f"{dispatcher}/dispatch_status", DispatchStatus, self._section.dispatcher
        )

    def check(self, at: float, wall: float) -> None:
        """Notices silent robots."""
        self._section.check_silence(at, wall)

    def _host(self, word: RobotHost, at: float) -> None:
        self._section.host(word, at, self.ros.wall())
