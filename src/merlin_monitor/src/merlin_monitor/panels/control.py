"""The panel of the control: for operators only, it sends goals."""

from pathlib import Path
from typing import Optional

import rospy

from merlin_monitor.access.operators import Operators, OperatorsError
from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_ros.parameters import ParameterError


class ControlPanel(Panel):
    """Goals that an operator sends."""

    name, place = "control", 3

    def __init__(self, state: MonitorModel, watch: GraphWatch) -> None:
        super().__init__(state, watch)
        self._operators = operators_of_node()
        self._trouble = ""

    def check(self, at: float, wall: float) -> None:
        """Notices operators that are made, changed and removed while the monitor runs."""
        if self._operators is None:
            return
        self.state.tree.set("meta", "control", bool(self._operators.names))
        if self._operators.trouble != self._trouble:
            self._trouble = self._operators.trouble
            if self._trouble:
                self.tell("control", f"{self._trouble}; the operators of before stay", at)
                rospy.logerr(self._trouble)


def operators_of_node() -> Optional[Operators]:
    """The operators of the file ``~operators``; None: the node has no such file.

    :raises ParameterError: when it exists and cannot be used.
    """
    path = str(rospy.get_param("~operators", ""))
    try:
        return Operators(Path(path).expanduser()) if path else None
    except OperatorsError as error:
        raise ParameterError(str(error)) from error
