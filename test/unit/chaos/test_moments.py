# SPDX-License-Identifier: Apache-2.0
"""Moments are recognised by what happens."""

import pytest
from chaos.judging import events
from chaos.judging.events import Event
from chaos.judging.scene import Scene
from chaos.moments import Moment, begins, holds


def scene(*scenario: Event) -> Scene:
    made = Scene()
    for event in scenario:
        made.apply(event)
    return made


def truth(speed: float) -> Event:
    return Event(1.0, events.TRUTH, {"speed": speed, "turn": 0.0, "x": 0.0, "y": 0.0})


def goals(server: str, *active: str) -> Event:
    return Event(1.0, events.GOALS, {"server": server, "active": list(active), "ended": {}})


def status(state: int, stage: str) -> Event:
    return Event(1.0, events.STATUS, {"state": state, "stage": stage, "request": "r"})


@pytest.mark.parametrize(
    ("moment", "scenario"),
    [
        (Moment.DRIVING, [truth(0.2), goals("move_base", "a")]),
        (Moment.SPEAKING, [goals("sound_play", "a")]),
        (Moment.LISTENING, [goals("listen", "a")]),
        (Moment.PLANNING, [status(1, "PLAN")]),
        (Moment.IDLE, [status(0, ""), truth(0.0)]),
    ],
)
def test_a_moment_that_lasts(moment: Moment, scenario: list) -> None:
    assert holds(moment, scene(*scenario))
    others = [other for other in Moment if other is not moment and holds(other, scene(*scenario))]
    assert not others


@pytest.mark.parametrize(
    ("moment", "scenario"),
    [
        (Moment.DRIVING, [truth(0.05), goals("move_base", "a")]),
        (Moment.DRIVING, [truth(0.3), goals("move_base", "a"), goals("move_base")]),
        (Moment.IDLE, [status(0, ""), truth(0.3)]),
        (Moment.IDLE, [status(0, ""), goals("sound_play", "a")]),
        (Moment.IDLE, []),
    ],
)
def test_a_moment_that_is_not_there(moment: Moment, scenario: list) -> None:
    assert not holds(moment, scene(*scenario))


def test_between_two_actions_begins_with_the_end_of_one() -> None:
    done = Event(1.0, events.FEEDBACK, {"status": 2})
    enabled = Event(1.0, events.FEEDBACK, {"status": 1})
    assert begins(Moment.BETWEEN, scene(done), done)
    assert not begins(Moment.BETWEEN, scene(enabled), enabled)


def test_cancelling_begins_with_the_cancel() -> None:
    cancel = Event(1.0, events.CANCEL, {"label": "request"})
    assert begins(Moment.CANCELLING, scene(cancel), cancel)
