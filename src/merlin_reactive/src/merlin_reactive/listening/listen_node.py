# SPDX-License-Identifier: Apache-2.0
"""The node ``listen``: understands one utterance at a time."""

import threading
from collections import deque
from typing import Deque, Optional

import numpy as np
import rospy
from audio_common_msgs.msg import AudioData
from merlin_msgs.msg import ListenAction, ListenFeedback, ListenResult

from merlin_reactive.listening.speech_recognizer import (
    MISSING,
    THRESHOLD,
    GrammarError,
    UtteranceDetector,
    available,
)
from merlin_reactive.listening.speech_recognizer_process import SpeechRecognizerLost, SpeechRecognizerProcess
from merlin_reactive.ros_clock import RosClock
from merlin_reactive.ros_messages import samples_of
from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_ros.deadline import Deadline
from merlin_ros.health import ERROR, OK, WARN, Health, HealthReporter
from merlin_ros.node import run_node
from merlin_ros.parameters import number
from merlin_ros.ros_alarm import RosStopwatch

BROKEN_OFF = 1.0  # s without sound, both of ROS time and of running time, after which the speaker has stopped


class ListenNode:
    """Serves the action ``listen``.

    :raises ParameterError: a parameter cannot be used.
    :raises SpeechRecognizerLost: the recogniser is not installed.
    """

    def __init__(self) -> None:
        if not available():
            raise SpeechRecognizerLost(f"there is {MISSING}")
        self._recognizer = SpeechRecognizerProcess(number("~threshold", THRESHOLD, -1.0))
        self._loud = number("~loudness", 400.0, 1.0)
        self._timeout = number("~timeout", 8.0, 0.1)
        self._broken_off = number("~broken_off", BROKEN_OFF, 0.1)
        self._clock = RosClock()
        self._news = threading.Event()  # sound came, or a cancel was requested
        self._sound: Deque[np.ndarray] = deque(maxlen=1000)
        self._listening = False
        self._spoke = False  # a person, since the goal began
        self._heard = self._understood = 0  # utterances
        self._trouble = ""  # what became of the recogniser in the last goal
        self._server = SerialActionServer("listen", ListenAction, self._execute, self._cancel)
        self._subscriber = rospy.Subscriber(
            "audio/microphone", AudioData, self._receive, tcp_nodelay=True, queue_size=50
        )
        rospy.on_shutdown(self._server.shutdown)
        rospy.on_shutdown(self._recognizer.close)
        self._server.start()

    def health(self) -> Health:
        """Whether there is a microphone to hear with, and a recogniser that works."""
        values = {"utterances": self._heard, "understood": self._understood}
        if self._trouble:
            return Health(ERROR, self._trouble, values)
        if not self._subscriber.get_num_connections():
            return Health(WARN, f"no publisher on {self._subscriber.name}: there is nothing to hear", values)
        return Health(OK, "listening" if self._listening else "ready", values)

    def _receive(self, message: AudioData) -> None:
        if self._listening:
            self._sound.append(samples_of(message))
            self._news.set()
            self._clock.wake()

    def _cancel(self, goal: ServerGoal) -> None:
        # At once: decoding takes a second, and its result is no longer wanted.
        goal.cancelled(ListenResult(heard=self._spoke), "cancelled")
        self._news.set()
        self._clock.wake()

    def _execute(self, goal: ServerGoal) -> None:
        timeout = goal.goal.timeout.to_sec()
        if timeout < 0.0:
            goal.abort(ListenResult(), f"the time-out {timeout:g} s is negative; 0: {self._timeout:g} s")
            return
        try:
            self._sound.clear()
            self._listening = True
            goal.feedback(ListenFeedback(speech=False))
            self._recognizer.use(goal.goal.grammar)
            self._listen(goal)
            self._trouble = ""
        except GrammarError as error:
            goal.abort(ListenResult(), str(error))
        except SpeechRecognizerLost as error:
            self._trouble = str(error)
            goal.abort(ListenResult(heard=self._spoke), str(error))
        finally:
            self._listening = self._spoke = False

    def _listen(self, goal: ServerGoal) -> None:
        timeout = goal.goal.timeout.to_sec() or self._timeout
        passed = RosStopwatch()
        detector = UtteranceDetector(loud=self._loud)
        speaking = False
        utterance: Optional[np.ndarray] = None
        while utterance is None:
            # A person that has begun to speak may finish; and in fast simulated time a busy machine delivers
            # the sound late.
            patience = Deadline(self._broken_off if detector.speaking else 0.0)
            left = self._broken_off if detector.speaking else timeout - passed.look()
            if left > 0.0 and self._clock.wait(left, self._news):
                left = 0.0
                patience.wait_event(self._news)
            self._news.clear()
            if goal.cancel_requested:
                return
            while self._sound and utterance is None:
                left = 1.0
                utterance = detector.feed(self._sound.popleft())
            self._spoke = self._spoke or detector.speaking or utterance is not None
            if detector.speaking != speaking:
                speaking = detector.speaking
                goal.feedback(ListenFeedback(speech=speaking))
            if left <= 0.0 and utterance is None:
                utterance = detector.finish()
                if utterance is None:
                    goal.succeed(ListenResult(), f"no speech within {timeout:.1f} s")
                    return
        said = self._recognizer.understand(utterance)
        self._heard += 1
        self._understood += bool(said.text)
        text = f"understood: {said.text}" if said.text else "speech that was not understood"
        goal.succeed(ListenResult(text=said.text, confidence=said.confidence, heard=True), text)


def main() -> int:
    """The executable ``listen``; returns its exit code."""
    return run_node(
        "listen", lambda: HealthReporter({"listen": ListenNode().health}).start(), SpeechRecognizerLost
    )
