# SPDX-License-Identifier: Apache-2.0
"""Which robot goes first, where the other waits, and where it goes aside to."""

import math

import numpy as np
import pytest
from matrices import meeting_matrix

from merlin_reactive.navigation.giving_way import Given, GivingWay
from merlin_reactive.navigation.path_planner import PathPlanner
from merlin_reactive.navigation.refuge import nearest_refuge
from merlin_reactive.navigation.right_of_way import ANNOUNCED, STEP, RightOfWay, RobotWay
from merlin_reactive.occupancy_grid import OccupancyGrid
from merlin_reactive.pose import Pose

RADIUS = 0.25


def line(start, end):
    count = min(ANNOUNCED, round(math.dist(start, end) / STEP) + 1)
    return np.array(start) + np.outer(
        np.arange(count) * STEP / math.dist(start, end), np.subtract(end, start)
    )


def robot(name, start, end, **fields):
    return RobotWay(name, Pose(*start), RADIUS, line(start, end), **fields)


def rules(name, *others):
    made = RightOfWay(name, RADIUS)
    for other in others:
        made.note(other, 0.0)
    return made


def names(found):
    return [other.name for other in found]


def test_the_first_name_goes_first_unless_it_is_the_other_that_is_cornered():
    ann, carl = robot("ann", (0, 0), (3, 0)), robot("carl", (3, 0), (0, 0))
    bob = rules("bob", ann, carl)
    assert names(bob.first(0.0)) == ["ann"]
    bob.cornered = True
    assert names(bob.first(0.0)) == []
    bob.note(robot("ann", (0, 0), (3, 0), cornered=True), 0.0)
    assert names(bob.first(0.0)) == ["ann"]
    bob.cornered = False
    bob.note(robot("carl", (3, 0), (0, 0), cornered=True), 0.0)
    assert names(bob.first(0.0)) == ["ann", "carl"]


def test_a_robot_that_finds_no_way_is_the_last_unless_it_is_cornered():
    lost = RobotWay("ann", Pose(0, 0), RADIUS, np.array([(0.0, 0.0)]))
    bob = rules("bob", lost, robot("carl", (3, 0), (0, 0)))
    assert names(bob.first(0.0)) == []
    bob.astray = True
    assert names(bob.first(0.0)) == ["carl", "ann"]
    bob.cornered = True
    assert names(bob.first(0.0)) == []


def test_of_another_way_that_part_counts_on_which_that_robot_does_not_wait_itself():
    ann, bob = robot("ann", (2, -2), (2, 2)), robot("bob", (0, 0), (4, 0))
    ways = {other.name: other.way for other in rules("carl", ann, bob).first(0.0)}
    assert ways["ann"][-1] == pytest.approx((2, 2))
    assert 2.0 - 2 * RADIUS - 0.4 < ways["bob"][-1][0] < 2.0 - 2 * RADIUS
    # Beyond the crossing nothing comes yet, so a robot may stand there.
    assert not rules("carl", ann, bob).look((3.5, 0), line((3.5, 0), (4, 0)), 0.0).aside
    aside = robot("bob", (0, 0), (4, 0), aside=True)  # it waits for none
    (_, whole) = rules("carl", ann, aside).first(0.0)
    assert whole.way[-1] == pytest.approx((4, 0))


def test_a_robot_that_is_silent_or_has_ended_its_drive_is_not_known():
    bob = rules("bob", robot("ann", (0, 0), (3, 0)), robot("bob", (9, 9), (8, 8)))
    assert names(bob.others(1.0)) == ["ann"]  # not itself
    assert names(bob.others(2.0)) == []
    bob.note(robot("ann", (0, 0), (3, 0)), 2.0)
    bob.note(robot("ann", (0, 0), (3, 0), driving=False), 2.0)
    assert names(bob.others(2.0)) == [] and not len(bob.bodies(2.0))


def test_robots_that_come_and_go_leave_nothing():
    mine = rules("b")
    for number in range(1000):
        mine.note(robot(f"a{number}", (0.0, 0.0), (1.0, 0.0)), float(number))
    assert [other.name for other in mine.others(999.0)] == ["a998", "a999"]
    assert len(mine._ways) == 2


def test_at_a_crossing_one_waits_before_the_others_way():
    across, along = ((2, -2), (2, 2)), ((0, 0), (4, 0))
    bob = rules("bob", robot("ann", *across))
    meeting = bob.look(along[0], line(*along), 0.0)
    assert (meeting.robot, meeting.aside) == ("ann", False)
    assert 2.0 - 2 * RADIUS - 0.4 < meeting.room < 2.0 - 2 * RADIUS
    ann = rules("ann", robot("bob", *along))
    assert math.isinf(ann.look(across[0], line(*across), 0.0).room)


def test_it_goes_on_where_it_is_through_before_the_other_comes():
    bob = rules("bob", robot("ann", (2, -3.5), (2, 2)))
    assert math.isinf(bob.look((1.4, 0), line((1.4, 0), (4, 0)), 0.0).room)


@pytest.mark.parametrize(("ahead", "room"), [(1.5, (0.6, 1.1)), (-1.5, (math.inf, math.inf))])
def test_a_robot_in_the_same_direction_is_followed_and_one_behind_is_not_waited_for(ahead, room):
    bob = rules("bob", robot("ann", (ahead, 0), (6, 0)))
    meeting = bob.look((0, 0), line((0, 0), (5, 0)), 0.0)
    assert room[0] <= meeting.room <= room[1] and not meeting.aside


