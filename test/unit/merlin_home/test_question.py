# SPDX-License-Identifier: Apache-2.0
"""The question of the missions is synthesised before the first task: what is asked is what was prepared."""

from typing import Any, List

import pytest
from fake_robot import FakeServer
from roslaunch.config import ROSLaunchConfig
from roslaunch.xmlloader import XmlLoader

from merlin_home.actions.ask import Ask
from merlin_sm.states import action_state

LAUNCH = "$(find merlin)/launch/include/home_robot.launch"


class Voice(FakeServer):
    """Says everything at once, and remembers it."""

    def __init__(self) -> None:
        super().__init__("sound_play")
        self.said: List[str] = []

    def send(self, goal: Any, on_done: Any, owner: Any) -> Any:
        self.said.append(goal.sound_request.arg)
        self.results = [None]
        return super().send(goal, on_done, owner)


def test_what_the_robot_asks_is_what_it_has_prepared(monkeypatch: pytest.MonkeyPatch) -> None:
    voice = Voice()
    monkeypatch.setattr(action_state, "shared_client", lambda *_: voice)
    assert Ask().run_once({"p": "kitchen"}) == "succeeded"

    config = ROSLaunchConfig()
    XmlLoader(resolve_anon=False).load_string(f'<launch><include file="{LAUNCH}"/></launch>', config)
    (prepared,) = [param.value for name, param in config.params.items() if name.endswith("/phrases")]
    assert prepared == voice.said and len(voice.said[0].split()) > 5
