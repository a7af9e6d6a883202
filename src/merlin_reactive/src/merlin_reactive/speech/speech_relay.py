# SPDX-License-Identifier: Apache-2.0
"""The node ``speech_relay``: the action ``sound_play`` over the robot's own speech, an action or a topic."""

import functools
import threading
from typing import Any, Optional, Tuple

import genpy
import rospy
from actionlib_msgs.msg import GoalStatus
from roslib.message import get_message_class
from sound_play.msg import SoundRequest, SoundRequestAction, SoundRequestResult

from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_ros.node import run_node
from merlin_ros.parameters import ParameterError, graph_name, number
from merlin_ros.publishing import publish

SERVER_WAIT = 5.0  # s of running time
CANCEL_LIMIT = 2.0  # s of running time, as of the states
RESULT = SoundRequestResult()


class Form:
    """How a text becomes a message, or a goal of an action.

    :raises ParameterError: the type is not there, or its fields are others.
    """

    def __init__(self, kind: str, field: str, fields: Any) -> None:
        found = get_message_class(kind) if kind.count("/") == 1 else None
        if found is None:
            raise ParameterError(f"~type is '{kind}', which no sourced workspace has; build its package")
        self.type: type = found
        self.acts = kind.endswith("Action")
        self._field, self._fields = field, fields
        self.fill("")

    def fill(self, text: str) -> Any:
        """What says a text."""
        message = self.type().action_goal.goal if self.acts else self.type()
        try:
            for path, value in {**self._fields, self._field: text}.items():
                *parents, last = str(path).split(".")
                setattr(functools.reduce(getattr, parents, message), last, value)
            message._check_types()
        except (AttributeError, TypeError, genpy.SerializationError) as error:
            raise ParameterError(f"~field or ~fields do not fit {message._type}: {error}") from error
        return message


class SpeechRelay:
    """Serves ``sound_play``; sounds and files are refused."""

    def __init__(self) -> None:
        kind, field = rospy.get_param("~type", "std_msgs/String"), rospy.get_param("~field", "data")
        self._form = Form(str(kind), str(field), rospy.get_param("~fields", {}))
        self._speed = number("~words_per_minute", 140, 40)
        self._name = rospy.resolve_name(graph_name("~to", "speech"))
        # Who asked, what speaks, and what ends the wait for it; replaced as a whole, by the worker only.
        self._speaking: Optional[Tuple[ServerGoal, ClientGoal, threading.Event]] = None
        if self._form.acts:
            self._client = ActionClient(self._name, self._form.type)
        else:
            self._publisher = rospy.Publisher(self._name, self._form.type, queue_size=5)
        self._server = SerialActionServer("sound_play", SoundRequestAction, self._execute, self._cancel)
        rospy.on_shutdown(self._server.shutdown)
        self._server.start()

    def _execute(self, goal: ServerGoal) -> None:
        request = goal.goal.sound_request
        if request.sound != SoundRequest.SAY or request.command != SoundRequest.PLAY_ONCE:
            goal.abort(RESULT, f"{self._name} says texts once, and makes no sounds")
        elif self._form.acts:
            self._ask(goal, self._form.fill(request.arg))
        elif not self._publisher.get_num_connections():
            goal.abort(RESULT, f"nothing listens to {self._name}; correct ~to, or start it")
        else:
            publish(self._publisher, self._form.fill(request.arg))
            if goal.cancel_event.wait(len(request.arg.split()) * 60.0 / self._speed):
                goal.cancelled(RESULT, f"{self._name} cannot be stopped: it says the text to its end")
            else:
                goal.succeed(RESULT, "said, by the number of its words")

    def _ask(self, goal: ServerGoal, message: Any) -> None:
        if not self._client.wait_for_server(SERVER_WAIT, lambda: goal.cancel_requested):
            end = goal.cancelled if goal.cancel_requested else goal.abort
            end(RESULT, self._client.absence(SERVER_WAIT))
            return
        ended = threading.Event()
        sent = self._client.send(message, on_done=lambda _: ended.set(), owner=goal.id)
        self._speaking = (goal, sent, ended)
        if goal.cancel_requested:
            self._cancel(goal)
        ended.wait()
        self._speaking = None
        if goal.cancel_requested and not sent.wait(CANCEL_LIMIT):
            self._client.give_up(sent, "it did not stop in time")
            goal.abort(RESULT, f"{self._name} did not stop within {CANCEL_LIMIT:g} s")
        elif sent.status == GoalStatus.SUCCEEDED:
            goal.succeed(RESULT, "said")
        elif goal.cancel_requested:
            goal.cancelled(RESULT, "cut off")
        else:
            goal.abort(RESULT, f"{self._name} did not say it: {sent.text or 'it gave no reason'}")

    def _cancel(self, goal: ServerGoal) -> None:
        speaking = self._speaking
        if speaking is not None and speaking[0] is goal:
            speaking[1].cancel()
            speaking[2].set()


def main() -> int:
    """The executable ``speech_relay``; returns its exit code."""
    return run_node("speech_relay", _start)


def _start() -> None:
    SpeechRelay()
