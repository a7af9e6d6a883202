# SPDX-License-Identifier: Apache-2.0
"""What guests and barman can do in the simulated world, and what they notice there."""

import math
import threading
from collections import deque
from typing import Callable, Deque, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np
import rospy
from audio_common_msgs.msg import AudioData
from geometry_msgs.msg import Point as PointMessage
from merlin_msgs.msg import GuestEvent, PersonHeard, SimPeople, SimPerson
from merlin_msgs.srv import (
    PlaceThing,
    PlaceThingResponse,
    SetAnswers,
    SetAnswersResponse,
    WalkPerson,
    WalkPersonResponse,
)
from nav_msgs.msg import Odometry
from std_msgs.msg import Bool

from merlin_guests.places import Point
from merlin_guests.seen_robot import Said, SeenRobot
from merlin_reactive.ros_clock import RosClock
from merlin_reactive.ros_messages import samples_of
from merlin_reactive.speech.speech_synthesizer import RATE, SpeechSynthesizer
from merlin_ros.deadline import Deadline
from merlin_ros.publishing import OnSubscriber
from merlin_ros.service_proxy import ServiceProxy

CHUNK = 0.2  # s of sound per message
CALL_WAITS = 60.0  # s until a guest gives up calling, because it is never quiet
APPEARS = 10.0  # s until a placed person is published
AHEAD = 0.5  # m from the middle of a person to the middle of what is in the way
HEARD = 200.0  # RMS, of 32767, of a voice
ROOM = ""  # the microphone of the room, which is that of the only robot
CALL_LIMIT = 10.0  # s of wall time for a service of the simulator


class PlayError(RuntimeError):
    """The simulated world refused something; the text says what and why."""


class Closed(Exception):
    """The evening is over, or ROS shuts down; ends all waits."""


