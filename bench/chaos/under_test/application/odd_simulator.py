# SPDX-License-Identifier: Apache-2.0
"""The simulator, whose clock can be set back as by a restarted simulation, and whose sensors can fall silent.

It takes merlin_sim's place. Only the time jumps; the world stays as it is, so that the knowledge of it stays
true. With `~wall_time` it is the robot's hardware: its stamps are those of the clock on the wall, and
there is no /clock and no state of a simulator.
"""

import sys
from typing import Any, Callable, List

import rospy
from std_srvs.srv import (
    SetBool,
    SetBoolRequest,
    SetBoolResponse,
    Trigger,
    TriggerRequest,
    TriggerResponse,
)

from merlin_ros.health import HealthReporter
from merlin_ros.node import run_node
from merlin_sim.engine.simulation import PHYSICS_RATE
from merlin_sim.node import simulator_node
from merlin_sim.node.simulator_node import SimulatorNode
from merlin_sim.world.world_file import WorldError

#: s on the clock when the world begins, so that there is time to go back to.
FIRST = 1000
#: s by which the clock is set back.
BACK = 30


class OddSimulator(SimulatorNode):
    """The simulator, with services `~clock_back` and `~mute/<topic>`."""

    def __init__(self) -> None:
        self._wall = bool(rospy.get_param("~wall_time", False))
        self._shift = FIRST * PHYSICS_RATE  # physics steps that the clock is ahead of the world
        true_time = simulator_node._time
        # Every stamp of the node is made by this function.
        simulator_node._time = lambda tick: rospy.Time.now() if self._wall else true_time(tick + self._shift)
        super().__init__()
        self._setter = rospy.Service("~clock_back", Trigger, self._set_back)
        robots = list(self._robots.values())
        self._mutes = [
            _mute("tf", [self._tf]),
            _mute("scan", [robot._scan for robot in robots]),
            _mute("odom", [robot._odom for robot in robots]),
        ]

    def _publish_clock(self, tick: int) -> None:
        if not self._wall:
            super()._publish_clock(tick)

    def _publish_status(self) -> None:
        if not self._wall:
            super()._publish_status()

    def _set_back(self, _: TriggerRequest) -> TriggerResponse:
        with self._world_lock:
            before = self._now()
            if self._shift < BACK * PHYSICS_RATE:
                return TriggerResponse(False, f"{before.to_sec():.2f} s is too near the clock's begin")
            self._shift -= BACK * PHYSICS_RATE
        return TriggerResponse(True, f"from {before.to_sec():.2f} s back by {BACK} s")


def _mute(topic: str, publishers: List[Any]) -> rospy.Service:
    """A service that keeps back what is published, as a link that is open on one side only does."""
    true = [publisher.publish for publisher in publishers]

    def obey(request: SetBoolRequest) -> SetBoolResponse:
        for publisher, publish in zip(publishers, true):
            publisher.publish = (lambda *_, **__: None) if request.data else publish
        return SetBoolResponse(True, f"{topic} is {'silent' if request.data else 'there'}")

    return rospy.Service(f"~mute/{topic}", SetBool, obey)


def _start() -> Callable[[], None]:
    node = OddSimulator()
    HealthReporter({"world": node.health}).start()
    return node.run


if __name__ == "__main__":
    sys.exit(run_node("merlin_sim", _start, WorldError))
