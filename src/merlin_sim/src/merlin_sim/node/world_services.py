# SPDX-License-Identifier: Apache-2.0
"""The ROS side of what an application does to the simulated world: ``~place``, ``~walk`` and ``~people``."""

import threading
from typing import Callable

import rospy
from merlin_msgs.msg import SimPeople, SimPerson
from merlin_msgs.srv import (
    PlaceThing,
    PlaceThingRequest,
    PlaceThingResponse,
    WalkPerson,
    WalkPersonRequest,
    WalkPersonResponse,
)

from merlin_reactive.pose import Pose
from merlin_sim.engine.simulation import Simulation
from merlin_sim.engine.world_control import ChangeRefused, Placing
from merlin_sim.people.walkers import Walker, WalkState

WALKING_PERIOD = 20  # physics steps: 5 Hz while a person walks
STANDING_PERIOD = 100  # otherwise


class WorldServices:
    """Serves one simulator.

    :param lock: held while the world continues; the services take it, callers of the methods hold it.
    :param now: the time on the clock.
    :param simulation: of the world as it begins.
    """

    def __init__(self, lock: threading.Lock, now: Callable[[], rospy.Time], simulation: Simulation) -> None:
        self._lock = lock
        self._now = now
        self._published = -1  # changes of the people when they were last published
        self._people = rospy.Publisher("~people", SimPeople, queue_size=10, latch=True)
        self.attach(simulation)
        self._services = [
            rospy.Service("~place", PlaceThing, self._place),
            rospy.Service("~walk", WalkPerson, self._walk),
        ]

    def attach(self, simulation: Simulation) -> None:
        """Speaks of another simulation from now on: the world began anew."""
        self._simulation = simulation
        self._publish(self._now())

    def publish(self, tick: int, stamp: rospy.Time) -> None:
        """Publishes the people when it is time to."""
        control = self._simulation.control
        due = tick % STANDING_PERIOD == 0
        if tick % WALKING_PERIOD == 0 and not due:
            due = any(walker.state is WalkState.WALKING for walker in control.people)
        if due or control.changes != self._published:
            self._publish(stamp)

    def _publish(self, stamp: rospy.Time) -> None:
        control = self._simulation.control
        self._published = control.changes
        message = SimPeople(people=[_person(walker) for walker in control.people])
        message.header.frame_id, message.header.stamp = "map", stamp
        self._people.publish(message)

    def _place(self, request: PlaceThingRequest) -> PlaceThingResponse:
        what = Placing(
            name=request.name,
            kind=request.kind,
            absent=request.absent,
            on=request.on.strip("/"),
            pose=Pose(request.x, request.y, request.yaw),
            z=request.z,
            sit=request.sit,
        )
        with self._lock:
            now = self._now()
            try:
                self._simulation.control.place(what)
            except ChangeRefused as refused:
                return PlaceThingResponse(False, str(refused), now)
            self._publish(now)
        done = "is absent" if what.absent else f"is on {what.on}" if what.on else "is there"
        return PlaceThingResponse(True, f"{what.name} {done}", now)

    def _walk(self, request: WalkPersonRequest) -> WalkPersonResponse:
        path = [(point.x, point.y) for point in request.path]
        with self._lock:
            now = self._now()
            try:
                number = self._simulation.control.walk(
                    request.name, path, request.speed, request.sit, request.yaw if request.turn else None
                )
            except ChangeRefused as refused:
                return WalkPersonResponse(False, str(refused), 0, now)
            self._publish(now)
        text = f"{request.name} walks" if path else f"{request.name} stops"
        return WalkPersonResponse(True, text, number, now)


def _person(walker: Walker) -> SimPerson:
    pose = walker.pose
    return SimPerson(
        walker.person.name, walker.state, pose.x, pose.y, pose.yaw, walker.walk, walker.waits_for
    )
