# SPDX-License-Identifier: Apache-2.0
"""The node ``person_voice``: persons that hear the robot speak and answer with a voice, not with text."""

import math
import threading
from collections import deque
from typing import Callable, Deque, Dict, Optional, Tuple

import numpy as np
import rospy
from audio_common_msgs.msg import AudioData
from merlin_msgs.msg import PersonHeard, SimPeople, SimPerson
from merlin_msgs.srv import SetAnswers, SetAnswersRequest, SetAnswersResponse
from nav_msgs.msg import Odometry
from sound_play.msg import SoundRequest, SoundRequestActionGoal
from std_msgs.msg import Bool

from merlin_reactive.pose import Point
from merlin_reactive.ros_clock import RosClock
from merlin_reactive.ros_messages import samples_of
from merlin_reactive.seeded_random import draw
from merlin_reactive.speech.speech_synthesizer import RATE, SoundError, SpeechSynthesizer
from merlin_ros.health import ERROR, OK, WARN, Health, HealthReporter
from merlin_ros.node import run_node
from merlin_ros.parameters import number
from merlin_sim.people.listener import Answers, HearingPerson, nearest, read_listeners
from merlin_sim.people.overheard import Overheard, Sentence

CHUNK = 0.2  # s of sound per message
TRAIL = 0.8  # s of quiet after an answer
HEARD = 200.0  # RMS, of 32767, from which the robot's voice is heard


