# SPDX-License-Identifier: Apache-2.0
"""What is the case now: folds the events into the present state of the robot."""

from typing import Dict, FrozenSet, List, Optional

from chaos.judging import events
from chaos.judging.events import Event

#: m/s below which the base stands: one that has braked rocks back on its wheels with 0.01.
STANDING_SPEED = 0.02
#: rad/s below which it does not turn.
STANDING_TURN = 0.05
#: m/s from which it counts as driving, for the moment of a fault.
DRIVING_SPEED = 0.1
#: Commands below this are zero.
ZERO = 1e-6
SERVERS = ("move_base", "sound_play", "listen")
PLANNING_STAGES = ("GENERATE_PROBLEM", "PLAN", "PARSE_PLAN")
CANCEL_ACTION = "cancel_action"
IDLE = 0


def stands(truth: Event) -> bool:
    """Whether the base stands, by a TRUTH event."""
    return abs(truth["speed"]) < STANDING_SPEED and abs(truth["turn"]) < STANDING_TURN


def commands_motion(command: Event) -> bool:
    """Whether a COMMAND event is not zero."""
    return abs(command["speed"]) > ZERO or abs(command["turn"]) > ZERO


class Scene:
    """The present state, from the events so far."""

    def __init__(self) -> None:
        self.truth: Optional[Event] = None
        self.command: Optional[Event] = None
        self.active: Dict[str, FrozenSet[str]] = {}
        self.state: Optional[int] = None
        self.stage = ""
        self.feedback: Optional[Event] = None

    def apply(self, event: Event) -> None:
        """Takes the next event."""
        if event.kind == events.TRUTH:
            self.truth = event
        elif event.kind == events.COMMAND:
            self.command = event
        elif event.kind == events.GOALS:
            self.active[event["server"]] = frozenset(event["active"])
        elif event.kind == events.STATUS:
            self.state, self.stage = event["state"], event["stage"]
        elif event.kind == events.FEEDBACK:
            self.feedback = event

    @property
    def speed(self) -> float:
        """m/s of the base, 0 when not known."""
        return abs(self.truth["speed"]) if self.truth else 0.0

    @property
    def standing(self) -> bool:
        """Whether the base stands."""
        return self.truth is None or stands(self.truth)

    def busy(self) -> List[str]:
        """Names of the servers with active goals."""
        return sorted(server for server, active in self.active.items() if active)


def scene_at(log: List[Event], at: float) -> Scene:
    """The scene at a time, from events in order."""
    scene = Scene()
    for event in log:
        if event.at > at:
            break
        scene.apply(event)
    return scene
