# SPDX-License-Identifier: Apache-2.0
"""One guest: comes, follows the robot, orders, eats and leaves."""

import contextlib
import math
import re
from typing import Any, List, Optional, Sequence

import rospy
from merlin_msgs.msg import GuestEvent

from merlin_guests.house import House, tray_of
from merlin_guests.places import Places, Point
from merlin_guests.schedule import CHAIR, DISTURBANCES, LEAVES, UNCLEAR, WALKS_OFF, GuestPlan
from merlin_guests.stage import PlayError, Stage
from merlin_restaurant.menu import call_from, listed

CALL_EVERY = 25.0  # s between two calls for the robot
PATIENCE = 900.0  # s that a guest waits for a table, for the waiter or for the order
KEPT = 0.9  # m that a following guest keeps from the robot
LOOK = 0.6  # s between two looks at where the robot is now
SAID_AGAIN = 30.0  # s after which a guest says again that it cannot come in
STRANDED = 40.0  # s without the robot moving on, after which a following guest goes back to the entrance
FAR, LEFT_BEHIND = 4.0, 15.0  # m from the robot, and s of it, after which the same holds
HELD_UP = 3.0  # s after which a guest that cannot walk on looks for another way
SEAT, LOST = "please take a seat", "have lost you"  # what the robot says to a following guest
MUMBLED = ("the weather was lovely by the lake", "my uncle has seven little dogs")
ASKED = "what would you like"
TALKING = 90.0  # s after a question in which a guest does not call the robot
CHAIR_NAME = "chair_5"
BLOCKED = (1.6, 1.2, 1.4)  # m before the table where the chair may stand
GOES_AFTER = 12.0  # s after ordering in which an impatient guest leaves


