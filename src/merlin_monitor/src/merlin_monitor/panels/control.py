"""The panel of the control: for operators only, it sends goals; the application may offer some by name."""

from pathlib import Path
from typing import List, Optional

import rospy

from merlin_monitor.access.operators import Operators, OperatorsError
from merlin_monitor.listeners.goal_list import GoalListError, OfferedGoal, read_goals
from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.text.phrase import say
from merlin_ros.parameters import ParameterError

#: Value of a parameter for: none; roslaunch drops an argument that is empty.
NONE = "none"


class ControlPanel(Panel):
    """Goals that an operator sends."""

    name, place = "control", 3

    def __init__(self, state: MonitorModel, watch: GraphWatch) -> None:
        super().__init__(state, watch)
        self._operators = operators_of_node(self.ros)
        self._trouble = ""
        self.state.tree.set("meta", "open_stop", self._operators is not None and open_stop_of_node(self.ros))
        self.set("goals", [goal.shown for goal in goals_of_node(self.ros)])

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


def open_stop_of_node(ros: RosSystem) -> bool:
    """Whether everybody who sees the page may stop the robot, ``~open_stop``."""
    return bool(ros.parameter("~open_stop", True))


def goals_of_node(ros: RosSystem) -> List[OfferedGoal]:
    """The goals of the file ``~goals``.

    :raises ParameterError: when it cannot be used.
    """
    path = path_of_node(ros, "~goals")
    try:
        return [] if path is None else read_goals(path)
    except GoalListError as error:
        raise ParameterError(str(error)) from error


def path_of_node(ros: RosSystem, parameter: str) -> Optional[Path]:
    """The file that a parameter names; None: it is empty or ``none``."""
    text = str(ros.parameter(parameter, ""))
    return None if text in ("", NONE) else Path(text).expanduser()
