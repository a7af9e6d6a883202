"""The simulator with a clock that can be set back, as a restarted simulation does. Takes merlin_sim's place.

Only the time jumps; the world stays as it is, so that the knowledge of it stays true.
"""

import sys
from typing import Callable

import rospy
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from merlin_ros.node import run_node
from merlin_sim.engine.simulation import PHYSICS_RATE
from merlin_sim.node import simulator_node
from merlin_sim.node.simulator_node import SimulatorNode
from merlin_sim.world.world_file import WorldError

#: s on the clock when the world begins, so that there is time to go back to.
FIRST = 1000
#: s by which the clock is set back.
BACK = 30


class ClockSimulator(SimulatorNode):
    """The simulator, with a service `~clock_back`."""

    def __init__(self) -> None:
        self._shift = FIRST * PHYSICS_RATE  # physics steps that the clock is ahead of the world
        true_time = simulator_node._time
        # Every stamp of the node is made by this function.
        simulator_node._time = lambda tick: true_time(tick + self._shift)
        super().__init__()
        self._setter = rospy.Service("~clock_back", Trigger, self._set_back)

    def _set_back(self, _: TriggerRequest) -> TriggerResponse:
        with self._world_lock:
            before = self._now()
            if self._shift < BACK * PHYSICS_RATE:
                return TriggerResponse(False, f"{before.to_sec():.2f} s is too near the clock's begin")
            self._shift -= BACK * PHYSICS_RATE
        return TriggerResponse(True, f"from {before.to_sec():.2f} s back by {BACK} s")


def _start() -> Callable[[], None]:
    return ClockSimulator().run


if __name__ == "__main__":
    sys.exit(run_node("merlin_sim", _start, WorldError))
