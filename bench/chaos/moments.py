# SPDX-License-Identifier: Apache-2.0
"""The moments of a request at which a fault strikes, recognised by events."""

from enum import Enum
from typing import Dict, NamedTuple

from chaos.judging import events
from chaos.judging.events import Event
from chaos.judging.scene import DRIVING_SPEED, IDLE, PLANNING_STAGES, Scene

#: Status of action_feedback: the action has reached its goal state.
ACTION_SUCCEEDED = 2


class Moment(Enum):
    """When a fault strikes."""

    DRIVING = "driving"
    SPEAKING = "speaking"
    LISTENING = "listening"
    PLANNING = "planning"
    BETWEEN = "between"
    IDLE = "idle"
    CANCELLING = "cancelling"


class Window(NamedTuple):
    """How a moment is used."""

    delay: float
    """Longest random delay between its begin and the fault, s."""
    holds: bool
    """Whether it has to hold still when the fault strikes; else its begin is enough."""


WINDOWS: Dict[Moment, Window] = {
    Moment.DRIVING: Window(2.0, True),
    Moment.SPEAKING: Window(1.0, True),
    Moment.LISTENING: Window(2.0, True),
    Moment.PLANNING: Window(0.2, False),
    Moment.BETWEEN: Window(0.01, False),
    Moment.IDLE: Window(1.0, True),
    Moment.CANCELLING: Window(0.05, False),
}


def holds(moment: Moment, scene: Scene) -> bool:
    """Whether a moment that lasts is now."""
    if moment is Moment.DRIVING:
        return scene.speed > DRIVING_SPEED and bool(scene.active.get("move_base"))
    if moment is Moment.SPEAKING:
        return bool(scene.active.get("sound_play"))
    if moment is Moment.LISTENING:
        return bool(scene.active.get("listen"))
    if moment is Moment.PLANNING:
        return scene.stage in PLANNING_STAGES
    if moment is Moment.IDLE:
        return scene.state == IDLE and not scene.busy() and scene.standing
    return False


def begins(moment: Moment, scene: Scene, event: Event) -> bool:
    """Whether an event, which the scene has taken already, begins the moment.

    :param event: the latest one.
    """
    if moment is Moment.BETWEEN:
        return event.kind == events.FEEDBACK and event["status"] == ACTION_SUCCEEDED
    if moment is Moment.CANCELLING:
        return event.kind == events.CANCEL
    return holds(moment, scene)
