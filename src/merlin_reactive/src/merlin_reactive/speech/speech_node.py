# SPDX-License-Identifier: Apache-2.0
"""The node ``soundplay_node``: speech and sounds through the interface of sound_play."""

import math
import threading
from collections import deque
from typing import Callable, Deque, Optional, Tuple

import rospkg
import rospy
from audio_common_msgs.msg import AudioData, AudioInfo
from sound_play.msg import SoundRequest, SoundRequestAction, SoundRequestFeedback, SoundRequestResult
from std_msgs.msg import Bool

from merlin_reactive.ros_clock import RosClock
from merlin_reactive.speech.sound_card import SoundCard
from merlin_reactive.speech.speech_synthesizer import (
    RATE,
    Sound,
    SoundError,
    SoundStopped,
    SpeechSynthesizer,
    StopSound,
    beep,
    read_wave,
)
from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_ros.health import OK, WARN, Health, HealthReporter
from merlin_ros.node import run_node
from merlin_ros.parameters import ParameterError, number
from merlin_ros.publishing import publish
from merlin_ros.ros_alarm import RosStopwatch
from merlin_ros.work.threads import start_thread

CHUNK = 0.2  # s of sound per message and per feedback


class Speaker:
    """Plays one sound after the other, in ROS time; a sound that waits for its turn can be stopped too."""

    def __init__(self, clock: RosClock, card: SoundCard) -> None:
        self._clock = clock
        self._card = card
        self._turn = threading.Condition()  # guards _busy
        self._busy = False
        self._audio = rospy.Publisher("audio/speaker", AudioData, queue_size=20)
        self._info = rospy.Publisher("audio/speaker_info", AudioInfo, queue_size=1, latch=True)
        self._speaking = rospy.Publisher("sound_play/is_speaking", Bool, queue_size=5, latch=True)
        self._info.publish(
            AudioInfo(
                channels=1, sample_rate=RATE, sample_format="S16LE", bitrate=16 * RATE, coding_format="WAVE"
            )
        )
        self._speaking.publish(Bool(False))

    def play(self, sound: Sound, stop: threading.Event, heard: Callable[[float], None]) -> float:
        """Plays a sound to its end or until `stop` is set; returns how much was played, s.

        :param heard: called with the time played so far, s, every CHUNK.
        """
        with self._turn:
            self._turn.wait_for(lambda: not self._busy or stop.is_set())
            if stop.is_set():
                return 0.0
            self._busy = True
        try:
            return self._play(sound, stop, heard)
        finally:
            with self._turn:
                self._busy = False
                self._turn.notify_all()

    def wake(self) -> None:
        """Wakes the goals that play or wait so that they re-check their stop events."""
        self._clock.wake()
        with self._turn:
            self._turn.notify_all()

    def _play(self, sound: Sound, stop: threading.Event, heard: Callable[[float], None]) -> float:
        publish(self._speaking, Bool(True))
        self._card.play(sound)
        played = 0.0
        passed = RosStopwatch()
        try:
            size = round(CHUNK * RATE)
            for first in range(0, len(sound.samples), size):
                part = sound.samples[first : first + size]
                heard(played)
                # Published when it begins: a listener that measures loudness hears it as it is said.
                publish(self._audio, AudioData(data=part.astype("<i2").tobytes()))
                # Until the part's own end on the clock: what one wait is late must not add up.
                left = played + len(part) / RATE - passed.look()
                if stop.is_set() or not self._clock.wait(max(left, 0.0), stop):
                    break
                played += len(part) / RATE
        finally:
            self._card.stop()
            publish(self._speaking, Bool(False))
        return played


