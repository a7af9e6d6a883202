# SPDX-License-Identifier: Apache-2.0
"""The panel of the robots of one plan: which of them does what, and why one takes no actions."""

from typing import Any, Dict, List, Optional

from merlin_msgs.msg import DispatchStatus, RobotHost

from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.history_events import Reporter, sentence
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.fact_text import atom_text
from merlin_monitor.text.phrase import Phrase, say, with_reason
from merlin_monitor.text.wording import Wording
from merlin_planning.robot_roster import RobotRoster, is_node
from merlin_ros.actions.peers import sender_of
from merlin_ros.work.liveness import Limits, Liveness, Presence, Word

SECTION = "robots"
SILENT = 2.0  # s of wall time after which a host is gone, as for the bridges
MOST_OPERATORS = 1000  # whose parameters are remembered; a node may name them without end


class RobotsSection:
    """Keeps the section ``robots`` of the state: those that have sent a message, and their parameters."""

    def __init__(self, tree: StateTree, report: Reporter, wording: Optional[Wording] = None) -> None:
        self._wording = wording or Wording()
        self._tree = tree
        self._report = report
        self._hosts: Dict[str, Liveness[str]] = {}  # robot -> nodes of its hosts
        self._looked = 0.0  # s of wall time
        self._out: Dict[str, str] = {}
        self._parameters: Dict[str, str] = {}  # operator -> variable
        self._running: List[Any] = []
        self._roster = RobotRoster()

    def host(self, word: Any, at: float, wall: float) -> None:
        """Takes a message with the fields of merlin_msgs/RobotHost.

        :param wall: s of ``ros.silence_clock()``.
        """
        if not is_node(word.node):  # the bridges do not take it either, and say so
            return
        admission = self._roster.admit(word.robot, sender_of(word), wall)
        if admission.forgotten:
            self._forget(admission.forgotten)
        if not admission.counts:
            return
        self._look(wall)
        hosts = self._hosts.setdefault(word.robot, Liveness(Limits(gone=SILENT)))
        if hosts.heard(word.node, word.life) is Word.IGNORED:
            return
        if word.leaving:
            hosts.left(word.node)
        self._out[word.robot] = word.out
        parameters = dict(zip(word.operators, word.robot_parameters))
        if not parameters.items() <= self._parameters.items():
            kept = [*self._parameters.items(), *parameters.items()][-MOST_OPERATORS:]
            self._parameters = dict(kept)
            self._tree.set(SECTION, "parameters", dict(self._parameters))
            self._wording.run_by(self._parameters)
        self._judge(word.robot, at)

    def dispatcher(self, message: Any, at: float) -> None:
        """Takes a message with the fields of merlin_msgs/DispatchStatus."""
        self._running = list(message.running)
        for robot in self._hosts:
            self._show(robot, self._tree.get(SECTION, "robots", robot, "away", default=""))

    def check_silence(self, at: float, wall: float) -> None:
        """Notices hosts that are silent."""
        self._look(wall)
        for robot in self._hosts:
            self._judge(robot, at)

    def _look(self, wall: float) -> None:
        for hosts in self._hosts.values():
            hosts.pass_time(wall - self._looked)
        self._looked = wall

    def _forget(self, robot: str) -> None:
        self._hosts.pop(robot, None)
        self._out.pop(robot, None)
        self._tree.remove(SECTION, "robots", robot)

    def _judge(self, robot: str, at: float) -> None:
        hosts = self._hosts[robot]
        found = {node: hosts.presence(node) for node in hosts}
        there = sorted(node for node in found if found[node] is Presence.ALIVE)
        away = self._out[robot]
        if len(there) > 1:
            away = f"two hosts say that they are it: {' and '.join(there)}"
        elif not there:
            away = f"its host {'is silent' if Presence.GONE in found.values() else 'has ended'}"
        before = self._tree.get(SECTION, "robots", robot, "away")
        if away != before:
            self._show(robot, away)
            if away:
                said = with_reason(say("robot {robot} takes no actions", robot=robot), away)
                self._report(sentence("health", said, at, "failure"))
            elif before:
                self._report(sentence("health", say("robot {robot} takes actions again", robot=robot), at))

    def _show(self, robot: str, away: str) -> None:
        """Shows what a robot does: in PDDL, and in words that do not name it again."""
        does: List[str] = []
        words: List[Phrase] = []
        for action in self._running:
            values = {parameter.key: parameter.value for parameter in action.parameters}
            if values.get(self._parameters.get(action.name, "")) == robot:
                does.append(atom_text(action.name, list(values.values())))
                words.append(self._wording.action(action.name, list(values.items()), subject=False))
        self._tree.put(SECTION, "robots", robot, away=away, does=does, words=words)


class RobotsPanel(Panel):
    """The robots; shown where hosts say that they are robots of the plan."""

    name, place = SECTION, 3

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        self._section = RobotsSection(state.tree, state.report, state.wording)
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
        self._section.host(word, at, self.ros.silence_clock())