def test_who_stands_in_the_way_goes_aside_and_who_was_passed_waits():
    along = line((2, 0), (0, 0))
    coming = rules("bob", robot("ann", (0, 0), (4, 0))).look((2, 0), along, 0.0)
    assert coming.room == 0.0 and coming.aside
    leaving = rules("bob", robot("ann", (2, 0.6), (5, 0.6))).look((2, 0), line((2, 0), (5, 0)), 0.0)
    assert leaving.room == 0.0 and not leaving.aside


def corridor(length=6.0, room=2.0):
    """A corridor of 1 m along y = 0 that ends in a room beyond `length`."""
    cells = np.full((80, 200), 100, dtype=np.int8)
    cells[30:50, 2 : 2 + int(length / 0.05)] = 0
    if room:
        cells[10:70, 2 + int(length / 0.05) : 2 + int((length + room) / 0.05)] = 0
    return PathPlanner(OccupancyGrid(cells, 0.05, (-0.1, -2.0)), RADIUS, 0.05)


def test_it_goes_back_to_where_the_other_can_pass():
    ann = robot("ann", (2, 0), (7.8, 0))
    place = nearest_refuge(corridor(), (4, 0), [ann], [ann], np.zeros((0, 2)))
    assert place is not None
    assert place[0] > 6.0 and abs(place[1]) > 2 * RADIUS
    full = np.array([(x, y) for x in (6.3, 6.8, 7.3, 7.7) for y in (-1.0, -0.6, 0.6, 1.0)])
    assert nearest_refuge(corridor(), (4, 0), [ann], [ann], full) is None
    behind = robot("carl", (5, 0), (4.5, 0))
    assert nearest_refuge(corridor(), (4, 0), [ann], [ann, behind], np.zeros((0, 2))) is None


def test_a_robot_that_goes_after_it_makes_room_on_its_way_aside():
    nothing = np.zeros((0, 2))
    ann, carl = robot("ann", (2, 0), (7.8, 0)), robot("carl", (5, 0), (0.4, 0))
    bob = GivingWay(rules("bob", ann, carl), corridor())
    way = line((4, 0), (0.4, 0))
    assert bob.step(Pose(4, 0), way, nothing, 0.0).replan and bob.refuge is not None
    place = bob.refuge
    assert place[0] > 6.0 and not bob.rules.cornered  # past carl
    around, before = bob.bodies(0.0)
    assert len(around) == 2 * len(before)
    # Of carl it is asked what is asked of bob by ann.
    coming = robot("bob", (4, 0), place, aside=True)
    last = GivingWay(rules("carl", ann, coming), corridor())
    assert last.step(Pose(5, 0), line((5, 0), (0.4, 0)), nothing, 0.0).replan
    assert last.refuge is not None and math.dist(last.refuge, place) > 2 * RADIUS


def test_a_cornered_robot_says_so_and_goes_first_until_the_meeting_is_over():
    planner = corridor(room=0.0)
    bob = GivingWay(rules("bob", robot("ann", (1, 0), (5.5, 0))), planner)
    way = line((4, 0), (0.4, 0))
    given = bob.step(Pose(4, 0), way, np.zeros((0, 2)), 0.0)
    assert given.room == 0.0 and given.robot == "ann"
    assert bob.rules.cornered and bob.refuge is None
    assert math.isinf(bob.step(Pose(4, 0), way, np.zeros((0, 2)), 0.1).room)
    bob.rules.note(robot("ann", (1, 0), (5.5, 0), driving=False), 0.2)
    bob.step(Pose(4, 0), way, np.zeros((0, 2)), 0.2)
    assert not bob.rules.cornered


def test_it_waits_aside_until_the_other_has_passed_and_counts_the_time():
    bob = GivingWay(rules("bob", robot("ann", (1, 0), (7.8, 0))), corridor())
    nothing = np.zeros((0, 2))
    given = bob.step(Pose(4, 0), line((4, 0), (0.4, 0)), nothing, 0.0)
    assert given.replan and bob.refuge is not None
    there = bob.refuge
    bob.rules.note(robot("ann", (3, 0), (7.8, 0)), 5.0)
    assert bob.step(Pose(*there), line(there, (0.4, 0)), nothing, 5.0).replan and bob.refuge is None
    given = bob.step(Pose(*there), line(there, (0.4, 0)), nothing, 5.1)
    assert given.room < 1.0 and given.waited == pytest.approx(5.1)
    bob.rules.note(robot("ann", (7.8, 0), (7.9, 0)), 12.0)
    assert math.isinf(bob.step(Pose(*there), line(there, (0.4, 0)), nothing, 12.0).room)


# Of three, one that went aside for the first finds no way on: the third comes out of the corridor.
# Of four at a crossing the place to go aside to is where another one stands.
@pytest.mark.parametrize(
    ("case", "robots", "seed"),
    [
        ("corridor", 2, 1),
        ("crossing", 4, 5),
        pytest.param("corridor", 3, 2, marks=pytest.mark.long),
        pytest.param("crossing", 4, 9, marks=pytest.mark.long),
    ],
)
def test_simulated_robots_change_places(case, robots, seed):
    result, _ = meeting_matrix.trial(case, robots, seed)
    assert result.solved, (result.texts, result.collisions)


def test_it_says_why_it_stands_also_when_no_robot_comes():
    assert Given(robot="ann").reason == "gives way to robot ann"
    assert Given(replan=True).reason == "finds no way past the other robots"