class SpeechNode:
    """Serves the action ``sound_play`` and the topic ``robotsound``.

    :raises ParameterError: a parameter cannot be used.
    """

    def __init__(self) -> None:
        self._synthesizer = SpeechSynthesizer(
            voice=str(rospy.get_param("~default_voice", "en-us")),
            speed=round(number("~words_per_minute", 160, 40)),
        )
        phrases = rospy.get_param("~phrases", [])
        self._phrases = [phrases] if isinstance(phrases, str) else phrases
        if not isinstance(self._phrases, list):
            raise ParameterError(f"parameter ~phrases is {phrases!r}, not a list of sentences")
        self._clock = RosClock()
        self._card = SoundCard(str(rospy.get_param("~device", "")))
        self._trouble = ""  # why the last sound could not be made
        self._speaker = Speaker(self._clock, self._card)
        self._changed = threading.Condition()  # guards the requests of the topic
        self._requests: Deque[SoundRequest] = deque()
        self._playing: Optional[Tuple[SoundRequest, StopSound]] = None
        self._making: Optional[Tuple[ServerGoal, StopSound]] = None  # replaced as a whole, by the worker only
        self._server = SerialActionServer("sound_play", SoundRequestAction, self._execute, self._cancel)
        start_thread("robotsound", self._work)
        self._subscriber = rospy.Subscriber(
            "robotsound", SoundRequest, self._receive, tcp_nodelay=True, queue_size=50
        )
        rospy.on_shutdown(self._server.shutdown)
        rospy.on_shutdown(self._silence)
        self._server.start()
        start_thread("speech phrases", self._rehearse)
        rospy.loginfo(
            "speech: " + ("plays on the sound card" if self._card.present else "no sound card, silent")
        )

    def health(self) -> Health:
        """Whether the last sound could be made."""
        if self._trouble:
            return Health(WARN, f"the last sound could not be made: {self._trouble}")
        return Health(OK, "plays on the sound card" if self._card.present else "no sound card, silent")

    def _rehearse(self) -> None:
        """Synthesises what will be said often, so that the first time is as fast as the others."""
        for phrase in self._phrases:
            try:
                self._synthesizer.say(str(phrase))
            except SoundError as error:
                rospy.logwarn(f"speech: parameter ~phrases: {error}")

    def _execute(self, goal: ServerGoal) -> None:
        request = goal.goal.sound_request
        self._silence()
        if request.command == SoundRequest.PLAY_STOP:
            goal.succeed(SoundRequestResult(playing=False), "everything was stopped")
            return

        def heard(time: float) -> None:
            goal.feedback(SoundRequestFeedback(playing=True, stamp=rospy.Time.from_sec(time)))

        played = 0.0
        stop = StopSound()
        self._making = (goal, stop)
        if goal.cancel_requested:
            stop.set()
        try:
            sound = self._sound(request, stop)
            while True:
                played += self._speaker.play(sound, goal.cancel_event, heard)
                if goal.cancel_requested or request.command != SoundRequest.PLAY_START:
                    break
        except SoundStopped:
            pass  # by the cancel, which is answered below
        except SoundError as error:
            goal.abort(_result(played), str(error))
            return
        if goal.cancel_requested:
            goal.cancelled(_result(played), f"cut off after {played:.1f} s")
        else:
            goal.succeed(_result(played), "said")

    def _cancel(self, goal: ServerGoal) -> None:
        making = self._making
        if making is not None and making[0] is goal:
            making[1].set()
        self._speaker.wake()

    def _receive(self, request: SoundRequest) -> None:
        if request.command == SoundRequest.PLAY_STOP:
            self._silence(None if request.sound == SoundRequest.ALL else request)
            return
        with self._changed:
            self._requests.append(request)
            self._changed.notify_all()

    def _silence(self, only: Optional[SoundRequest] = None) -> None:
        """Stops the sounds of the topic, or those like one of them."""
        with self._changed:
            self._requests = deque(
                request for request in self._requests if only is not None and not _same(request, only)
            )
            if self._playing is not None and (only is None or _same(self._playing[0], only)):
                self._playing[1].set()
        self._speaker.wake()

    def _work(self) -> None:
        while not rospy.is_shutdown():
            with self._changed:
                self._playing = None
                while not self._requests:
                    self._changed.wait()
                request, stop = self._requests.popleft(), StopSound()
                self._playing = (request, stop)
            try:
                sound = self._sound(request, stop)
                self._speaker.play(sound, stop, lambda _: None)
                while request.command == SoundRequest.PLAY_START and not stop.is_set():
                    self._speaker.play(sound, stop, lambda _: None)
            except SoundStopped:
                pass
            except SoundError as error:
                rospy.logerr(f"robotsound: {error}")

    def _sound(self, request: SoundRequest, stop: StopSound) -> Sound:
        try:
            sound = self._made(request, stop)
        except SoundStopped:
            raise
        except SoundError as error:
            self._trouble = str(error)
            raise
        self._trouble = ""
        return sound

    def _made(self, request: SoundRequest, stop: StopSound) -> Sound:
        if request.command not in (SoundRequest.PLAY_ONCE, SoundRequest.PLAY_START):
            raise SoundError(f"unknown command {request.command}")
        if not math.isfinite(request.volume):
            raise SoundError(f"the volume {request.volume} is not a number from 0 to 1")
        if request.sound == SoundRequest.SAY:
            sound = self._synthesizer.say(request.arg, request.arg2, stop)
        elif request.sound == SoundRequest.PLAY_FILE:
            sound = read_wave(_path(request.arg, request.arg2))
        else:
            sound = beep(request.sound)
        return sound.scaled(request.volume)


def _result(played: float) -> SoundRequestResult:
    return SoundRequestResult(playing=False, stamp=rospy.Time.from_sec(played))


def _same(one: SoundRequest, other: SoundRequest) -> bool:
    return (one.sound, one.arg, one.arg2) == (other.sound, other.arg, other.arg2)


def _path(path: str, package: str) -> str:
    if not package:
        return path
    try:
        return f"{rospkg.RosPack().get_path(package)}/{path}"
    except rospkg.ResourceNotFound as error:
        raise SoundError(f"there is no package {package}") from error


def main() -> int:
    """The executable ``speech``; returns its exit code."""
    return run_node("soundplay_node", lambda: HealthReporter({"speech": SpeechNode().health}).start())
