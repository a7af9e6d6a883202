"""Control of the robot over ROS: the Executor's public client, the mission's and the guard's services."""

import re

import rospy
from actionlib_msgs.msg import GoalID
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.goal_check import GoalError, check_goals
from merlin_monitor.state.events import Event
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.web.control import ControlError
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_sm.knowledge_client import knowledge_client
from merlin_sm.knowledge_text import PDDLSyntaxError, parse_goal

MISSION_ANSWERS = 5.0  # s of wall time
GUARD_ANSWERS = 1.0  # s of wall time
ALL_REQUESTS = GoalID()  # a cancel without name and time is for all goals of an action (actionlib)
_REQUEST = re.compile(r"[^\x00-\x1f]{1,500}\Z")


class RobotControl:
    """The robot as :class:`merlin_monitor.web.control.ControlledRobot` wants it.

    :param state: takes the events.
    """

    def __init__(self, state: MonitorModel) -> None:
        self._state = state
        executor = str(rospy.get_param("~executor", "merlin/execute"))
        knowledge_base = str(rospy.get_param("~knowledge_base", "rosplan_knowledge_base"))
        self._knowledge = knowledge_client(knowledge_base)
        self._client = MerlinExecutorClient(executor, knowledge_base=None)
        self._cancels = rospy.Publisher(f"{executor}/cancel", GoalID, queue_size=10)
        self._mission = {
            pause: ServiceProxy(f"merlin/mission/{name}", Trigger, timeout=MISSION_ANSWERS)
            for pause, name in ((True, "pause"), (False, "resume"))
        }
        self._stops = rospy.Publisher("merlin/stop", Empty, queue_size=1)
        self._stop = ServiceProxy("merlin/stop", Trigger, timeout=GUARD_ANSWERS)
        self._release = ServiceProxy("merlin/release", Trigger, timeout=GUARD_ANSWERS)

    def check(self, goal: str) -> None:
        """Compares a goal with the domain and the objects."""
        try:
            check_goals(parse_goal(goal), self._knowledge)
        except (PDDLSyntaxError, GoalError, ServiceError) as error:
            raise ControlError(str(error)) from error

    def send(self, goal: str, priority: int) -> str:
        """Sends a goal to the Executor."""
        if not self._client.executor_alive:
            raise ControlError("There is no Executor to send the goal to.")
        request = self._client.send(goal, priority)
        self._tell(f"{goal} sent from the page, priority {priority}")
        return request.id

    def cancel(self, request: str) -> None:
        """Cancels a request of anybody."""
        if not _REQUEST.match(request):
            raise ControlError("That is no name of a request.")
        self._cancels.publish(GoalID(id=request))
        self._tell(f"cancel of {request} sent from the page")

    def pause_mission(self, pause: bool) -> str:
        """Asks the mission to pause or to go on."""
        service = self._mission[pause]
        if not service.available():
            raise ControlError("The mission offers no pausing.")
        try:
            answer = service()
        except ServiceError as error:
            raise ControlError(str(error)) from error
        if not answer.success:
            raise ControlError(answer.message or "The mission refused.")
        self._tell(f"mission {'paused' if pause else 'resumed'} from the page")
        return str(answer.message)

    def stop(self) -> str:
        """Has the guard stop the base until its release, and cancels all requests of the Executor.

        The topics come first: they need no answer of a process that may hang.
        """
        self._stops.publish(Empty())
        self._cancels.publish(ALL_REQUESTS)
        self._tell("stop from the page: the base stops, all requests are cancelled")
        self._ask_guard(self._stop, "All requests were cancelled, but the base was not stopped")
        return "All requests were cancelled; the base stands until it is released."

    def release(self) -> str:
        """Lets the base drive again."""
        self._ask_guard(self._release, "The base was not released")
        self._tell("base released from the page")
        return "The base may drive again."

    def _ask_guard(self, service: ServiceProxy, otherwise: str) -> None:
        if not service.available():
            raise ControlError(f"{otherwise}: no velocity guard runs.")
        try:
            answer = service()
        except ServiceError as error:
            raise ControlError(f"{otherwise}: {error}") from error
        if not answer.success:
            raise ControlError(f"{otherwise}: {answer.message}")

    def _tell(self, text: str) -> None:
        self._state.tell(Event("control", text, rospy.get_time()))
