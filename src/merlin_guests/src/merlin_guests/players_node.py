# SPDX-License-Identifier: Apache-2.0
"""Node `players`: guests and barman of the simulated restaurant, which follow a seeded schedule."""

import sys
import threading
import traceback
from typing import List, Optional, Sequence, Union

import rospy
from merlin_msgs.msg import GuestEvent
from rospy.core import is_shutdown_requested

from merlin_guests.barman import NAME as BARMAN
from merlin_guests.barman import Barman
from merlin_guests.guest import CHAIR_NAME, Guest
from merlin_guests.house import BAR, House
from merlin_guests.places import ENTRANCE_DOOR, Places
from merlin_guests.schedule import DISTURBANCES, TABLES, GuestPlan, ScheduleError, make_schedule
from merlin_guests.stage import Closed, PlayError, Stage
from merlin_ros.deadline import LONGEST_SLEEP
from merlin_ros.node import init_node, spin
from merlin_ros.parameters import ParameterError, number, whole
from merlin_ros.service_proxy import ServiceError
from merlin_ros.work.threads import start_thread
from merlin_sim.world.world_file import WorldError, find_world, load_world
from merlin_sim.world.world_model import World


def restaurant_world(name: str) -> World:
    """Loads a world in which a restaurant can be played.

    :param name: a world file, or the name of one of merlin_sim.
    :raises WorldError: when it cannot be read, or lacks what the players use.
    """
    path = find_world(name)
    world = load_world(path)
    missing = _missing(world)
    if missing:
        raise WorldError(f"{path} is not a restaurant: it has no {', no '.join(missing)}")
    return world


def _missing(world: World) -> List[str]:
    furniture = [solid.name for solid in (*world.furniture, *world.unmapped)]
    needed = (
        ("door", [ENTRANCE_DOOR], [door.name for door in world.doors]),
        ("piece of furniture", [BAR, *TABLES, CHAIR_NAME], furniture),
        ("person", [BARMAN], [person.name for person in world.people]),
        ("point of interest", ["entrance", "bar", *TABLES], world.points_of_interest),
    )
    return [f"{what} {name!r}" for what, names, there in needed for name in names if name not in there]


STARTUP = 60.0  # s of wall time for the simulator and the voices
LISTENED = 20.0  # s of running time to wait for a subscriber of the events


class Players:
    """All persons of the restaurant.

    :param stage: on which they play.
    :param things: objects that the world file has for other purposes.
    :param guests, barman: the persons.
    """

    def __init__(self, stage: Stage, things: Sequence[str], guests: Sequence[Guest], barman: Barman) -> None:
        self._stage = stage
        self._things = things
        self._guests = guests
        self._barman = barman
        self._failure = ""

    def run(self) -> int:
        """Plays the evening; returns the exit code."""
        rospy.on_shutdown(self._stage.close)
        try:
            missing = self._stage.ready(STARTUP)
            if missing:
                raise PlayError(missing)
            if not self._stage.wait_for_subscriber(LISTENED):
                rospy.logwarn(
                    f"players: restaurant/guests has no subscriber after {LISTENED:g} s; begins anyway"
                )
            self._clear_the_room()
        except (PlayError, ServiceError) as error:
            if is_shutdown_requested():
                return 0
            rospy.logfatal(f"players: {error}")
            return 1
        barman = self._start(self._barman, BARMAN)
        threads = [self._start(guest, guest.plan.name) for guest in self._guests]
        _wait_for(*threads)
        if self._failure or rospy.is_shutdown():
            return 1 if self._failure else 0
        self._stage.publish(GuestEvent.CLOSED)
        spin()
        self._stage.close()
        _wait_for(barman)
        return 0

    def _start(self, player: Union[Guest, Barman], name: str) -> threading.Thread:
        def play() -> None:
            try:
                player.play()
            except Closed:
                pass
            except Exception as error:  # without one of its players a play would never end
                if is_shutdown_requested():
                    return  # the shutdown takes services and topics away
                self._failure = f"{name}: {error}"
                why = error if isinstance(error, PlayError) else traceback.format_exc()
                rospy.logfatal(f"players: {name} cannot continue: {why}")
                self._stage.close()

        return start_thread(name, play)

    def _clear_the_room(self) -> None:
        """Removes the persons and objects that the world file has for other purposes."""
        for name in self._stage.people():
            if name != BARMAN:
                self._stage.remove(name)
        for thing in self._things:
            self._stage.remove(thing)


def _wait_for(*threads: threading.Thread) -> None:
    for thread in threads:
        while thread.is_alive():  # not one long wait: a signal just before it would be handled behind it
            thread.join(LONGEST_SLEEP)


def make_players(
    world: World, plans: Sequence[GuestPlan], seed: int, wrong_share: float, robots: Sequence[str] = ("",)
) -> Players:
    """The persons of an evening.

    :param world: of the restaurant.
    :param plans: of the guests.
    :param seed: of the barman's mistakes.
    :param wrong_share: of the orders that the barman gets wrong at first.
    :param robots: their namespaces.
    """
    stage = Stage(robots)
    counter = next(solid for solid in world.furniture if solid.name == BAR)
    places = Places(world)
    house = House(stage, places, counter.pose.point)
    guests = [Guest(plan, stage, places, house) for plan in plans]

    def guest_at(table: str) -> Optional[Guest]:
        return next((guest for guest in guests if guest.seated and guest.table == table), None)

    barman = Barman(stage, house, seed, wrong_share, guest_at)
    return Players(stage, [thing.name for thing in world.objects], guests, barman)


def _disturbances() -> Union[int, List[str]]:
    """How many, or which: ``leaves,chair`` or a list."""
    given = rospy.get_param("~disturbances", len(DISTURBANCES))
    if isinstance(given, (bool, int, float)):
        return whole("~disturbances", len(DISTURBANCES))
    return [str(kind) for kind in given] if isinstance(given, list) else str(given).replace(",", " ").split()


def _share(name: str, default: float) -> float:
    value = number(name, default, 0.0)
    if value > 1.0:
        raise ParameterError(f"parameter {name} is {value:g}, more than 1")
    return value


def _world() -> World:
    name = str(rospy.get_param("~world", ""))
    if not name:
        raise ParameterError("parameter ~world is missing: a world file, or the name of one of merlin_sim")
    return restaurant_world(name)


def main() -> int:
    """Entry point of the node; returns the exit code."""
    init_node("players")
    try:
        world, seed = _world(), whole("~seed", 1)
        wrong_share = _share("~wrong_share", 0.25)
        haste = number("~haste", 1.0, 0.0)
        robots = [str(name) for name in rospy.get_param("~robots", None) or [""]]
        plans = make_schedule(whole("~guests", 6), seed, _disturbances(), haste)
    except (ParameterError, ScheduleError, WorldError) as error:
        print(f"players: {error}", file=sys.stderr)
        return 2
    return make_players(world, plans, seed, wrong_share, robots).run()
