"""A ``move_base`` without a robot: it commands velocities and nothing moves. For tests only."""

import threading

import rospy
from geometry_msgs.msg import Twist
from move_base_msgs.msg import MoveBaseAction

from merlin_actions.testing.simulated_action_server import SimulatedActionServer, behaviour_from_params
from merlin_sm.node import run_node


class SimulatedBase:
    """Publishes a forward velocity while a goal runs, and zero at once when it ends or is cancelled."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # orders the velocities; guards _driving
        self._driving = False
        self._publisher = rospy.Publisher("cmd_vel", Twist, queue_size=10)
        self._server = SimulatedActionServer(
            "move_base", MoveBaseAction, behaviour_from_params(), self._drive, self._halt
        )

    def start(self) -> None:
        """Begins to serve."""
        self._server.start()

    def shutdown(self) -> None:
        """Halts and stops serving."""
        self._server.shutdown()

    def _drive(self) -> None:
        with self._lock:
            self._driving = True
            forward = Twist()
            forward.linear.x = 0.3
            self._publisher.publish(forward)

    def _halt(self) -> None:
        with self._lock:
            if self._driving:
                self._driving = False
                self._publisher.publish(Twist())


def main() -> int:
    """Runs the node, with the parameters of a behaviour; returns the exit code."""
    return run_node("simulated_base", _start, ValueError)


def _start() -> None:
    base = SimulatedBase()
    rospy.on_shutdown(base.shutdown)
    base.start()