class Stage:
    """The simulated restaurant for its players. Safe to use from all their threads.

    :param robots: their namespaces; empty: one robot without a namespace. Each hears, and is heard by, the
        persons beside it; a call across the room comes to all of them, and to the microphone of the room.
    """

    def __init__(self, robots: Sequence[str] = ("",)) -> None:
        self._clock = RosClock()
        self._changed = threading.Condition()  # guards the fields below
        self._over = threading.Event()
        self._people: Dict[str, SimPerson] = {}
        self._heard: Dict[str, Deque[Said]] = {}
        self._robots = {name: SeenRobot(name) for name in robots}
        self._speaker: Dict[str, str] = {}  # person → the robot that said what was heard last
        self._voices = threading.Lock()  # one person calls at a time
        self._synthesizer = SpeechSynthesizer()
        self._place = ServiceProxy("/merlin_sim/place", PlaceThing, timeout=CALL_LIMIT)
        self._walk = ServiceProxy("/merlin_sim/walk", WalkPerson, timeout=CALL_LIMIT)
        self._answers = [
            ServiceProxy(f"{robot.prefix}person_voice/set_answers", SetAnswers, timeout=CALL_LIMIT)
            for robot in self._robots.values()
        ]
        self._subscribed = threading.Event()
        notice = OnSubscriber(lambda _: self._subscribed.set())
        self._events = rospy.Publisher("restaurant/guests", GuestEvent, notice, latch=True, queue_size=100)
        self._microphones = {
            name: rospy.Publisher(f"{prefix}audio/microphone", AudioData, queue_size=50)
            for name, prefix in {
                ROOM: "",
                **{robot.name: robot.prefix for robot in self._robots.values()},
            }.items()
        }
        rospy.Subscriber("/merlin_sim/people", SimPeople, self._see_people, tcp_nodelay=True)
        for robot in self._robots.values():
            for topic, kind, receive, queue in (
                ("person_voice/heard", PersonHeard, self._hear, None),
                ("ground_truth", Odometry, self._see_robot, 1),
                ("audio/microphone", AudioData, self._listen, 50),
                ("sound_play/is_speaking", Bool, self._notice, None),
            ):
                subscriber = rospy.Subscriber(
                    robot.prefix + topic, kind, receive, robot, queue_size=queue, tcp_nodelay=True
                )
            robot.voice = subscriber  # the last one

    # --- time ----------------------------------------------------------------------------------------------

    def ready(self, timeout: float) -> str:
        """Waits for the simulator and the voices; returns what is missing, empty when nothing is."""
        for proxy in (self._place, self._walk, *self._answers):
            if not proxy.wait(timeout):
                return f"no service {proxy.name} after {timeout:.0f} s"
        with self._changed:
            if not self._changed.wait_for(self._all_seen, timeout):
                return f"no /merlin_sim/people, or no ground_truth, after {timeout:.0f} s"
        return ""

    def _all_seen(self) -> bool:
        return bool(self._people) and all(robot.place is not None for robot in self._robots.values())

    def wait_for_subscriber(self, timeout: float) -> bool:
        """Waits for a subscriber of the events, which would miss earlier ones.

        :param timeout: s of running time.
        """
        return Deadline(timeout).wait_event(self._subscribed)

    def now(self) -> float:
        """Simulated time, s."""
        return rospy.get_time()

    def wait(self, seconds: float) -> None:
        """Waits for simulated time.

        :raises Closed: the evening is over.
        """
        if not self._clock.wait(seconds, self._over) or rospy.is_shutdown():
            raise Closed

    def wait_until(self, holds: Callable[[], bool], seconds: float) -> bool:
        """Waits until something that is heard or seen holds, at most some simulated time; whether it does.

        :raises Closed: the evening is over.
        """
        end = self.now() + seconds
        with self._changed:
            while not holds():
                if self._over.is_set() or rospy.is_shutdown():
                    raise Closed
                if self.now() >= end:
                    return False
                self._changed.wait(0.5)  # people and robot move: something changes many times a second
        return True

    def close(self) -> None:
        """Ends the evening and all waits."""
        self._over.set()
        self._clock.wake()
        with self._changed:
            self._changed.notify_all()

    # --- people and things ---------------------------------------------------------------------------------

    def put_person(self, name: str, at: Point, yaw: float = 0.0, sit: bool = False) -> None:
        """Makes a person appear.

        :raises PlayError: something is in the way.
        """
        with self._changed:
            kind = "" if name in self._people else "person"
        self._demand(self._place(name=name, kind=kind, x=at[0], y=at[1], yaw=yaw, sit=sit), name)
        # The simulator answers before it publishes the new place; from here on all may rely on it.
        if not self.wait_until(lambda: name in self._people, APPEARS):
            raise PlayError(f"{name} was placed, but did not appear on /merlin_sim/people in {APPEARS:g} s")

    def put_thing(self, name: str, kind: str, on: str, at: Point) -> None:
        """Puts an object on furniture or on the robot's tray; m from its middle."""
        self._demand(self._place(name=name, kind=kind, on=on, x=at[0], y=at[1]), name)

    def move_furniture(self, name: str, to: Point) -> None:
        """Puts a movable piece of furniture on the floor somewhere."""
        self._demand(self._place(name=name, x=to[0], y=to[1]), name)

    def remove(self, name: str) -> None:
        """Takes a person or an object out of the world."""
        self._demand(self._place(name=name, absent=True), name)

    def walk(
        self,
        name: str,
        path: Sequence[Point],
        speed: float = 0.0,
        sit: bool = False,
        yaw: Optional[float] = None,
    ) -> int:
        """Starts a walk of a person; returns its number."""
        points = [PointMessage(x, y, 0.0) for x, y in path]
        answer = self._walk(
            name=name, path=points, speed=speed, sit=sit, turn=yaw is not None, yaw=yaw if yaw else 0.0
        )
        self._demand(answer, name)
        return int(answer.walk)

    def arrived(self, name: str, walk: int, limit: float = 120.0) -> bool:
        """Waits for the end of a walk; False: it took too long."""

        def there() -> bool:
            person = self._people.get(name)
            return person is not None and person.walk >= walk and person.state != SimPerson.WALKING

        return self.wait_until(there, limit)

    def in_the_way(self, name: str) -> Optional[Point]:
        """The place of the thing in the way of a walking person, m; None: the way is free."""
        with self._changed:
            person = self._people[name]
        if not person.waits_for:
            return None
        return person.x + AHEAD * math.cos(person.yaw), person.y + AHEAD * math.sin(person.yaw)

    def position(self, name: str) -> Point:
        """Where a person is, m."""
        with self._changed:
            person = self._people[name]
            return person.x, person.y

    def people(self) -> List[str]:
        """The names of all present persons."""
        with self._changed:
            return [name for name, person in self._people.items() if person.state != SimPerson.ABSENT]

    def robot(self, name: str = "") -> Point:
        """Where a robot is, m."""
        with self._changed:
            place = self._robots[name].place
        assert place is not None
        return place

    def robots(self) -> List[Point]:
        """Where all robots are, m."""
        return [self.robot(name) for name in self._robots]

    def trail_length(self, name: str = "") -> int:
        """How many places of a robot are remembered."""
        with self._changed:
            return len(self._robots[name].trail)

    def trail(self, since: int, name: str = "") -> List[Point]:
        """Where a robot has been, the newest last.

        :param since: number of the first of these places; the first of all is 0.
        """
        with self._changed:
            return self._robots[name].trail[since:]

    # --- speech --------------------------------------------------------------------------------------------

    def answer(self, name: str, answers: Dict[str, str]) -> None:
        """Sets what a person answers: pattern of what a robot says → answer."""
        patterns, texts = list(answers), list(answers.values())
        for ask in self._answers:
            self._demand(ask(person=name, next=[], patterns=patterns, answers=texts, otherwise=[]), name)

    def forget(self, name: str) -> None:
        """Forgets what a person heard so far."""
        with self._changed:
            self._heard[name] = deque()

    def hear(
        self, name: str, text: Union[str, Tuple[str, ...]], seconds: float, by: Optional[str] = None
    ) -> str:
        """Waits until a robot says a sentence with one of some texts to a person; returns it.

        :param by: the robot; None: any of them, which :meth:`speaker` names.
        """
        wanted = (text,) if isinstance(text, str) else text
        found: List[str] = []

        def said() -> bool:
            heard = self._heard.setdefault(name, deque())
            while heard:
                robot, question = heard.popleft()
                if by in (None, robot) and any(part in question for part in wanted):
                    self._speaker[name] = robot
                    found.append(question)
                    return True
            return False

        return found[0] if self.wait_until(said, seconds) else ""

    def speaker(self, name: str) -> str:
        """The robot that said what a person heard last."""
        with self._changed:
            return self._speaker.get(name, "")

    def call(self, text: str, name: str = "", to: Optional[str] = None) -> bool:
        """Says something aloud as soon as it is quiet.

        :param name: of the caller; it stays silent when the robot spoke to it before the room was quiet.
        :param to: the robot beside the caller, which alone hears it; None: the whole room does.
        :return: False: it never was quiet, or the robot came first.
        """
        around = [robot for robot in self._robots.values() if to in (None, robot.name)]

        def spoken_to() -> bool:
            return bool(self._heard.get(name))

        def quiet() -> bool:
            return all(robot.is_quiet(self.now()) for robot in around)

        end = self.now() + CALL_WAITS
        while self.wait_until(lambda: spoken_to() or quiet(), end - self.now()):
            if spoken_to():
                return False
            with self._voices:
                with self._changed:
                    if not quiet():
                        continue  # another guest was faster
                    for robot in around:
                        robot.quiet_room.sound(self.now())
                self._say(
                    text,
                    [robot.name for robot in around] + [ROOM] * (to is None and ROOM not in self._robots),
                )
                return True
        return False

    def _say(self, text: str, to: Sequence[str]) -> None:
        samples = self._synthesizer.say(text).samples
        sound = np.concatenate([samples, np.zeros(round(0.8 * RATE), dtype=np.int16)])
        size = round(CHUNK * RATE)
        for first in range(0, len(sound), size):
            part = sound[first : first + size]
            for name in to:
                self._microphones[name].publish(AudioData(data=part.astype("<i2").tobytes()))
            self.wait(len(part) / RATE)

    # --- books ---------------------------------------------------------------------------------------------

    def publish(
        self, event: int, guest: str = "", table: str = "", items: Sequence[str] = (), reason: str = ""
    ) -> None:
        """Publishes an event of an evening (``merlin_msgs/GuestEvent``)."""
        message = GuestEvent(guest=guest, event=event, table=table, items=list(items), reason=reason)
        message.header.stamp = rospy.Time.now()
        self._events.publish(message)
        rospy.loginfo(f"{guest or 'restaurant'}: event {event} {table} {' '.join(items)} {reason}")

    def _demand(
        self, answer: Union[PlaceThingResponse, WalkPersonResponse, SetAnswersResponse], name: str
    ) -> None:
        if not answer.success:
            raise PlayError(f"{name}: {answer.message}")

    def _see_people(self, message: SimPeople) -> None:
        with self._changed:
            self._people = {person.name: person for person in message.people}
            self._changed.notify_all()

    def _see_robot(self, message: Odometry, robot: SeenRobot) -> None:
        with self._changed:
            robot.move(message)
            self._changed.notify_all()

    def _hear(self, message: PersonHeard, robot: SeenRobot) -> None:
        with self._changed:
            self._heard.setdefault(message.person, deque()).append((robot.name, message.question.lower()))
            if message.answer:
                robot.quiet_room.asked(self.now())
            self._changed.notify_all()

    def _listen(self, message: AudioData, robot: SeenRobot) -> None:
        samples = samples_of(message).astype(float)
        if len(samples) and math.sqrt(float(np.mean(samples**2))) > HEARD:
            with self._changed:
                robot.quiet_room.sound(self.now())

    def _notice(self, message: Bool, robot: SeenRobot) -> None:
        with self._changed:
            robot.quiet_room.robot(self.now(), bool(message.data))
