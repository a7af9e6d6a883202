# SPDX-License-Identifier: Apache-2.0
"""Control of the robot over ROS: the Executor's public client, its services, and the guards themselves.

A stop needs neither Executor nor planner nor state machine.
"""

import threading
from collections import deque
from typing import Callable, Deque, Dict, Mapping

import rospy
from actionlib_msgs.msg import GoalID
from std_srvs.srv import Trigger

from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.goal_check import GoalError, check_goals
from merlin_monitor.listeners.panel import Request
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.freshness import SILENT
from merlin_monitor.state.history_events import sentence
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.text.phrase import Phrase, say
from merlin_monitor.text.request_words import cancel_words
from merlin_monitor.web.page_control import ControlError, RobotRequests
from merlin_monitor.web.robot_guards import RobotGuards, ask
from merlin_monitor.web.robot_planning import RobotPlanning
from merlin_planning.knowledge_client import knowledge_client
from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal
from merlin_ros.parameters import graph_name
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_ros.work.threads import start_thread

EXECUTOR_ANSWERS = 3.0  # s of wall time
PRESSES = 100  # of the stop's button that are remembered
HELD, NOT_HELD, RELEASED = "held", "NOT confirmed to be held", "may drive again"
ALL_REQUESTS = GoalID()  # a cancel without name and time is for all goals of an action (actionlib)


