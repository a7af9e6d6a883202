# SPDX-License-Identifier: Apache-2.0
"""Guests and barman among several robots: each is heard by, and hears, the persons beside it."""

from types import SimpleNamespace
from typing import Any, Callable, Dict, List

import numpy as np
import pytest
from audio_common_msgs.msg import AudioData
from merlin_msgs.msg import PersonHeard, SimPeople, SimPerson
from nav_msgs.msg import Odometry
from std_msgs.msg import Bool

from merlin_guests import stage as stage_module
from merlin_guests.barman import NAME, READY, Barman
from merlin_guests.stage import Stage

CALL = "waiter table one please"


class Restaurant:
    """A stage whose topics and services are lists; time passes when the stage waits."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, robots: List[str]) -> None:
        self.time = 100.0
        self.sent: Dict[str, int] = {}
        self.answers: List[str] = []
        self.receive: Dict[str, Callable[[Any], None]] = {}
        self.connections: Dict[str, List[Any]] = {}
        rospy = stage_module.rospy
        monkeypatch.setattr(rospy, "get_time", lambda: self.time)
        monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
        monkeypatch.setattr(rospy, "Publisher", self._publisher)
        monkeypatch.setattr(rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(stage_module, "RosClock", lambda: None)
        monkeypatch.setattr(stage_module, "ServiceProxy", self._service)
        sound = SimpleNamespace(samples=np.zeros(10, dtype=np.int16))
        monkeypatch.setattr(
            stage_module, "SpeechSynthesizer", lambda: SimpleNamespace(say=lambda text: sound)
        )
        self.stage = Stage(robots)
        self.stage.wait = self._pass  # type: ignore[method-assign]
        self.stage.wait_until = self._until  # type: ignore[method-assign]

    def _publisher(self, name: str, *_: Any, **__: Any) -> Any:
        def publish(message: Any) -> None:
            self.sent[name] = self.sent.get(name, 0) + 1

        return SimpleNamespace(publish=publish)

    def _subscribe(self, name: str, _: type, receive: Any, *arguments: Any, **__: Any) -> Any:
        self.receive[name] = lambda message: receive(message, *arguments)
        connections = self.connections[name] = [SimpleNamespace(socket="open")]
        return SimpleNamespace(impl=SimpleNamespace(connections=connections))

    def _service(self, name: str, *_: Any, **__: Any) -> Any:
        def call(**request: Any) -> Any:
            self.answers.append(name)
            return SimpleNamespace(success=True, message="")

        return call

    def _pass(self, seconds: float) -> None:
        self.time += seconds

    def _until(self, holds: Callable[[], bool], seconds: float) -> bool:
        end = self.time + seconds
        while not holds():
            if self.time >= end:
                return False
            self.time += 0.5
        return True

    def says(self, robot: str, text: str, to: str) -> None:
        self.receive[f"{robot}/person_voice/heard"](PersonHeard(person=to, question=text))


@pytest.fixture()
def restaurant(monkeypatch: pytest.MonkeyPatch) -> Restaurant:
    return Restaurant(monkeypatch, ["robot_1", "robot_2"])


def test_what_a_person_answers_is_known_beside_every_robot(restaurant: Restaurant) -> None:
    restaurant.stage.answer("ann", {"would you like": "yes please"})
    assert restaurant.answers == [
        "robot_1/person_voice/set_answers",
        "robot_2/person_voice/set_answers",
    ]


def test_who_is_spoken_to_knows_by_which_robot(restaurant: Restaurant) -> None:
    restaurant.says("robot_2", "Please follow me to table 3.", "ann")
    assert restaurant.stage.hear("ann", "follow me to", 5.0) == "please follow me to table 3."
    assert restaurant.stage.speaker("ann") == "robot_2"


def test_who_follows_one_robot_does_not_listen_to_another(restaurant: Restaurant) -> None:
    restaurant.says("robot_1", "This is table 1. Please take a seat.", "ann")
    assert restaurant.stage.hear("ann", "take a seat", 2.0, by="robot_2") == ""


def test_a_call_across_the_room_is_heard_by_all(restaurant: Restaurant) -> None:
    assert restaurant.stage.call(CALL, "ann")
    assert set(restaurant.sent) == {
        "audio/microphone",
        "robot_1/audio/microphone",
        "robot_2/audio/microphone",
    }


def test_a_guest_does_not_call_while_any_robot_speaks(restaurant: Restaurant) -> None:
    restaurant.receive["robot_2/sound_play/is_speaking"](Bool(data=True))
    assert not restaurant.stage.call(CALL, "ann")
    assert restaurant.sent == {}


def test_a_robot_that_died_while_it_spoke_does_not_silence_the_room(restaurant: Restaurant) -> None:
    restaurant.receive["robot_2/sound_play/is_speaking"](Bool(data=True))
    restaurant.connections["robot_2/sound_play/is_speaking"][0].socket = None
    assert restaurant.stage.call(CALL, "ann")


def test_who_speaks_to_the_robot_beside_them_does_not_mind_the_other_one(restaurant: Restaurant) -> None:
    restaurant.receive["robot_2/sound_play/is_speaking"](Bool(data=True))
    loud = (1000 * np.ones(100)).astype("<i2").tobytes()
    restaurant.receive["robot_2/audio/microphone"](AudioData(data=loud))
    assert restaurant.stage.call(READY, NAME, to="robot_1")
    assert set(restaurant.sent) == {"robot_1/audio/microphone"}


def test_the_only_robot_has_no_name_and_one_microphone(monkeypatch: pytest.MonkeyPatch) -> None:
    restaurant = Restaurant(monkeypatch, [""])
    assert restaurant.stage.call(CALL)
    assert set(restaurant.sent) == {"audio/microphone"}
    assert list(restaurant.receive)[-1] == "sound_play/is_speaking"


def test_each_robot_has_a_place_and_a_trail(restaurant: Restaurant) -> None:
    restaurant.receive["/merlin_sim/people"](SimPeople(people=[SimPerson(name=NAME)]))
    for robot, x in (("robot_1", 1.0), ("robot_2", 5.0), ("robot_2", 6.0)):
        message = Odometry()
        message.pose.pose.position.x = x
        restaurant.receive[f"{robot}/ground_truth"](message)
    stage = restaurant.stage
    assert stage.robots() == [(1.0, 0.0), (6.0, 0.0)]
    assert stage.trail(0, "robot_2") == [(5.0, 0.0), (6.0, 0.0)]
    assert stage.trail_length("robot_1") == 1


def test_the_barman_serves_the_robot_that_speaks(restaurant: Restaurant) -> None:
    done: List[str] = []

    class House:
        def counter_of(self, robot: str) -> str:
            return {"robot_1": "bar_2", "robot_2": "bar"}[robot]

        def on(self, where: str) -> List[str]:
            return []

        def take(self, where: str) -> List[str]:
            done.append(f"take {where}")
            return ["cake"]

        def put(self, where: str, kinds: List[str]) -> None:
            done.append(f"put {' '.join(kinds)} {where}")

    def over(name: str, texts: object, seconds: float, by: object = None) -> str:
        text = hear(name, texts, 0.0)
        if not text:
            raise EOFError
        return text

    stage = restaurant.stage
    hear, stage.hear = stage.hear, over  # type: ignore[method-assign,assignment]
    restaurant.says("robot_1", "table 4 ordered cake.", NAME)
    restaurant.says("robot_2", "table 5 ordered juice.", NAME)
    restaurant.says("robot_2", "The guests of table 1 have left. Please take the order from my tray.", NAME)
    restaurant.says("robot_1", "I am sorry, juice instead of cake.", NAME)
    restaurant.says("robot_1", "Please put the order of table 4 on my tray.", NAME)
    with pytest.raises(EOFError):
        Barman(stage, House(), 1, 0.0, lambda table: None).play()  # type: ignore[arg-type]
    assert done == [
        "take bar_2",
        "put cake bar_2",
        "take bar",
        "put juice bar",
        "take robot_2",
        "take bar_2",
        "put cake bar_2",
        "take bar_2",
        "put cake robot_1",
    ]
    assert "robot_2/audio/microphone" not in restaurant.sent
