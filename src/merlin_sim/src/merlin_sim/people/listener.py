# SPDX-License-Identifier: Apache-2.0
"""Persons that hear a robot, and where they are."""

import math
import re
from collections import deque
from dataclasses import dataclass
from typing import Any, Deque, Dict, Iterable, List, Mapping, Optional, Pattern, Sequence, Tuple

import numpy as np
import rospy

from merlin_reactive.pose import Point
from merlin_ros.parameters import ParameterError, number
from merlin_ros.robot_values import of_robot, texts


class Answers:
    """The answers of one person: sentences for the next questions, then patterns, then one by chance.

    :param following: answers to the next questions, whatever is asked; an empty one: says nothing.
    :param patterns: regular expressions looked for in the question, case aside; the first that fits counts.
    :param answers: the answer to each pattern.
    :param otherwise: when no pattern fits, one of these; empty: says nothing.
    :raises ValueError: when they do not fit together, or a pattern is invalid; the text says which.
    """

    def __init__(
        self,
        otherwise: Sequence[str] = (),
        following: Sequence[str] = (),
        patterns: Sequence[str] = (),
        answers: Sequence[str] = (),
    ) -> None:
        if len(patterns) != len(answers):
            raise ValueError(f"there are {len(patterns)} patterns and {len(answers)} answers to them")
        self._following: Deque[str] = deque(following)
        self._rules: List[Tuple[Pattern[str], str]] = [
            (_compiled(pattern), answer) for pattern, answer in zip(patterns, answers)
        ]
        self._otherwise = list(otherwise)

    def to(self, question: str, random: np.random.Generator) -> str:
        """The answer to a question; empty: says nothing."""
        if self._following:
            return self._following.popleft()
        for pattern, answer in self._rules:
            if pattern.search(question):
                return answer
        return self._otherwise[int(random.integers(len(self._otherwise)))] if self._otherwise else ""


def _compiled(pattern: str) -> Pattern[str]:
    try:
        return re.compile(pattern, re.IGNORECASE)
    except re.error as error:
        raise ValueError(f"the pattern {pattern!r} is not a regular expression: {error}") from error


HEARING = 4.0  # m
FACED = 0.5  # cosine of the angle to either side within which a robot faces a person
ASIDE = 2.0
VOICE = "en-us"
KEYS = ("voice", "answers", "replies", "hearing", "position")


@dataclass
class HearingPerson:
    """A person that hears and answers.

    :param name: of the person in the world; empty: none of them.
    :param hearing: distance to which the robot is heard, m.
    :param place: where the person is; None: where the world says that the person of this name is.
    :param anywhere: hears the robot wherever it is.
    """

    name: str
    answers: Answers
    voice: str = VOICE
    hearing: float = HEARING
    place: Optional[Point] = None
    anywhere: bool = False

    def distance(self, robot: Optional[Point], people: Mapping[str, Point]) -> float:
        """How far the robot is, m; infinite when it is too far to be heard, or the person is absent.

        :param people: where the persons of the world are.
        """
        if self.anywhere:
            return 0.0
        place = self.place if self.place is not None else people.get(self.name)
        if robot is None or place is None:
            return math.inf
        distance = math.dist(robot, place)
        return distance if distance <= self.hearing else math.inf


def nearest(
    listeners: Iterable[HearingPerson],
    robot: Optional[Point],
    people: Mapping[str, Point],
    heading: Optional[float] = None,
) -> Optional[HearingPerson]:
    """The listener that answers: the nearest one that hears the robot; None: none hears it.

    A person whom the robot does not face counts as ``ASIDE`` times as far: it speaks to whom it faces.

    :param heading: of the robot, rad; None: it faces all of them.
    """
    hearing = []
    for listener in listeners:
        distance = listener.distance(robot, people)
        place = listener.place if listener.place is not None else people.get(listener.name)
        if robot is not None and place is not None and heading is not None:
            aside = math.atan2(place[1] - robot[1], place[0] - robot[0]) - heading
            distance *= 1.0 if math.cos(aside) >= FACED else ASIDE
        hearing.append((distance, listener.name, listener))
    distance, _, listener = min(hearing, key=lambda item: item[:2])
    return listener if math.isfinite(distance) else None


def read_listeners() -> List[HearingPerson]:
    """The people of the parameters: those of ``~people``, or the one that the other parameters describe.

    ``~answers`` may be a list for each of the robots of ``~robots``; ``~robot`` is the one of this node.

    :raises ParameterError: a parameter cannot be used.
    """
    robot, robots = rospy.get_param("~robot", ""), rospy.get_param("~robots", [])
    try:
        answers = of_robot("~answers", rospy.get_param("~answers", ["no thank you"]), robot, robots)
    except ValueError as error:
        raise ParameterError(f"parameter {error}") from None
    shared: Dict[str, Any] = {
        "voice": rospy.get_param("~voice", VOICE),
        "answers": [] if answers is None else answers,
        "replies": rospy.get_param("~replies", []),
        "hearing": number("~hearing", HEARING, 0.1),
    }
    people = rospy.get_param("~people", {})
    if not isinstance(people, dict):
        raise ParameterError(f"parameter ~people is {people!r}, not people by name")
    if not people:
        position = rospy.get_param("~position", None)
        if isinstance(position, str) and position:
            return [_listener("~", position, shared)]
        return [_listener("~", "", {**shared, "position": position or None})]
    return [_listener(f"~people/{name}/", name, {**shared, **_keys(name, people[name])}) for name in people]


def _keys(name: str, fields: Any) -> Dict[str, Any]:
    if not isinstance(fields, dict) or not set(fields) <= set(KEYS):
        raise ParameterError(f"parameter ~people/{name} is {fields!r}; it may have {', '.join(KEYS)}")
    return fields


def _listener(where: str, name: str, fields: Dict[str, Any]) -> HearingPerson:
    hearing, position, replies = fields["hearing"], fields.get("position"), fields["replies"]
    if not isinstance(replies, list) or not all(
        isinstance(pair, list) and len(pair) == 2 and all(isinstance(each, (str, bool)) for each in pair)
        for pair in replies
    ):
        raise ParameterError(f"parameter {where}replies is {replies!r}, not pairs of a pattern and an answer")
    try:
        spoken = texts(f"{where}answers", fields["answers"])
    except ValueError as error:
        raise ParameterError(f"parameter {error}") from None
    patterns, said = (texts(f"{where}replies", [pair[part] for pair in replies]) for part in (0, 1))
    try:
        answers = Answers(spoken, (), patterns, said)
    except ValueError as error:
        raise ParameterError(f"parameter {where}replies: {error}") from None
    if not isinstance(hearing, (int, float)) or not hearing > 0:
        raise ParameterError(f"parameter {where}hearing is {hearing!r}, not a distance in m")
    if position is not None:
        numbers = isinstance(position, list) and all(isinstance(value, (int, float)) for value in position)
        if not numbers or len(position) != 2:
            raise ParameterError(f"parameter {where}position is {position!r}, not [x, y] or a person's name")
        position = (float(position[0]), float(position[1]))
    return HearingPerson(
        name, answers, str(fields["voice"]), float(hearing), position, anywhere=not name and not position
    )
