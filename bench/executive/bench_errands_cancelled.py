# SPDX-License-Identifier: Apache-2.0
"""Twenty errands together of which half are cancelled in the middle, against the rest sent from that place.

When five have ended and the robot drives again, those of ten chosen ones that have not ended are cancelled.
From there on count metres and s until the end, by that clock. Then the robot is put to that
place again, and the errands that were left are sent as a new list: together, and one after the other in the
order of the list.
LISTS, and the clock: as for `bench_day`.
"""

import os
import random
import tempfile
from pathlib import Path
from typing import Any, Dict, List, Sequence

import rospy
from measuring.figures import figure
from measuring.ros_process import RosMaster
from merlin_msgs.msg import ExecuteResult

from executive.floor import Floor
from executive.floor_robot import FloorRobot
from merlin_executor.executor_client import ExecutorRequest

SIZE, CANCELLED, ENDED = 20, 10, 5  # errands; of which are cancelled; when so many have ended
WALL = 600.0  # s of wall time for a list


class Lists:
    """Carries out lists of errands.

    :ivar figures: of each way, list by list.
    """

    def __init__(self, robot: FloorRobot) -> None:
        self._robot = robot
        self.figures: Dict[str, List[float]] = {}

    def carry_out(self, seed: int) -> None:
        """One list in three ways.

        :raises RuntimeError: an errand that was not cancelled is not reached, or a fact is wrong.
        """
        robot, chance = self._robot, random.Random(f"cancelled/{seed}")
        stops = chance.sample(robot.floor.points[1:], SIZE)
        chosen = set(chance.sample(stops, CANCELLED))
        robot.begin(robot.floor.points[0])
        requests = {stop: robot.send(stop) for stop in stops}
        robot.wait("a drive after five ends", lambda: len(robot.ends) >= ENDED and self._drives(), limit=WALL)
        place, begin, driven = robot.base.place(), rospy.get_time(), robot.base.driven()
        ended = {stop for stop, request in requests.items() if request.done}
        for stop in chosen - ended:
            requests[stop].cancel()
        self._finish("in the middle", list(requests.values()), begin, driven)
        results = {stop: request.result for stop, request in requests.items()}
        reached = {
            stop for stop, result in results.items() if result and result.outcome == ExecuteResult.SUCCEEDED
        }
        if not reached >= set(stops) - chosen:
            raise RuntimeError(f"not reached: {sorted(set(stops) - chosen - reached)}")
        facts = {fact.strip("()").split()[1] for fact in robot.knowledge.facts("checked")}
        if facts != reached:
            raise RuntimeError(f"reached {sorted(reached)}, but (checked ...) of {sorted(facts)} holds")
        rest = [stop for stop in stops if stop in reached - ended]
        for way in ("new list together", "one after the other"):
            robot.begin(place=place)
            begin, driven = rospy.get_time(), robot.base.driven()
            sent = [robot.send(stop, alone=way.startswith("one")) for stop in rest]
            self._finish(way, sent, begin, driven)

    def _drives(self) -> bool:
        return any(action.name == "navigate" for action in self._robot.status.running)

    def _finish(self, way: str, requests: Sequence[ExecutorRequest], begin: float, driven: float) -> None:
        """Waits for the end of all, and notes the figures since a begin."""
        robot = self._robot
        robot.wait("the end", lambda: robot.ended(*requests) and robot.idle(), limit=WALL)
        values = {"metres": robot.base.driven() - driven, "s": max(robot.ends.values()) - begin}
        for name, value in values.items():
            self.figures.setdefault(f"{name} {way}", []).append(value)
        print(way, {name: round(value, 1) for name, value in values.items()}, flush=True)


def measure() -> Dict[str, Any]:
    """The figures of :class:`Lists`."""
    floor = Floor(SIZE + 4)
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as folder, RosMaster() as master:
        floor.write(Path(folder))
        master.set_params({"/use_sim_time": True})
        master.launch(Path(__file__).with_name("floor.launch"), folder=folder)
        rospy.init_node("bench_errands_cancelled", disable_signals=True)
        robot = FloorRobot(floor)
        lists = Lists(robot)
        for seed in range(int(os.environ.get("LISTS", 5))):
            lists.carry_out(seed)
        robot.clock.stop()
        rospy.signal_shutdown("done")
    return {"errands_cancelled": {name: figure(values) for name, values in lists.figures.items()}}