class Guest:
    """Plays one plan. :meth:`play` returns when the guest has left."""

    def __init__(self, plan: GuestPlan, stage: Stage, places: Places, house: House) -> None:
        self.plan = plan
        self.table = plan.table
        self.seated = False
        self._name = plan.name
        self._stage = stage
        self._places = places
        self._house = house

    def play(self) -> None:
        """Lives through the evening.

        :raises Closed: the restaurant closed early.
        """
        if self.table:
            seat, yaw = self._places.seat(self.table)
            self._stage.put_person(self._name, seat, yaw, sit=True)
            self._publish(GuestEvent.CAME)
            self._seat()
        else:
            self._stage.wait(self.plan.comes)
            self._come_in()
            if not self._get_a_table():
                return
        if self._order() and self._be_served():
            self._stage.wait(self.plan.eating)
            self._house.empty(self.table)
            self._leave("content")
            if self.plan.cleared:
                self._stage.wait(self.plan.cleared)
                self._house.take(self.table)
                self._stage.publish(GuestEvent.CLEARED, table=self.table)

    # --- coming --------------------------------------------------------------------------------------------

    def _come_in(self) -> None:
        stage, places = self._stage, self._places
        while True:
            try:
                stage.put_person(self._name, places.door)
                break
            except PlayError as error:
                rospy.logwarn_throttle(SAID_AGAIN, f"players: {self._name} cannot come in yet: {error}")
            stage.wait(LOOK)
        self._publish(GuestEvent.CAME)
        self._go_to_waiting_place()

    def _go_to_waiting_place(self) -> None:
        self._walk_to(self._house.join_queue(self._name), 120.0, yaw=math.pi)
        self._stage.answer(self._name, {"would you like a table": "yes please"})

    def _get_a_table(self) -> bool:
        stage, came = self._stage, self._stage.now()
        while stage.now() - came < PATIENCE:
            stage.forget(self._name)
            if stage.call("good evening we would like a table", self._name):
                self._publish(GuestEvent.CALLED)
            said = stage.hear(self._name, "follow me to", CALL_EVERY)
            if not said:
                continue
            found = re.search(r"table \d+", said)
            if found is None:
                continue
            self._house.leave_queue(self._name)
            guide = stage.speaker(self._name)
            if WALKS_OFF in self.plan.disturbances:
                return self._walk_off(guide)
            if self._follow(guide):
                self.table = found.group().replace(" ", "_")
                self._sit_down()
                return True
            self._go_to_waiting_place()
        self._leave("waited too long for a table")
        return False

    def _follow(self, guide: str = "", limit: float = STRANDED) -> bool:
        """Walks behind a robot until it offers a seat; False: it stands, or guides this guest no more."""
        stage, name = self._stage, self._name
        moved, last = stage.now(), stage.robot(guide)
        near = moved
        joined = max(0, stage.trail_length(guide) - 1)
        before: Optional[Point] = None
        stuck = False
        while True:
            said = stage.hear(name, (SEAT, LOST), LOOK, by=guide)
            if said:
                return SEAT in said
            here, robot = stage.position(name), stage.robot(guide)
            if math.dist(here, robot) < FAR:
                near = stage.now()
            elif stage.now() - near > LEFT_BEHIND:
                return False
            if math.dist(robot, last) > 0.1:
                moved, last = stage.now(), robot
            elif stage.now() - moved > limit:
                return False
            if math.dist(here, robot) <= KEPT + 0.1:
                before, stuck = None, False
                continue
            # Where the robot has just passed a table, a person may not: then round it, until it is reached.
            stuck = stuck or here == before
            before = here
            steps = [point for point in stage.trail(joined, guide) if math.dist(point, robot) > KEPT]
            ahead = [] if stuck else _not_yet_walked(steps, here)
            self._walk_as_far(ahead or self._places.way_near(here, robot, KEPT))

    def _walk_as_far(self, way: Sequence[Point]) -> None:
        """Walks to the last place of a way that is free: the robot passes tables closer than people stand."""
        for end in range(len(way), 0, -1):
            with contextlib.suppress(PlayError):
                self._stage.walk(self._name, way[:end], self.plan.pace)
                return

    def _walk_off(self, guide: str) -> bool:
        self._disturb(WALKS_OFF)
        stage, begun = self._stage, self._stage.now()
        while stage.now() - begun < 5.0:
            here, robot = stage.position(self._name), stage.robot(guide)
            if math.dist(here, robot) > KEPT + 0.1:
                self._walk_as_far(self._places.way_near(here, robot, KEPT))
            stage.wait(LOOK)
        self._leave("walked off before there was a table")
        return False

    def _sit_down(self) -> None:
        stage = self._stage
        seat, yaw = self._places.seat(self.table)
        if not self._walk_to(seat, 60.0, sit=True, yaw=yaw):
            stage.put_person(self._name, seat, yaw, sit=True)
        self._seat()

    def _seat(self) -> None:
        self.seated = True
        self._publish(GuestEvent.SEATED)

    # --- eating --------------------------------------------------------------------------------------------

    def _order(self) -> bool:
        """Orders when the robot asks; calls it when it does not come."""
        stage, order = self._stage, listed(self.plan.order)
        wish = " and ".join(f"a {item}" for item in self.plan.order)
        understood = {
            ASKED: f"{wish} please",
            f"would like {order}\\. is that right": "yes please",
            "is that right": "no",
        }
        answers = [understood]
        if UNCLEAR in self.plan.disturbances:
            self._disturb(UNCLEAR)
            answers = [*({**understood, ASKED: mumbled} for mumbled in MUMBLED), understood]
        self._stage.answer(self._name, answers.pop(0))
        stage.forget(self._name)
        repeated = f"would like {order}. is that right"
        begun, quiet = stage.now(), self.plan.thinking
        while stage.now() - begun < PATIENCE:
            said = stage.hear(self._name, (ASKED, repeated), quiet)
            if repeated in said:
                self._publish(GuestEvent.ORDERED, items=self.plan.order)
                return True
            if said:
                quiet = TALKING
                if answers:
                    self._stage.answer(self._name, answers.pop(0))
            else:
                if stage.call(call_from(self.table), self._name):
                    self._publish(GuestEvent.CALLED)
                quiet = CALL_EVERY
        self._leave("waited too long for the waiter")
        return False

    def _be_served(self) -> bool:
        stage = self._stage
        if LEAVES in self.plan.disturbances:
            self._disturb(LEAVES)
            stage.wait(GOES_AFTER)
            self._leave("left before the order came")
            return False
        if CHAIR in self.plan.disturbances:
            self._disturb(CHAIR)
            self._block_the_way()
        if not stage.hear(self._name, "here is your", PATIENCE):
            self._leave("waited too long for the order")
            return False
        brought = self._house.take(tray_of(stage.speaker(self._name)))
        self._house.put(self.table, brought)
        self._publish(GuestEvent.SERVED, items=brought)
        return True

    def _block_the_way(self) -> None:
        for distance in BLOCKED:
            with contextlib.suppress(PlayError):  # a person stands there: the next place then
                self._stage.move_furniture(CHAIR_NAME, self._places.on_the_way(self.table, "bar", distance))
                return

    def tray_is_loaded(self, items: Sequence[str]) -> None:
        """Learns what comes, so that the answer to the robot's question can be true."""
        right = sorted(items) == sorted(self.plan.order)
        self._stage.answer(self._name, {"is everything right": "yes thank you" if right else "no thank you"})

    def _leave(self, reason: str) -> None:
        stage, places = self._stage, self._places
        self.seated = False
        self._house.leave_queue(self._name)
        self._publish(GuestEvent.LEFT, reason=reason)
        self._stage.answer(self._name, {})
        self._walk_to(places.door, 90.0)
        stage.remove(self._name)

    def _walk_to(self, goal: Point, limit: float, **manner: Any) -> bool:
        """Walks somewhere, round the robot and round what turns out to be in the way.

        :param limit: s for it.
        :param manner: how to end there, as :meth:`Stage.walk` takes it.
        :return: whether the guest arrived in time.
        """
        stage, name = self._stage, self._name
        end = stage.now() + limit
        found: List[Point] = []

        def begin() -> int:
            way = self._places.way_round(stage.robots(), found, stage.position(name), goal)
            return stage.walk(name, way, self.plan.pace, **manner)

        walk = begin()
        while not stage.arrived(name, walk, min(HELD_UP, end - stage.now())):
            if stage.now() >= end:
                return False
            thing = stage.in_the_way(name)
            if thing is not None:
                found.append(thing)
                with contextlib.suppress(PlayError):
                    walk = begin()
        return True

    def _disturb(self, kind: str) -> None:
        self._publish(GuestEvent.DISTURBED, reason=DISTURBANCES[kind])

    def _publish(
        self, event: int, items: Sequence[str] = (), reason: str = "", table: Optional[str] = None
    ) -> None:
        self._stage.publish(event, self._name, self.table if table is None else table, items, reason)


def _not_yet_walked(steps: Sequence[Point], here: Point) -> List[Point]:
    """The part of a trail that lies ahead of its place nearest to a point."""
    if not steps:
        return []
    nearest = min(range(len(steps)), key=lambda number: math.dist(steps[number], here))
    return list(steps[nearest + 1 :])