class RobotControl(RobotRequests):
    """What can be asked of the robot; each method raises ControlError when it cannot be done.

    `by` is the name of the operator, which the history shows. What is returned is a sentence: what was done.

    :param state: takes the events, and knows which requests there are.
    :param offered: gives what panels offer, by its name.
    """

    def __init__(self, state: MonitorModel, offered: Callable[[], Mapping[str, Request]] = dict) -> None:
        self._state = state
        self.offered = offered
        executor = graph_name("~executor", "merlin/execute")
        self._knowledge = knowledge_client(graph_name("~knowledge_base", "rosplan_knowledge_base"))
        self.planning: RobotPlanning = RobotPlanning(state, self._knowledge, self._report)
        """Plans, facts, breakpoints, outcomes of states."""
        self._client = MerlinExecutorClient(executor, knowledge_base=None)
        self._cancels = rospy.Publisher(f"{executor}/cancel", GoalID, queue_size=10)
        self._pause = {
            pause: ServiceProxy(f"merlin/{name}", Trigger, timeout=EXECUTOR_ANSWERS)
            for pause, name in ((True, "pause"), (False, "resume"))
        }
        self._mission = ServiceProxy("merlin/mission/resume", Trigger, timeout=EXECUTOR_ANSWERS)
        self._guards = RobotGuards()
        state.on_guard = self._guards.follow
        self._lock = threading.Lock()  # guards the fields below
        self._presses: Deque[str] = deque(maxlen=PRESSES)
        self._paused_too = False  # by a stop that a guard did not confirm

    def check(self, goal: str) -> None:
        """Compares a goal in PDDL with the domain and the objects."""
        try:
            check_goals(parse_goal(goal), self._knowledge)
        except (PDDLSyntaxError, GoalError, ServiceError) as error:
            raise ControlError(str(error)) from error

    def send(self, goal: str, priority: int, by: str) -> str:
        """Sends a goal to the Executor; returns the id of the request."""
        if not self._client.executor_alive:
            raise ControlError("There is no Executor to send the goal to.")
        request = self._client.send(goal, priority, by=by)
        words, number = self._state.wording.goal(goal), str(priority)
        sent = say("{client} sends “{goal}”, priority {number}", client=by, goal=words, number=number)
        self._report(by, sent, goal=goal)
        return request.id

    def cancel(self, request: str, by: str) -> str:
        """Cancels a request of any client."""
        tree = self._state.tree
        executor = tree.get("now", "executor") or {}
        requests = [*(tree.get("queue", "waiting") or []), executor, *executor.get("together", ())]
        known = {each["request"]: each["words"] for each in requests if each.get("request")}
        if request not in known:
            raise ControlError("There is no such request: it has ended, or it never existed.")
        self._cancels.publish(GoalID(id=request))
        self._report(by, cancel_words(by, request, known[request]))
        return f"The cancel was sent.{self._silent_executor()}"

    def cancel_all(self, by: str) -> str:
        """Cancels all requests."""
        self._cancels.publish(ALL_REQUESTS)
        self._report(by, cancel_words(by, "", []))
        return f"The cancel of all requests was sent.{self._silent_executor()}"

    def pause(self, pause: bool, by: str) -> str:
        """Asks the Executor to let no further request begin, or the next one."""
        answer = ask(self._pause[pause], "The Executor does not pause" if pause else "It stays paused")
        if not pause and self._state.tree.get("now", "mission", "state") == "paused":
            answer = ask(self._mission, "The mission stays paused")
        pauses = say("{client} pauses: no further goal begins", client=by)
        self._report(by, pauses if pause else say("{client} resumes: the next goal may begin", client=by))
        return answer

    def stop(self, by: str, press: str) -> str:
        """Makes all guards hold their bases until the release, and cancels all requests of the Executor.

        Where a guard does not confirm it, the Executor is paused, too, or a mission would go on. That may
        take time, or not come true; nothing waits for it.

        :param press: names the press of the button, which may arrive several times; empty: it comes once.
        """
        with self._lock:
            repeated = press in self._presses
            if press and not repeated:
                self._presses.append(press)
        if repeated and not self._guards.stop_stands:
            return "It was stopped and held, and has been released since."
        self._guards.stop(by)
        if not repeated:
            self._cancels.publish(ALL_REQUESTS)
            self._report(
                by, say("{client} stops and holds: the base stops, all requests are cancelled", client=by)
            )
        held = self._guards.wait_held()
        words = _each({robot: HELD if done else NOT_HELD for robot, done in held.items()})
        if not all(held.values()):
            if not repeated:
                self._report(by, say("stop by {client} not confirmed: {why}", client=by, why=words))
                start_thread("pause too", self._pause_too, by)
            raise ControlError(f"{words}. The cancel of all requests was sent.{self._silent_executor()}")
        return (
            f"Stopped, confirmed by the guard, until the release: {words}. All requests were cancelled."
            + self._silent_executor()
        )

    def release(self, by: str, seen: str) -> str:
        """Releases the bases; one that another operator holds only when this one has seen it.

        :param seen: of a :class:`ControlError`, what the operator wants to release nevertheless.
        """
        others = self._guards.holders_but(by)
        if others and others != seen:
            raise ControlError(f"Not released yet: {others}.", others)
        trouble = self._guards.release()
        words = _each({robot: why or RELEASED for robot, why in trouble.items()})
        if any(trouble.values()):
            raise ControlError(words)
        self._report(by, say("{client} releases the base", client=by))
        with self._lock:
            resume, self._paused_too = self._paused_too, False
        if resume:
            try:
                ask(self._pause[False], "the Executor was not resumed")
            except ControlError as error:
                return f"{words}; {error}"
        elif self._state.tree.get("now", "executor", "paused"):
            return f"{words}. The Executor stays paused, as it was before."
        return f"{words}, and the next goal may begin."

    def acknowledge(self, problem: str, by: str) -> str:
        """Notes that an operator knows about a problem, by its key."""
        known = self._state.tree.get("now", "problems") or []
        if problem not in [each["key"] for each in known]:
            raise ControlError("There is no such problem any more.")
        self._state.inbox.put(self._state.acknowledge, problem, by, RosSystem().time())
        return "Noted; it stays so until the problem has ended."

    def _pause_too(self, by: str) -> None:
        if self._state.tree.get("now", "executor", "paused"):
            return  # by an operator, who resumes it
        try:
            ask(self._pause[True], "the Executor was not paused")
            with self._lock:
                self._paused_too = True
        except ControlError as error:
            self._report(by, say("{client} stops, but {why}", client=by, why=str(error)))

    def _silent_executor(self) -> str:
        silent = self._state.tree.get("now", SILENT)
        return f" The Executor {silent['what']}: it obeys when it is back." if silent else ""

    def _report(self, by: str, said: Phrase, **detail: str) -> None:
        self._state.report(sentence("control", said, RosSystem().time(), by=by, **detail))


def _each(said: Dict[str, str]) -> str:
    return ", ".join(f"{robot or 'the base'} {words}" for robot, words in said.items())
