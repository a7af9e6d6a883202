# SPDX-License-Identifier: Apache-2.0
"""A ``move_base`` without a robot: it commands velocities and nothing moves. For tests only.

``~hold`` (std_srvs/SetBool): whether the next drive lasts until it is cancelled. One that is held now ends.
The answer's message is the velocity of that drive, m/s: no other has it, so a late command of another drive
is known.
"""

import threading

import rospy
from geometry_msgs.msg import Twist
from move_base_msgs.msg import MoveBaseAction
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from merlin_actions.testing.simulated_action_server import SimulatedActionServer, behaviour_from_params
from merlin_ros.node import run_node
from merlin_ros.publishing import publish
from merlin_ros.work.threads import start_thread

PERIOD = 0.1  # s of wall time between two commands, as a slow controller sends them
SPEED = 0.3  # m/s of a drive that ends by itself
STEP = 0.001  # m/s by which each drive that is held is faster than the one before


class SimulatedBase:
    """Publishes a forward velocity while a goal runs, and zero at once when it ends or is cancelled."""

    def __init__(self) -> None:
        self._changed = threading.Condition()  # orders the velocities; guards the fields below
        self._driving = False
        self._over = False
        self._held_speed = SPEED
        self._publisher = rospy.Publisher("cmd_vel", Twist, queue_size=10)
        self._server = SimulatedActionServer(
            "move_base", MoveBaseAction, behaviour_from_params(), self._drive, self._halt
        )

    def start(self) -> None:
        """Begins to serve."""
        start_thread("commands", self._command)
        self._server.start()
        rospy.Service("~hold", SetBool, self._hold)

    def shutdown(self) -> None:
        """Halts and stops serving."""
        self._server.shutdown()
        with self._changed:
            self._over = True
            self._changed.notify_all()

    def _hold(self, request: SetBoolRequest) -> SetBoolResponse:
        with self._changed:
            if request.data:
                self._held_speed += STEP
            speed = self._held_speed
        self._server.hold(request.data)
        return SetBoolResponse(success=True, message=repr(speed))

    def _drive(self) -> None:
        with self._changed:
            self._driving = True
            self._changed.notify_all()

    def _halt(self) -> None:
        with self._changed:
            if self._driving:
                self._driving = False
                publish(self._publisher, Twist())

    def _command(self) -> None:
        """Repeats the velocity: a base stops when no command comes."""
        forward = Twist()
        with self._changed:
            while not self._over:
                if self._driving:
                    forward.linear.x = self._held_speed if self._server.held else SPEED
                    publish(self._publisher, forward)
                self._changed.wait(PERIOD if self._driving else None)


def main() -> int:
    """Runs the node, with the parameters of a behaviour; returns the exit code."""
    return run_node("simulated_base", _start, ValueError)


def _start() -> None:
    base = SimulatedBase()
    rospy.on_shutdown(base.shutdown)
    base.start()
