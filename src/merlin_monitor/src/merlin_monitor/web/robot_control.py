"""Control of the robot over ROS: the Executor's public client, its services, and the guard itself.

A stop needs neither Executor nor planner nor state machine: the guard gets it on a topic whose connection
is there already, and its own status says whether it obeyed.
"""

import threading
from typing import Any, Dict, List, Sequence

import rospy
from actionlib_msgs.msg import GoalID
from merlin_msgs.msg import GuardStatus
from std_msgs.msg import String
from std_srvs.srv import Trigger

from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.goal_check import GoalError, check_goals
from merlin_monitor.state.events import sentence
from merlin_monitor.state.freshness import SILENT
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.text.now_words import cancel_words
from merlin_monitor.text.phrase import Phrase, goal_phrase, say
from merlin_monitor.web.control import ControlError
from merlin_monitor.web.robot_breakpoints import RobotBreakpoints
from merlin_monitor.web.robot_knowledge import RobotKnowledge
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_sm.knowledge_client import knowledge_client
from merlin_sm.knowledge_text import PDDLSyntaxError, parse_goal

EXECUTOR_ANSWERS = 3.0  # s of wall time
GUARD_ANSWERS = 1.0  # s of wall time
ALL_REQUESTS = GoalID()  # a cancel without name and time is for all goals of an action (actionlib)


