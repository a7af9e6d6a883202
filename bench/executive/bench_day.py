# SPDX-License-Identifier: Apache-2.0
"""A short day: 30 errands with times and 10 urgent ones that come meanwhile; which share is done in time?

The same lists are done in MERLIN's order, the one that is due first next, and the one that came first next.
The processes are those of ``robot.launch``. Drives and questions take the time of the domain, below a clock
that is fast while the robot acts (:mod:`executive.floor_robot`). LISTS: how many.
"""

import concurrent.futures
import multiprocessing
import os
import random
import tempfile
import threading
from functools import partial
from pathlib import Path
from typing import Any, Dict, List, NamedTuple

import rospy
from measuring.figures import figure
from measuring.ros_process import RosMaster
from merlin_msgs.msg import ExecuteResult

from executive.floor import Floor
from executive.floor_robot import FloorRobot
from merlin_executor.executor_client import ExecutorRequest
from merlin_ros.ros_alarm import call_after

TIMED, URGENT = 30, 10
DAY = 1800.0  # s: as long as 40 errands take one after the other, 42 s each
WINDOW = (180.0, 600.0)  # s between the time at which an errand may begin and its deadline
SOON = (120.0, 240.0)  # s likewise of an urgent one, which is not known before
#: Way to order → whether the Executor looks ahead.
WAYS = {"merlin": True, "first due": False, "first come": False}
WALL = 900.0  # s of wall time for a list


class Errand(NamedTuple):
    """A point to check between two times, s from the begin of the day."""

    point: str
    begin: float
    deadline: float
    urgent: bool


def day(floor: Floor, seed: int) -> List[Errand]:
    """Errands in the order in which they may begin, each at a point of its own."""
    chance = random.Random(f"day/{seed}")
    found = []
    for number, point in enumerate(chance.sample(floor.points[1:], TIMED + URGENT)):
        urgent, begin = number >= TIMED, chance.uniform(0.0, DAY)
        found.append(Errand(point, begin, begin + chance.uniform(*(SOON if urgent else WINDOW)), urgent))
    return sorted(found, key=lambda errand: errand.begin)


class Days:
    """Carries out lists of errands in one way."""

    def __init__(self, robot: FloorRobot, way: str) -> None:
        self._robot, self._way = robot, way
        self._sent = threading.Condition()  # guards the requests of the list under way

    def carry_out(self, errands: List[Errand]) -> Dict[str, float]:
        """Percent of the errands, and of the urgent ones, that were done in time; metres and s until the end.

        :raises RuntimeError: the list has no end, or an errand ended in a way that no order explains.
        """
        robot, way = self._robot, self._way
        robot.begin(robot.floor.points[0])
        start, driven = rospy.get_time() + 1.0, robot.base.driven()
        requests: Dict[Errand, ExecutorRequest] = {}
        alarms = []

        def send(errand: Errand) -> None:
            times = {"deadline": rospy.Time.from_sec(start + errand.deadline)}
            if way == "merlin":
                times["not_before"] = rospy.Time.from_sec(start + errand.begin)
                request = robot.send(errand.point, priority=int(errand.urgent), **times)
            elif way == "first due":
                request = robot.send(errand.point, alone=True, **times)
            else:  # its client takes it back when it is late, as the Executor does with a deadline
                request = robot.send(errand.point, alone=True)
                wait = start + errand.deadline - rospy.get_time()
                alarms.append(call_after(wait, request.cancel, "deadline"))
            with self._sent:
                requests[errand] = request
                self._sent.notify_all()

        for errand in errands:
            if way == "merlin" and not errand.urgent:  # known from the morning on
                send(errand)
            else:
                wait = start + errand.begin - rospy.get_time()
                alarms.append(call_after(wait, partial(send, errand), "errand"))
        with self._sent:
            if not self._sent.wait_for(lambda: len(requests) == len(errands), WALL):
                raise RuntimeError(f"sent {len(requests)} of {len(errands)} errands in {WALL:g} s")
        robot.wait("all errands", lambda: robot.ended(*requests.values()) and robot.idle(), limit=WALL)
        for alarm in alarms:
            alarm.shutdown()
        in_time = []
        for errand, request in requests.items():
            result = request.result
            if result is None or result.outcome not in (
                ExecuteResult.SUCCEEDED,
                ExecuteResult.LATE,
                ExecuteResult.CANCELLED,
            ):
                raise RuntimeError(f"an errand did not end as expected: {errand}\n{result}")
            if result.outcome == ExecuteResult.SUCCEEDED:
                in_time.append(errand)
            else:
                print(f"{errand.point} is late: {result.reason}", flush=True)
        urgent = [errand for errand in in_time if errand.urgent]
        return {
            "percent_in_time": 100.0 * len(in_time) / len(errands),
            "percent_of_urgent_in_time": 100.0 * len(urgent) / URGENT,
            "metres": robot.base.driven() - driven,
            "s": max(robot.ends.values()) - start,
        }


def _carried_out(look_ahead: bool, lists: int) -> Dict[str, List[Dict[str, float]]]:
    """The figures of the ways with this Executor, list by list. Once in a process."""
    floor = Floor(TIMED + URGENT + 4)
    done: Dict[str, List[Dict[str, float]]] = {way: [] for way, looks in WAYS.items() if looks is look_ahead}
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as folder, RosMaster() as master:
        floor.write(Path(folder))
        master.set_params({"/use_sim_time": True})
        launch = Path(__file__).with_name("floor.launch")
        master.launch(launch, folder=folder, look_ahead=str(look_ahead).lower())
        rospy.init_node("bench_day", disable_signals=True)
        robot = FloorRobot(floor)
        for seed in range(lists):
            for way, figures in done.items():
                figures.append(Days(robot, way).carry_out(day(floor, seed)))
                print(seed, way, {name: round(value, 1) for name, value in figures[-1].items()}, flush=True)
        robot.clock.stop()
        rospy.signal_shutdown("done")
    return done


def measure() -> Dict[str, Any]:
    """The figures of :class:`Days` for each way."""
    lists = int(os.environ.get("LISTS", 5))
    done: Dict[str, List[Dict[str, float]]] = {}
    for look_ahead in (True, False):
        # A process has one node, and a node one master.
        spawn = multiprocessing.get_context("spawn")
        with concurrent.futures.ProcessPoolExecutor(1, spawn) as pool:
            done.update(pool.submit(_carried_out, look_ahead, lists).result())
    return {
        "day": {
            f"{name} {way}": figure([each[name] for each in figures])
            for way, figures in done.items()
            for name in figures[0]
        }
    }
