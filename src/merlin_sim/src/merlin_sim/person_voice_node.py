"""The node ``person_voice``: somebody who hears the robot speak and answers with a voice, not with text."""

import math
import threading
from typing import List, Optional

import numpy as np
import rospy
from audio_common_msgs.msg import AudioData
from nav_msgs.msg import Odometry
from std_msgs.msg import Bool

from merlin_sim.noise import draw
from merlin_sim.parameters import ParameterError, number
from merlin_sim.ros_clock import RosClock
from merlin_sim.speech_synthesizer import RATE, SoundError, SpeechSynthesizer

CHUNK = 0.2  # s of sound per message
TRAIL = 0.8  # s of quiet after an answer
HEARD = 200.0  # RMS, of 32767, from which the robot's voice is heard


class PersonVoice:
    """Answers each time the robot has finished speaking near enough.

    :raises ParameterError: a parameter cannot be used.
    """

    def __init__(self) -> None:
        self._answers = _answers()
        self._position = _position()
        self._hearing = number("~hearing", 4.0, 0.1)
        self._delay = number("~delay", 0.8, 0.0)
        self._noise = number("~noise", 30.0, 0.0)
        self._seed = round(number("~seed", 1, 0))
        self._synthesizer = SpeechSynthesizer(str(rospy.get_param("~voice", "en-us")))
        self._clock = RosClock()
        self._changed = threading.Condition()  # guards the fields below
        self._heard = False
        self._asked = False
        self._robot: Optional[Odometry] = None
        self._microphone = rospy.Publisher("audio/microphone", AudioData, queue_size=50)
        self._subscribers = [
            rospy.Subscriber("audio/speaker", AudioData, self._hear, tcp_nodelay=True, queue_size=50),
            rospy.Subscriber("sound_play/is_speaking", Bool, self._notice, tcp_nodelay=True),
        ]
        if self._position is not None:
            self._subscribers.append(
                rospy.Subscriber("ground_truth", Odometry, self._see, tcp_nodelay=True, queue_size=1)
            )

    def run(self) -> None:
        """Answers until ROS shuts down."""
        never = threading.Event()
        while not rospy.is_shutdown():
            with self._changed:
                # The slice is for shutdown, which notifies nobody.
                if not self._changed.wait_for(lambda: self._asked, timeout=1.0):
                    continue
                self._asked = False
            if self._clock.wait(self._delay, never):
                self._answer(never)

    def _answer(self, never: threading.Event) -> None:
        # By the second, not by count: an answer does not depend on what was asked before.
        moment = int(rospy.get_time())
        random = draw(self._seed, rospy.get_name(), moment)
        text = self._answers[int(random.integers(len(self._answers)))]
        try:
            samples = self._synthesizer.say(text).samples
        except SoundError as error:
            rospy.logerr(f"person_voice: {error}")
            return
        rospy.loginfo(f'the person says: "{text}"')
        samples = np.concatenate([samples, np.zeros(round(TRAIL * RATE), dtype=np.int16)])
        noisy = samples + self._noise * random.standard_normal(len(samples))
        sound = np.clip(noisy, -32768, 32767).astype("<i2")
        size = round(CHUNK * RATE)
        for first in range(0, len(sound), size):
            part = sound[first : first + size]
            self._microphone.publish(AudioData(data=part.tobytes()))
            if not self._clock.wait(len(part) / RATE, never):
                return

    def _hear(self, message: AudioData) -> None:
        samples = np.frombuffer(message.data, dtype="<i2").astype(float)
        with self._changed:
            if len(samples) and math.sqrt(float(np.mean(samples**2))) > HEARD and self._near():
                self._heard = True

    def _notice(self, message: Bool) -> None:
        with self._changed:
            if not message.data and self._heard:
                self._heard, self._asked = False, True
                self._changed.notify_all()

    def _see(self, message: Odometry) -> None:
        with self._changed:
            self._robot = message

    def _near(self) -> bool:
        if self._position is None:
            return True
        if self._robot is None:
            return False
        where = self._robot.pose.pose.position
        return math.dist((where.x, where.y), self._position) <= self._hearing


def _answers() -> List[str]:
    answers = rospy.get_param("~answers", ["no thank you"])
    if not isinstance(answers, list) or not answers or not all(isinstance(a, str) for a in answers):
        raise ParameterError(f"parameter ~answers is {answers!r}, not a list of sentences")
    return answers


def _position() -> Optional[List[float]]:
    position = rospy.get_param("~position", None)
    if position is None:
        return None
    if not isinstance(position, list) or len(position) != 2:
        raise ParameterError(f"parameter ~position is {position!r}, not [x, y]")
    return [float(value) for value in position]


def main() -> int:
    """The executable ``person_voice``; returns its exit code."""
    rospy.init_node("person_voice")
    try:
        PersonVoice().run()
    except ParameterError as error:
        rospy.logfatal(f"person_voice: {error}")
        return 1
    return 0
