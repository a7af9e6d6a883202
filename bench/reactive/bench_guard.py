# SPDX-License-Identifier: Apache-2.0
"""What the velocity guard adds to the way of a command, and how fast it stops the base.

The benchmark is navigation, its client and the base in one process; the guard is another.
"""

import itertools
import threading
import time
from typing import Any, Dict, List

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from geometry_msgs.msg import Twist
from measuring.figures import figure
from measuring.ros_process import RosMaster
from merlin_msgs.msg import Lease
from std_srvs.srv import Trigger

RATE = 20.0  # commands per s, those of a controller
COMMANDS = 1000
DIRECT = 300
STOPS = 50
LIMIT = 10.0  # s for anything to happen
GOAL = "bench-goal"


class Bench:
    """Navigation, client and base around a guard."""

    def __init__(self) -> None:
        self._arrived = threading.Condition()  # guards the field below
        self._velocities: List[float] = []
        self._commands = rospy.Publisher("cmd_vel_in", Twist, tcp_nodelay=True, queue_size=10)
        self._direct = rospy.Publisher("direct", Twist, tcp_nodelay=True, queue_size=10)
        self._status = rospy.Publisher("move_base/status", GoalStatusArray, tcp_nodelay=True, queue_size=10)
        self._lease = rospy.Publisher("move_base/lease", Lease, tcp_nodelay=True, queue_size=10)
        self._subscribers = [
            rospy.Subscriber(topic, Twist, self._receive, tcp_nodelay=True) for topic in ("cmd_vel", "direct")
        ]
        self._numbers = itertools.count(1)
        self._goal = GOAL
        self._held = True
        threading.Thread(target=self._beat, name="status and lease", daemon=True).start()

    def wait_for_guard(self) -> None:
        end = time.monotonic() + LIMIT * 3
        while not self.round_trip(self._commands, 0.05):
            if time.monotonic() > end:
                raise RuntimeError("no command passes the guard")

    def latencies(self, publisher: rospy.Publisher, count: int) -> List[float]:
        """Times of commands to the base, ms, at the rate of a controller."""
        times = []
        for _ in range(count):
            begin = time.monotonic()
            if not self.round_trip(publisher, LIMIT):
                raise RuntimeError("a command was lost")
            times.append((time.monotonic() - begin) * 1e3)
            time.sleep(max(0.0, 1 / RATE - (time.monotonic() - begin)))
        return times

    def through_guard(self, count: int) -> List[float]:
        return self.latencies(self._commands, count)

    def past_guard(self, count: int) -> List[float]:
        return self.latencies(self._direct, count)

    def round_trip(self, publisher: rospy.Publisher, limit: float) -> bool:
        """Sends a velocity and waits for it; False when it, or any motion, did not arrive."""
        velocity = Twist()
        velocity.linear.x = next(self._numbers) * 1e-6  # identifies the command, and is within all limits
        with self._arrived:
            self._velocities.clear()
            publisher.publish(velocity)
            return self._arrived.wait_for(lambda: velocity.linear.x in self._velocities, limit)

    def stop_times(self, count: int) -> List[float]:
        """Times from a lease that suspends the goal to the zero velocity, ms."""
        times = []
        for _ in range(count):
            self._hold(True)
            self.wait_for_guard()
            begin = time.monotonic()
            self._hold(False)
            with self._arrived:
                if not self._arrived.wait_for(lambda: self._velocities[-1:] == [0.0], LIMIT):
                    raise RuntimeError("the guard did not stop the base")
            times.append((time.monotonic() - begin) * 1e3)
        return times

    def _hold(self, held: bool) -> None:
        self._held = held
        self._send_lease()

    def _send_lease(self) -> None:
        suspended = [] if self._held else [self._goal]
        self._lease.publish(Lease(owner="/bench", life="1", held=[self._goal], suspended=suspended))

    def _beat(self) -> None:
        while not rospy.is_shutdown():
            goal = GoalStatus(goal_id=GoalID(rospy.Time.now(), self._goal), status=GoalStatus.ACTIVE)
            self._status.publish(GoalStatusArray(status_list=[goal]))
            self._send_lease()
            time.sleep(0.15)

    def _receive(self, velocity: Twist) -> None:
        with self._arrived:
            self._velocities.append(velocity.linear.x)
            self._arrived.notify_all()


def measure() -> Dict[str, Any]:
    with RosMaster() as master:
        master.node("merlin_guard", "guard", "merlin_guard")
        master.wait_for_service("/merlin/halt")
        rospy.init_node("bench", disable_signals=True)
        rospy.wait_for_service("merlin/release", LIMIT)
        rospy.ServiceProxy("merlin/release", Trigger)()
        bench = Bench()
        bench.wait_for_guard()
        while not bench.round_trip(bench._direct, 0.05):
            pass
        direct = bench.past_guard(DIRECT)
        guarded = bench.through_guard(COMMANDS)
        stops = bench.stop_times(STOPS)
        rospy.signal_shutdown("done")
    added = figure(guarded)
    base = figure(direct)
    return {
        "guard_latency_ms": added,
        "guard_direct_ms": base,
        "guard_added_ms": round(added["median"] - base["median"], 4),
        "guard_suspend_to_zero_ms": figure(stops),
    }