class RobotControl:
    """The robot as :class:`merlin_monitor.web.control.ControlledRobot` wants it.

    :param state: takes the events, and knows which requests there are.
    """

    def __init__(self, state: MonitorModel) -> None:
        self._state = state
        executor = str(rospy.get_param("~executor", "merlin/execute"))
        self._knowledge = knowledge_client(str(rospy.get_param("~knowledge_base", "rosplan_knowledge_base")))
        self._planning = RobotKnowledge(state, self._knowledge, self._report)
        self._breakpoints = RobotBreakpoints(self._knowledge, self._report)
        self._client = MerlinExecutorClient(executor, knowledge_base=None)
        self._cancels = rospy.Publisher(f"{executor}/cancel", GoalID, queue_size=10)
        self._pause = {
            pause: ServiceProxy(f"merlin/{name}", Trigger, timeout=EXECUTOR_ANSWERS)
            for pause, name in ((True, "pause"), (False, "resume"))
        }
        self._stops = rospy.Publisher("merlin/stop_by", String, queue_size=10, tcp_nodelay=True)
        self._stop = ServiceProxy("merlin/stop", Trigger, timeout=GUARD_ANSWERS)
        self._release = ServiceProxy("merlin/release", Trigger, timeout=GUARD_ANSWERS)
        self._changed = threading.Condition()  # guards the fields below
        self._stopped = False
        self._keep_paused = False  # after a release: an operator had paused before the stop
        self._guard = rospy.Subscriber("merlin/guard", GuardStatus, self._guard_changed, tcp_nodelay=True)

    def check(self, goal: str) -> None:
        """Compares a goal with the domain and the objects."""
        try:
            check_goals(parse_goal(goal), self._knowledge)
        except (PDDLSyntaxError, GoalError, ServiceError) as error:
            raise ControlError(str(error)) from error

    def send(self, goal: str, priority: int, by: str) -> str:
        """Sends a goal to the Executor."""
        if not self._client.executor_alive:
            raise ControlError("There is no Executor to send the goal to.")
        request = self._client.send(goal, priority)
        words, number = goal_phrase(goal), str(priority)
        sent = say("{client} sends “{goal}”, priority {number}", client=by, goal=words, number=number)
        self._report(by, sent, goal=goal)
        return request.id

    def cancel(self, request: str, by: str) -> str:
        """Cancels a request of any client."""
        tree = self._state.tree
        requests = [*(tree.get("queue", "waiting") or []), tree.get("now", "executor") or {}]
        known = {each["request"]: each["words"] for each in requests if each.get("request")}
        if request not in known:
            raise ControlError("There is no such request: it has ended, or it never existed.")
        self._cancels.publish(GoalID(id=request))
        self._report_cancel(by, request, known[request])
        return f"The cancel was sent.{self._silent_executor()}"

    def cancel_all(self, by: str) -> str:
        """Cancels all requests."""
        self._cancels.publish(ALL_REQUESTS)
        self._report_cancel(by, "", [])
        return f"The cancel of all requests was sent.{self._silent_executor()}"

    def pause(self, pause: bool, by: str) -> str:
        """Asks the Executor to let no further request begin, or the next one."""
        answer = _ask(self._pause[pause], "The Executor does not pause" if pause else "It stays paused")
        pauses = say("{client} pauses: no further goal begins", client=by)
        self._report(by, pauses if pause else say("{client} resumes: the next goal may begin", client=by))
        return answer

    def stop(self, by: str) -> str:
        """Makes the guard hold the base until its release, and cancels all requests of the Executor.

        The Executor is paused too, or a mission would lose one task after the other to the stop. That may
        take time, or not come true; nothing waits for it.
        """
        listening = self._stops.get_num_connections() > 0
        self._stops.publish(String(by))
        self._cancels.publish(ALL_REQUESTS)
        with self._changed:
            if not self._stopped:
                self._keep_paused = bool(self._state.tree.get("now", "executor", "paused"))
        threading.Thread(target=self._hold_requests, args=(by,), name="hold requests", daemon=True).start()
        self._report(
            by, say("{client} stops and holds: the base stops, all requests are cancelled", client=by)
        )
        if not (listening and self._wait_stopped()):
            otherwise = "The cancel of all requests was sent, but the base is NOT confirmed to be held"
            try:
                _ask(self._stop, otherwise)
            except ControlError as error:
                self._report(by, say("stop by {client} not confirmed: {why}", client=by, why=str(error)))
                raise
        return (
            "Stopped and held, confirmed by the guard, until it is released. All requests were cancelled."
            + self._silent_executor()
        )

    def release(self, by: str) -> str:
        """Releases the base."""
        _ask(self._release, "The base was not released")
        self._report(by, say("{client} releases the base", client=by))
        with self._changed:
            keep, self._keep_paused = self._keep_paused, False
        if keep:
            return "The base may drive again. The Executor stays paused, as it was before."
        try:
            _ask(self._pause[False], "the Executor was not resumed")
        except ControlError as error:
            return f"The base may drive again; {error}"
        return "The base may drive again, and the next goal may begin."

    def plan(self, goal: str, without: Sequence[str], by: str) -> Dict[str, Any]:
        """Plans a goal; nothing is carried out."""
        return self._planning.plan(goal, without, by)

    def change(self, facts: str, by: str) -> str:
        """Changes the knowledge."""
        return self._planning.change(facts, by)

    def hold_before(self, texts: Sequence[str], by: str) -> str:
        """Replaces the breakpoints."""
        return self._breakpoints.hold_before(texts, by)

    def go_on(self, step: bool, by: str) -> str:
        """Continues from a breakpoint."""
        return self._breakpoints.go_on(step, by)

    def leave(self, state: str, outcome: str, within: str, by: str) -> str:
        """Makes a state end with an outcome."""
        return self._breakpoints.leave(state, outcome, within, by)

    def set_autonomy(self, level: str, by: str) -> str:
        """Sets the autonomy level."""
        return self._breakpoints.set_autonomy(level, by)

    def _hold_requests(self, by: str) -> None:
        try:
            _ask(self._pause[True], "the Executor was not paused")
        except ControlError as error:
            self._report(by, say("{client} stops, but {why}", client=by, why=str(error)))

    def _guard_changed(self, status: GuardStatus) -> None:
        with self._changed:
            self._stopped = status.state == GuardStatus.STOPPED
            self._changed.notify_all()

    def _wait_stopped(self) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: self._stopped, GUARD_ANSWERS)

    def _silent_executor(self) -> str:
        silent = self._state.tree.get("now", SILENT)
        return f" The Executor {silent['what']}: it obeys when it is back." if silent else ""

    def _report_cancel(self, by: str, request: str, goals: List[Phrase]) -> None:
        self._report(by, cancel_words(by, request, goals))

    def _report(self, by: str, said: Phrase, **detail: str) -> None:
        self._state.report(sentence("control", said, rospy.get_time(), by=by, **detail))


def _ask(service: Any, otherwise: str) -> str:
    if not service.available():
        raise ControlError(f"{otherwise}: nothing offers {service.name}.")
    try:
        answer = service()
    except ServiceError as error:
        raise ControlError(f"{otherwise}: {error}") from error
    if not answer.success:
        raise ControlError(f"{otherwise}: {answer.message}")
    return str(answer.message)