class PersonVoice:
    """Plays the nearest person's answer each time the robot has spoken near enough.

    :raises ParameterError: a parameter cannot be used.
    """

    def __init__(self) -> None:
        self._listeners: Dict[str, HearingPerson] = {listener.name: listener for listener in read_listeners()}
        self._delay = number("~delay", 0.8, 0.0)
        self._noise = number("~noise", 30.0, 0.0)
        self._seed = round(number("~seed", 1, 0))
        self._synthesizer = SpeechSynthesizer()
        self._clock = RosClock()
        self._stopped = threading.Event()
        self._changed = threading.Condition()  # guards the fields below and the listeners' answers
        self._overheard: Overheard[HearingPerson] = Overheard()
        self._asked: Deque[Sentence[HearingPerson]] = deque()  # what is still to be answered
        self._robot: Optional[Point] = None
        self._heading: Optional[float] = None  # rad
        self._people: Optional[Dict[str, Point]] = None  # where the present persons are, by name
        self._known: Tuple[str, ...] = ()  # to the world, there or not
        self._trouble = ""
        self._given = 0  # answers
        self._microphone = rospy.Publisher("audio/microphone", AudioData, queue_size=50)
        self._heard = rospy.Publisher("~heard", PersonHeard, queue_size=10)
        self._service = rospy.Service("~set_answers", SetAnswers, self._set_answers)
        self._subscribers = [
            rospy.Subscriber("audio/speaker", AudioData, self._hear, tcp_nodelay=True, queue_size=50),
            rospy.Subscriber("sound_play/is_speaking", Bool, self._notice, tcp_nodelay=True),
            rospy.Subscriber(
                "sound_play/goal", SoundRequestActionGoal, lambda m: self._read(m.goal.sound_request)
            ),
            rospy.Subscriber("robotsound", SoundRequest, self._read),
        ]
        if any(not listener.anywhere for listener in self._listeners.values()):
            self._subscribers += [
                rospy.Subscriber("ground_truth", Odometry, self._see, tcp_nodelay=True, queue_size=1),
                rospy.Subscriber("/merlin_sim/people", SimPeople, self._see_people, tcp_nodelay=True),
            ]

    def run(self) -> None:
        """Answers until ROS shuts down."""
        rospy.on_shutdown(self._stop)
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._asked or self._stopped.is_set())
                if self._stopped.is_set():
                    return
                sentence = self._asked.popleft()
            if self._clock.wait(self._delay, self._stopped):
                assert sentence.hearer is not None
                with self._changed:
                    question = sentence.text if sentence.text is not None else self._overheard.last_text
                self._answer(sentence.hearer, question)

    def _stop(self) -> None:
        self._stopped.set()
        self._clock.wake()
        with self._changed:
            self._changed.notify_all()

    def health(self) -> Health:
        """Whether the persons that should answer are present and can speak."""
        with self._changed:
            values = {"people": ", ".join(self._listeners), "answers given": self._given}
            missing = [
                name
                for name, listener in self._listeners.items()
                if not listener.anywhere and listener.place is None and name not in self._known
            ]
            if self._trouble:
                return Health(ERROR, self._trouble, values)
            if missing and self._people is None:
                return Health(WARN, "no simulator publishes where people are", values)
        if missing:
            return Health(WARN, f"not in this world: {', '.join(missing)}", values)
        return Health(OK, "ready to answer", values)

    def _answer(self, listener: HearingPerson, question: str) -> None:
        # By the second, not by count: an answer does not depend on what was asked before.
        moment = int(rospy.get_time())
        random = draw(self._seed, "/".join(filter(None, [rospy.get_name(), listener.name])), moment)
        with self._changed:
            text = listener.answers.to(question, random)
        heard = PersonHeard(person=listener.name, question=question, answer=text)
        heard.header.stamp = rospy.Time.now()
        self._heard.publish(heard)
        who = listener.name or "the person"
        if not text:
            rospy.loginfo(f"{who} says nothing")
            return
        try:
            samples = self._synthesizer.say(text, listener.voice).samples
        except SoundError as error:
            rospy.logerr(f"person_voice: {error}")
            with self._changed:
                self._trouble = f"{who} cannot speak: {error}"
            return
        rospy.loginfo(f'{who} says: "{text}"')
        samples = np.concatenate([samples, np.zeros(round(TRAIL * RATE), dtype=np.int16)])
        noisy = samples + self._noise * random.standard_normal(len(samples))
        sound = np.clip(noisy, -32768, 32767).astype("<i2")
        size = round(CHUNK * RATE)
        with self._changed:
            self._given, self._trouble = self._given + 1, ""
        for first in range(0, len(sound), size):
            part = sound[first : first + size]
            self._microphone.publish(AudioData(data=part.tobytes()))
            if not self._clock.wait(len(part) / RATE, self._stopped):
                return

    def _hear(self, message: AudioData) -> None:
        samples = samples_of(message).astype(float)
        if not len(samples) or math.sqrt(float(np.mean(samples**2))) <= HEARD:
            return
        with self._changed:
            hearer = nearest(self._listeners.values(), self._robot, self._people or {}, self._heading)
            if hearer is not None:
                self._ask(self._overheard.sound(hearer))

    def _read(self, request: SoundRequest) -> None:
        if request.sound == SoundRequest.SAY and request.command != SoundRequest.PLAY_STOP:
            with self._changed:
                self._overheard.request(request.arg)

    def _notice(self, message: Bool) -> None:
        with self._changed:
            if message.data:
                self._overheard.begin()
            else:
                self._ask(self._overheard.end())

    def _ask(self, sentence: Optional[Sentence[HearingPerson]]) -> None:
        """Notes a sentence that is to be answered; called with the lock held."""
        if sentence is not None:
            self._asked.append(sentence)
            self._changed.notify_all()

    def _see(self, message: Odometry) -> None:
        with self._changed:
            self._robot = (message.pose.pose.position.x, message.pose.pose.position.y)
            turn = message.pose.pose.orientation
            self._heading = 2.0 * math.atan2(turn.z, turn.w)

    def _see_people(self, message: SimPeople) -> None:
        with self._changed:
            self._known = tuple(person.name for person in message.people)
            self._people = {
                person.name: (person.x, person.y)
                for person in message.people
                if person.state != SimPerson.ABSENT
            }

    def _set_answers(self, request: SetAnswersRequest) -> SetAnswersResponse:
        name = request.person
        if not name and len(self._listeners) == 1:
            name = next(iter(self._listeners))
        if name not in self._listeners:
            names = ", ".join(self._listeners)
            return SetAnswersResponse(False, f"there is no person {name!r}; known are {names}")
        try:
            answers = Answers(request.otherwise, request.next, request.patterns, request.answers)
        except ValueError as error:
            return SetAnswersResponse(False, str(error))
        with self._changed:
            self._listeners[name].answers = answers
        return SetAnswersResponse(True, f"{name or 'the person'} knows what to answer")


def main() -> int:
    """The executable ``person_voice``; returns its exit code."""
    return run_node("person_voice", _start)


def _start() -> Callable[[], None]:
    node = PersonVoice()
    HealthReporter({"people": node.health}).start()
    return node.run
