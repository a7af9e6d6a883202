# SPDX-License-Identifier: Apache-2.0
"""MissionNode: the part of a mission that makes it a node: parameters, waits, exit code."""

import sys
import threading
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, Callable, List, Sequence, Type

import rospy
from merlin_msgs.msg import MissionStatus
from rospy.core import is_shutdown_requested

from merlin_executor.core.mission_arguments import arguments_of
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.mission.mission_pause import HoldWatch
from merlin_executor.mission.mission_reporter import MissionReporter
from merlin_executor.mission.readiness import NotReady, wait_for_robot
from merlin_planning.knowledge_client import KnowledgeError
from merlin_ros.class_path import WITHOUT_BASE, cannot_be_made
from merlin_ros.health import HealthReporter
from merlin_ros.node import CANNOT_BEGIN
from merlin_ros.parameters import ParameterError, number
from merlin_ros.service_proxy import ServiceError
from merlin_sm.holding.node_holds import usual_level
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

#: Exit code of a mission that has ended and did not succeed.
FAILED = 1
#: Exit code of a mission whose node was shut down before the mission ended.
INTERRUPTED = 130


class MissionError(RuntimeError):
    """The mission cannot begin, continue or keep its results; the text says why. Exit code CANNOT_BEGIN."""


class MissionNode(MerlinROSPlanAssistant, ABC):
    """Base of :class:`GoalDispatcher` and :class:`MissionSM`; :func:`run_mission` runs a subclass as a node.

    The parameters of the node are the arguments of the constructor: ``def __init__(self, rooms: str, rounds:
    int = 1)`` reads ``~rooms``, which is required, and ``~rounds``. ``~startup_timeout`` belongs to every
    mission.
    """

    #: Action servers that the mission and its actions use, as relative names; the mission waits for them. Of
    #: several robots each has those whose names have no slash.
    servers: Sequence[str] = ()
    #: Default of ``~tell``: whether its node prints what the robot does, says, hears and sees.
    tells = True
    #: Default of ``~startup_timeout``: s of running time for each part of the robot to appear.
    startup_timeout = 60.0

    client: MerlinExecutorClient
    reporter: MissionReporter

    @classmethod
    def from_parameters(cls) -> "MissionNode":
        """Makes the mission from the parameters of the node.

        :raises ValueError: when a parameter is missing or has a wrong value.
        """
        return cls(**arguments_of(cls, lambda name: rospy.get_param(f"~{name}", None)))

    @classmethod
    def faults(cls, value_of: Callable[[str], Any], fault: Callable[[str], str]) -> List[str]:
        """What `rosrun merlin check` finds wrong with the parameters, one sentence each.

        :param value_of: name of a parameter → its value; None when it is not set.
        :param fault: a goal → what domain and problem do not know of it; empty: nothing.
        """
        return []

    def wait_for_robot(self, timeout: float) -> None:
        """Waits for knowledge base, Executor, action interfaces, robots of ``robots:=`` and :attr:`servers`.

        :param timeout: of each, s of running time.
        :raises NotReady: when one is missing, or the domain does not know a goal that stands in the mission.
        """
        wait_for_robot(self.knowledge, self.client, type(self), self.servers, timeout)

    @abstractmethod
    def carry_out(self) -> bool:
        """Runs the mission to its end and logs why it failed; True when it succeeded."""

    def finish(self, succeeded: bool) -> bool:
        """Called after the mission unless it was interrupted: the place to write results.

        :return: True for exit code 0.
        :raises MissionError: when the results cannot be written.
        """
        return succeeded


def results_folder(path: Path) -> Path:
    """Makes the folder for the results of a mission.

    :raises ParameterError: when the folder cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f"no folder for the results: {error}; give another one, results:=…") from error
    return path


def run_mission(mission_class: Type[MissionNode]) -> int:
    """Runs a mission in the present node, to its end.

    :return: the exit code: 0, :data:`FAILED`, :data:`~merlin_ros.node.CANNOT_BEGIN` after one line that
        says why, or :data:`INTERRUPTED`.
    """
    holds = HoldWatch(threading.Condition())
    code = _run(mission_class)
    # Its launch file ends with it, and the guards, too.
    holds.wait_released(
        lambda why: print(f"mission: it has ended, and stays until the release: {why}", flush=True)
    )
    return code


def _run(mission_class: Type[MissionNode]) -> int:
    mission = None
    try:
        timeout = number("~startup_timeout", mission_class.startup_timeout, 1.0)
        usual_level()  # a wrong one is reported before the wait for the robot
        mission = _made(mission_class)
        HealthReporter({"mission": mission.reporter.health}).start()
        mission.wait_for_robot(timeout)
        succeeded = mission.carry_out()
        if is_shutdown_requested():
            return INTERRUPTED
        return 0 if mission.finish(succeeded) else FAILED
    except (MissionError, NotReady, ParameterError, KnowledgeError, ServiceError) as error:
        if is_shutdown_requested():  # the shutdown interrupts every wait and call
            return INTERRUPTED
        if mission is not None:
            mission.reporter.report(MissionStatus.FAILED, str(error))
        print(f"mission: {error}", file=sys.stderr)
        return CANNOT_BEGIN


def _made(mission_class: Type[MissionNode]) -> MissionNode:
    path = f"{mission_class.__module__}:{mission_class.__name__}"
    try:
        mission = mission_class.from_parameters()
    except ValueError as error:
        raise ParameterError(str(error)) from error
    except (Exception, SystemExit) as error:  # users' code
        raise ParameterError(cannot_be_made(path, error)) from error
    if not hasattr(mission, "reporter"):
        raise ParameterError(f"{path} cannot be made: {WITHOUT_BASE}")
    return mission
