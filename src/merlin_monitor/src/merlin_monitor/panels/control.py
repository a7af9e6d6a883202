# SPDX-License-Identifier: Apache-2.0
"""The panel of the control: for operators only, it sends goals; the application may offer some by name."""

from pathlib import Path
from typing import Any, List, NamedTuple, Optional

import rospy

from merlin_monitor.access.operators import Operators, OperatorsError
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.text.phrase import in_english, say
from merlin_monitor.text.sentences import Sentences, SentencesError, YamlFileError, read_sentences, read_yaml
from merlin_monitor.text.wording import Wording
from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal
from merlin_ros.parameters import ParameterError

#: Value of a parameter for: none; roslaunch drops an argument that is empty.
NONE = "none"
#: Names the file of the sentences for page, terminal view and rviz; recorded: its `file` and `text`.
SENTENCES = "merlin/sentences"
LONGEST = 4000  # characters of a goal
MOST = 200  # goals


class GoalListError(ParameterError):
    """The list cannot be used; the text names it and says why."""


class OfferedGoal(NamedTuple):
    """A goal in PDDL, what it is called, and its priority."""

    name: str
    goal: str
    priority: int = 0


def read_goals(path: Path) -> List[OfferedGoal]:
    """The goals of a file: a list of texts, or of ``{name, goal, priority}``.

    :raises GoalListError: when it cannot be used.
    """
    try:
        found = read_yaml(path, "the list of goals")
    except YamlFileError as error:
        raise GoalListError(str(error)) from error
    if not isinstance(found, list) or not found:
        raise GoalListError(f"the list of goals {path} is not a list; write - {{name: …, goal: (…)}}")
    if len(found) > MOST:
        raise GoalListError(f"the list of goals {path} has {len(found)} goals; at most {MOST} are shown")
    goals = [
        _goal(entry, f"the list of goals {path}, entry {number}") for number, entry in enumerate(found, 1)
    ]
    names = [goal.name for goal in goals]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise GoalListError(f"the list of goals {path} has two goals with the name {twice[0]!r}")
    return goals


def _goal(entry: Any, where: str) -> OfferedGoal:
    if isinstance(entry, str):
        entry = {"goal": entry}
    if not isinstance(entry, dict):
        raise GoalListError(f"{where} is {entry!r}; write {{name: …, goal: (…)}}")
    unknown = [str(field) for field in entry if field not in OfferedGoal._fields]
    if unknown:
        raise GoalListError(f"{where} has {unknown[0]!r}; there is {', '.join(OfferedGoal._fields)}")
    goal, priority = entry.get("goal"), entry.get("priority", 0)
    if not isinstance(goal, str) or not goal.strip() or len(goal) > LONGEST:
        raise GoalListError(f"{where} has no goal; write goal: (checked kitchen)")
    if not isinstance(priority, int) or isinstance(priority, bool) or abs(priority) >= 2**31:
        raise GoalListError(f"{where} has the priority {priority!r}, which is not a whole number")
    try:
        parse_goal(goal)
    except PDDLSyntaxError as error:
        raise GoalListError(f"{where}: {goal}: {error}") from error
    name = entry.get("name") or in_english(Wording().goal(goal))
    if not isinstance(name, str):
        raise GoalListError(f"{where} has the name {name!r}, which is not a text")
    return OfferedGoal(name, " ".join(goal.split()), priority)


class ControlPanel(Panel):
    """Goals that an operator sends."""

    name, place, width = "control", 15, 7

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        self._operators = operators_of_node(self.ros)
        self._trouble = ""
        open_stop = self._operators is not None and bool(self.ros.parameter("~open_stop", True))
        self.state.tree.set("meta", "open_stop", open_stop)
        goals = path_of_node(self.ros, "~goals")
        self.set("goals", [goal._asdict() for goal in read_goals(goals)] if goals is not None else [])

    def check(self, at: float, wall: float) -> None:
        """Notices operators that are made, changed and removed while the monitor runs."""
        if self._operators is None:
            return
        self.state.tree.set("meta", "control", bool(self._operators.names))
        if self._operators.trouble != self._trouble:
            self._trouble = self._operators.trouble
            if self._trouble:
                self.report("control", say("{why}; the operators of before stay", why=self._trouble), at)
                rospy.logerr(self._trouble)


def operators_of_node(ros: RosSystem) -> Optional[Operators]:
    """The operators of the file ``~operators``; None: the node has no such file.

    :raises ParameterError: when it exists and cannot be used.
    """
    path = path_of_node(ros, "~operators")
    try:
        return None if path is None else Operators(path)
    except OperatorsError as error:
        raise ParameterError(str(error)) from error


def sentences_of_node(ros: RosSystem, needed: bool = True) -> Sentences:
    """The sentences of the file `SENTENCES`.

    :param needed: False: where it cannot be used, the log says so, and the words are made of the names; the
        file of a robot is not on each computer.
    :raises ParameterError: when it cannot be used.
    """
    recorded = ros.parameter(SENTENCES, "")
    try:
        if isinstance(recorded, dict):
            return read_sentences(Path(str(recorded.get("file"))), str(recorded.get("text")))
        path = path_of_node(ros, SENTENCES)
        return Sentences() if path is None else read_sentences(path)
    except SentencesError as error:
        if needed:
            raise ParameterError(str(error)) from error
        rospy.logwarn(f"{error}; words are made of the names in PDDL")
        return Sentences()


def path_of_node(ros: RosSystem, parameter: str) -> Optional[Path]:
    """The file that a parameter names; None: it is empty or ``none``."""
    text = str(ros.parameter(parameter, ""))
    return None if text in ("", NONE) else Path(text).expanduser()
