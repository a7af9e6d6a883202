# SPDX-License-Identifier: Apache-2.0
"""Lists of errands at once: one after the other, together, and the shortest tour, as the domain counts time.

The drives of the action servers take 20 ms: what is counted is what the actions that were dispatched take by
the domain. ANYTIME as for `bench_together`. ERRANDS: one list of so many, from 21 on beside a short tour.
"""

import os
import random
import tempfile
import time
from pathlib import Path
from typing import Any, Dict, List, Tuple

import rospy
from measuring.figures import figure
from measuring.ros_process import RosMaster
from merlin_msgs.msg import ExecuteResult
from std_srvs.srv import Trigger

from executive.bench_together import LIMIT, Robot
from executive.floor import Floor, seconds
from merlin_ros.service_proxy import ServiceProxy
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

POINTS = 24
LISTS = {6: 10, 10: 10, 20: 5}  # errands → lists
EXACT = 20  # errands of a list whose shortest tour is found
TRIES = 5
HOW = ("alone", "together")


class Lists:
    """Carries out lists of errands from the first point on."""

    def __init__(self, robot: Robot, floor: Floor) -> None:
        self._robot, self._floor = robot, floor
        self._start = floor.points[0]
        self._knowledge = MerlinROSPlanAssistant()
        self.replaced = 0  # plans that were replaced
        self._pause, self._resume = (ServiceProxy(f"merlin/{name}", Trigger) for name in ("pause", "resume"))
        if not self._knowledge.knowledge.wait(LIMIT):
            raise RuntimeError(f"no knowledge base after {LIMIT:g} s")

    def carry_out(self, stops: List[str], alone: bool) -> Tuple[float, float, float]:
        """Sends errands at once; returns metres of all drives, ms until the first, s until all have ended.

        A plan that is replaced leaves a drive whose metres are not known: then the list is done again.

        :raises RuntimeError: an errand did not succeed, or the plan was replaced each time.
        """
        for _ in range(TRIES):
            first, ended = self._once(stops, alone)
            with self._robot.changed:
                actions = [(action.name, action.parameters[-1].value) for action in self._robot.dispatched]
            if len(actions) == 2 * len(stops):
                drives = [point for name, point in actions if name == "navigate"]
                return self._floor.tour([self._start, *drives]), first, ended
        raise RuntimeError(f"for {stops}: {actions}")

    def _once(self, stops: List[str], alone: bool) -> Tuple[float, float]:
        """Carries out a list; returns the ms until the first drive, and the s until all have ended."""
        robot, knowledge = self._robot, self._knowledge
        knowledge.remove_facts([*knowledge.facts("checked"), *knowledge.facts("robot_at")])
        knowledge.add_facts(f"(robot_at {self._start})")
        with robot.changed:
            robot.dispatched.clear()
        # The sending takes as long as some of the short drives: it counts as one moment.
        self._pause()
        requests = [robot.send(stop, alone=alone) for stop in stops]
        begin = time.monotonic()
        self._resume()
        first = robot.wait("the first drive", lambda: bool(robot.dispatched), begin)
        limit = LIMIT + 10.0 * len(stops)
        ended = robot.wait("all errands", lambda: robot.ended(*requests) and robot.idle(), begin, limit)
        for request in requests:
            result = request.result
            if result is None or result.outcome != ExecuteResult.SUCCEEDED:
                raise RuntimeError(f"an errand did not succeed: {result}")
        self.replaced += max(request.result.replans for request in requests if request.result)
        robot.wait("the last action", lambda: len(robot.dispatched) >= 2 * len(stops))
        return first, ended / 1e3


def measure() -> Dict[str, Any]:
    """Time and metres of each way, and by how many percent both are above the shortest tour."""
    wanted = int(os.environ.get("ERRANDS", 0))
    lists_of = {wanted: 1} if wanted else LISTS
    floor = Floor(max(POINTS, wanted + 4))
    tasks = [
        (size, random.Random(f"{size}/{number}").sample(floor.points[1:], size))
        for size, lists in lists_of.items()
        for number in range(lists)
    ]
    done: Dict[str, List[Tuple[float, float, float]]] = {how: [] for how in HOW}
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as folder, RosMaster() as master:
        floor.write(Path(folder))
        anytime = os.environ.get("ANYTIME", "0.2")
        launch = Path(__file__).with_name("together.launch")
        master.launch(launch, folder=folder, drive_duration=0.02, anytime=anytime)
        rospy.init_node("bench_errands", disable_signals=True)
        lists = Lists(Robot(), floor)
        for size, stops in tasks:
            for how in HOW:
                done[how].append(lists.carry_out(stops, how == "alone"))
            print(size, [f"{done[how][-1][0]:.1f} m" for how in HOW], flush=True)
        rospy.signal_shutdown("done")
    metres = {how: [length for length, _, _ in done[how]] for how in HOW}
    best = floor.shortest if wanted <= EXACT else floor.short
    metres["shortest"] = [best(floor.points[0], stops) for _, stops in tasks]
    names = ("metres", "s", "percent_above_shortest", "first_drive_ms", "until_all_ended_s")
    figures: Dict[str, Any] = {name: {} for name in names}
    figures["replaced_plans"] = lists.replaced
    for size in lists_of:
        mine = [number for number, (each, _) in enumerate(tasks) if each == size]
        for how, lengths in metres.items():
            name = f"{size} {how}"
            figures["metres"][name] = figure([lengths[each] for each in mine])
            times = [seconds(lengths[each], size) for each in mine]
            figures["s"][name] = figure(times)
            if how in HOW:
                figures["first_drive_ms"][name] = figure([done[how][each][1] for each in mine])
                figures["until_all_ended_s"][name] = figure([done[how][each][2] for each in mine])
                least = [seconds(metres["shortest"][each], size) for each in mine]
                above = [(time / best - 1.0) * 100.0 for time, best in zip(times, least)]
                figures["percent_above_shortest"][name] = figure(above)
    return {"errands": figures}
