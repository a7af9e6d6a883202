# SPDX-License-Identifier: Apache-2.0
"""What the robot does, says, hears and sees, one line each, for a mission's screen. It changes nothing."""

import functools
from typing import Callable, List, Sequence

import rospy
from merlin_msgs.msg import ExecutorStatus, ListenActionResult, RecognizeActionResult
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from sound_play.msg import SoundRequestActionGoal

from merlin_executor.core.robot_lines import Deed, RobotLines
from merlin_planning.dispatch_progress import CANCEL_ACTION
from merlin_planning.knowledge_text import step_text
from merlin_sm.states.recognition import recognized

DISPATCHER = "rosplan_plan_dispatcher"


class RobotLog:
    """Listens to the planning system and to the robots' speech.

    :param log: takes a line of what happens.
    :param on_failure: called with an action as PDDL and the reason.
    :param robots: the namespaces of several robots; empty: one robot without a namespace.
    """

    def __init__(
        self,
        log: Callable[[str], None],
        on_failure: Callable[[str, str], None] = lambda action, reason: None,
        robots: Sequence[str] = ("",),
    ) -> None:
        self._lines = RobotLines(log, on_failure)
        listen = functools.partial(rospy.Subscriber, queue_size=100, tcp_nodelay=True)
        listen("merlin/status", ExecutorStatus, self._pursued)
        listen(f"{DISPATCHER}/action_dispatch", ActionDispatch, self._dispatched)
        listen(f"{DISPATCHER}/action_feedback", ActionFeedback, self._answered)
        for robot in robots:
            scope = f"{robot}/" if robot else ""
            listen(f"{scope}sound_play/goal", SoundRequestActionGoal, self._spoke, robot)
            listen(f"{scope}listen/result", ListenActionResult, self._heard, robot)
            listen(f"{scope}recognize/result", RecognizeActionResult, self._saw, robot)

    @property
    def deeds(self) -> List[Deed]:
        """The actions that have ended, in their order."""
        return self._lines.deeds

    def _pursued(self, status: ExecutorStatus) -> None:
        self._lines.pursue(status.request, status.goals, status.priority, status.reason)

    def _dispatched(self, action: ActionDispatch) -> None:
        if action.name.lower() != CANCEL_ACTION:
            key = action.plan_id, action.action_id
            self._lines.begin(key, step_text(action), rospy.get_time())

    def _answered(self, feedback: ActionFeedback) -> None:
        done = feedback.status == ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE
        if done or feedback.status == ActionFeedback.ACTION_FAILED:
            reason = next((entry.value for entry in feedback.information if entry.key == "reason"), "")
            key = feedback.plan_id, feedback.action_id
            self._lines.end(key, rospy.get_time(), None if done else reason)

    def _spoke(self, goal: SoundRequestActionGoal, robot: str) -> None:
        self._lines.speak(goal.goal.sound_request.arg, robot)

    def _heard(self, result: ListenActionResult, robot: str) -> None:
        self._lines.hear(result.result.text, result.result.heard, robot)

    def _saw(self, result: RecognizeActionResult, robot: str) -> None:
        found = recognized(result.result)
        self._lines.see([(item.name, item.position[0], item.position[1]) for item in found], robot)
