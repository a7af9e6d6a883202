# SPDX-License-Identifier: Apache-2.0
"""What operators decide about the machines of this node, over ROS."""

import threading
from typing import Optional

import rospy
from merlin_msgs.msg import MachineHolds, StateOutcome
from merlin_msgs.srv import (
    LeaveState,
    LeaveStateRequest,
    LeaveStateResponse,
    SetAutonomy,
    SetAutonomyRequest,
    SetAutonomyResponse,
)
from std_msgs.msg import Header, String

from merlin_pddl.breakpoints import BreakpointError
from merlin_planning.breakpoint_service import BreakpointService
from merlin_ros.parameters import ParameterError
from merlin_ros.publishing import publish
from merlin_sm.autonomy import LEVELS, read_level
from merlin_sm.holding.outcomes import Left, NoSuchState, Outcomes
from merlin_sm.holding.state_holds import StateHolds

#: The private names of each node's services; by the first one consoles find the nodes.
SERVICE = "state_breakpoints"
LEAVE_SERVICE = "leave_state"
AUTONOMY_SERVICE = "set_autonomy"
#: Topic on which every node publishes what it holds.
HOLDS_TOPIC = "merlin/machine_holds"
#: Topic on which every node publishes how a state was left for which an operator had decided.
OUTCOMES_TOPIC = "merlin/state_outcomes"
#: Where every console that follows that says so.
CONSOLES_TOPIC = "merlin/consoles"


def usual_level() -> int:
    """The level of the parameter ``~autonomy``.

    :raises ParameterError: there is no such level.
    """
    value = rospy.get_param("~autonomy", LEVELS[-1])
    try:
        return read_level("off" if value is False else str(value))  # YAML reads off as false
    except ValueError as error:
        raise ParameterError(f"parameter ~autonomy: {error}") from error


class NodeHolds:
    """What operators decide about the machines of this node; they reach it over ROS after :meth:`offer`."""

    def __init__(self) -> None:
        self.states = StateHolds()
        self.outcomes = Outcomes(self.states)
        self._lock = threading.Lock()  # guards the fields below, and the order of what is published
        self._publisher: Optional[rospy.Publisher] = None
        self._lefts: Optional[rospy.Publisher] = None

    def offer(self) -> None:
        """Takes operators' requests from now on, and publishes what is held; further calls do nothing.

        :raises ParameterError: when the parameter ``~autonomy`` is not a level.
        """
        level = usual_level()
        with self._lock:
            if self._publisher is not None:
                return
            self._lefts = rospy.Publisher(OUTCOMES_TOPIC, StateOutcome, queue_size=10)
            self._publisher = rospy.Publisher(HOLDS_TOPIC, MachineHolds, queue_size=10, latch=True)
        self.states.on_change, self.outcomes.on_left = self._publish, self._publish_left
        self.states.on_lost = rospy.logwarn
        rospy.Subscriber(CONSOLES_TOPIC, String, lambda _: self.states.followed(), queue_size=10)
        BreakpointService(self.states, self._publish).offer(f"~{SERVICE}")
        rospy.Service(f"~{LEAVE_SERVICE}", LeaveState, self._leave)
        rospy.Service(f"~{AUTONOMY_SERVICE}", SetAutonomy, self._set_autonomy)
        self.states.set_level(level, usual=True)

    def _leave(self, request: LeaveStateRequest) -> LeaveStateResponse:
        by = request.operator or "an operator"
        try:
            said = self.outcomes.leave(request.state, request.outcome, by)
        except BreakpointError as error:
            return LeaveStateResponse(False, not isinstance(error, NoSuchState), str(error))
        rospy.loginfo(f"{by}: {said}")
        return LeaveStateResponse(True, True, said)

    def _set_autonomy(self, request: SetAutonomyRequest) -> SetAutonomyResponse:
        try:
            self.outcomes.set_level(request.level)
        except ValueError as error:
            return SetAutonomyResponse(False, str(error))
        return SetAutonomyResponse(True, f"The autonomy level is {request.level}.")

    def _publish(self) -> None:
        states, level = self.states, self.outcomes.level
        with self._lock:
            header = Header(stamp=rospy.Time.now())
            confirm = states.unconfirmed
            paths, outcomes = [path for path, _ in confirm], [outcome for _, outcome in confirm]
            publish(
                self._publisher,
                MachineHolds(header, rospy.get_name(), states.texts, states.waiting, level, paths, outcomes),
            )

    def _publish_left(self, left: Left) -> None:
        header = Header(stamp=rospy.Time.now())
        publish(self._lefts, StateOutcome(header, rospy.get_name(), *left[:5], list(left.unset)))


#: Of this process.
node_holds = NodeHolds()
