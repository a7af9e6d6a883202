# SPDX-License-Identifier: Apache-2.0
"""What an application does to a running world: placing, walking, carrying, and what is refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from merlin_reactive.pose import Pose
from merlin_sim.engine.simulation import RobotSpec, Simulation
from merlin_sim.engine.world_control import ChangeRefused, Placing
from merlin_sim.people.walkers import WalkState
from merlin_sim.rendering.picture_engine import PictureEngine
from merlin_sim.world.world_file import parse_world

URDF = Path(__file__).resolve().parents[4] / "src" / "merlin_sim" / "urdf" / "rb1.urdf"
CORNERS = [[0, 0], [6, 0], [6, 5], [0, 5]]
START = Pose(1.0, 1.0)
ROOM = {
    "name": "room",
    "walls": [
        *({"from": CORNERS[i], "to": CORNERS[(i + 1) % 4]} for i in range(4)),
        {"from": [3, 2], "to": [3, 5]},
    ],
    "furniture": [
        {"name": "table", "at": [5, 4], "box": [1, 1, 0.7]},
        {"name": "trolley", "at": [2, 1], "box": [0.5, 0.5, 0.8], "mass": 5.0},
        {"name": "chair", "at": [5, 3.1], "box": [0.42, 0.42, 0.8], "mass": 4.0},
    ],
    "objects": [
        {"name": "cup", "class": "cup", "support": "trolley", "at": [0.1, 0.1], "cylinder": [0.04, 0.1]},
        {
            "name": "can",
            "class": "can",
            "support": "table",
            "at": [0, 0],
            "cylinder": [0.03, 0.1],
            "absent": True,
        },
        {"name": "box", "class": "box", "at": [1, 4], "box": [0.3, 0.3, 0.5]},
    ],
    "people": [{"name": "ann", "path": [[1, 2]]}, {"name": "bob", "path": [[4, 1]], "absent": True}],
    "points_of_interest": {},
    "starts": [],
}


@pytest.fixture
def room():
    made = []

    def make(start=START, seed=1):
        made.append(Simulation(parse_world(ROOM), [RobotSpec("", start)], URDF, seed))
        return made[-1]

    yield make
    for simulation in made:
        simulation.close()


def run(simulation, seconds, speed=0.0):
    robot = simulation.robots[""]
    for _ in range(round(seconds * 100)):
        robot.base.command(speed, 0.0, simulation.time)
        simulation.step()


def person(simulation, name):
    return next(walker for walker in simulation.control.people if walker.person.name == name)


def stands(simulation, name):
    placed = simulation.scene.objects[name]
    return placed.thing.solid.pose, placed.thing.bottom


def test_who_is_absent_comes_goes_and_is_seen_only_meanwhile(room):
    simulation = room(Pose(3.5, 1.0))
    robot = simulation.robots[""]
    ahead = len(simulation.scan(robot)) // 2
    assert simulation.scan(robot)[ahead] == pytest.approx(2.45, abs=0.05)
    simulation.control.place(Placing("bob", pose=Pose(5.0, 1.0)))
    assert simulation.scan(robot)[ahead] == pytest.approx(1.28, abs=0.05)
    run(simulation, 6.0, 0.3)
    assert robot.body.pose().x == pytest.approx(5.0 - 0.22 - 0.25, abs=0.03)  # contact is real
    simulation.control.place(Placing("bob", absent=True))
    assert person(simulation, "bob").state is WalkState.ABSENT
    run(simulation, 1.0, 0.3)
    assert robot.body.pose().x > 4.7


def test_a_walk_ends_where_it_should_after_its_time(room):
    simulation = room()
    number = simulation.control.walk("ann", [(1.0, 3.0), (2.0, 3.0)], speed=0.5, yaw=1.0)
    run(simulation, 1.0)
    ann = person(simulation, "ann")
    assert ann.state is WalkState.WALKING and ann.pose.y == pytest.approx(2.5, abs=0.03)
    assert ann.pose.yaw == pytest.approx(math.pi / 2)
    run(simulation, 3.1)
    assert (ann.state, ann.walk) == (WalkState.STANDING, number)
    assert (ann.pose.x, ann.pose.y, ann.pose.yaw) == pytest.approx((2.0, 3.0, 1.0))


def test_a_walk_can_be_replaced_and_stopped(room):
    simulation = room()
    one = simulation.control.walk("ann", [(1.0, 3.0)], speed=0.5)
    run(simulation, 1.0)
    two = simulation.control.walk("ann", [(2.0, 2.5)], speed=0.5)
    run(simulation, 1.0)
    three = simulation.control.walk("ann", [])
    ann = person(simulation, "ann")
    stopped = ann.pose
    run(simulation, 1.0)
    assert one < two < three == ann.walk
    assert ann.state is WalkState.STANDING and ann.pose == stopped and 1.3 < ann.pose.x < 1.7


def test_no_person_walks_through_walls_furniture_or_robots(room):
    simulation = room(Pose(1.0, 3.5))
    simulation.control.walk("ann", [(1.0, 4.6)], speed=1.0)
    run(simulation, 3.0)
    ann = person(simulation, "ann")
    assert ann.state is WalkState.WALKING and ann.waits_for == "robot"
    assert not simulation.robots[""].body.touches()
    assert ann.pose.y == pytest.approx(3.5 - 0.25 - 0.22 - 0.15, abs=0.06)
    simulation.control.walk("ann", [(5.0, 2.5)], speed=1.0)  # the wall at x = 3 ends at y = 2
    run(simulation, 4.0)
    assert ann.waits_for.startswith("wall_") and ann.pose.x < 3.0 - 0.05 - 0.2
    simulation.control.walk("ann", [(2.0, 1.8), (2.0, 0.4)], speed=1.0)
    run(simulation, 4.0)
    assert ann.waits_for == "trolley" and ann.pose.y > 1.25 + 0.2
    simulation.control.place(Placing("trolley", absent=True))
    run(simulation, 2.0)
    assert (ann.state, ann.waits_for) == (WalkState.STANDING, "") and ann.pose.y == pytest.approx(0.4)


def test_a_guest_sits_down_on_a_chair_that_stays_where_it_is_and_gets_up(room):
    simulation = room()
    simulation.control.place(Placing("bob", pose=Pose(4.0, 1.0)))
    simulation.control.walk("bob", [(5.0, 2.0), (5.0, 3.1)], sit=True, yaw=math.pi / 2)
    run(simulation, 6.0)
    bob = person(simulation, "bob")
    assert bob.state is WalkState.SITTING and bob.pose.yaw == pytest.approx(math.pi / 2)
    run(simulation, 2.0)
    assert simulation.scene.furniture["chair"].pose.distance(Pose(5.0, 3.1)) < 0.01
    simulation.control.walk("bob", [(5.0, 2.0)])
    run(simulation, 4.0)
    assert bob.state is WalkState.STANDING
    assert simulation.scene.furniture["chair"].pose.distance(Pose(5.0, 3.1)) < 0.01
    with pytest.raises(ChangeRefused, match="chair is there"):
        simulation.control.walk("bob", [(5.0, 3.1)])
    with pytest.raises(ChangeRefused, match="bob is there"):
        simulation.control.place(Placing("ann", pose=bob.pose))


def test_what_stands_on_furniture_goes_where_it_is_pushed(room):
    simulation = room()
    before, height = stands(simulation, "cup")
    run(simulation, 6.0, 0.3)
    trolley = simulation.scene.furniture["trolley"].pose
    cup, bottom = stands(simulation, "cup")
    assert trolley.x > 2.4
    assert cup.x - before.x == pytest.approx(trolley.x - 2.0, abs=0.05)
    assert bottom == height == 0.8
    assert simulation.physics.place_of("cup").distance(cup) < 0.01
    simulation.control.place(Placing("trolley", pose=Pose(4.5, 1.0, math.pi / 2)))
    assert stands(simulation, "cup")[0].point == pytest.approx((4.4, 1.1))
    simulation.control.place(Placing("trolley", absent=True))
    run(simulation, 0.1)
    with pytest.raises(ChangeRefused, match="trolley, which is absent"):
        simulation.control.place(Placing("can", on="trolley"))


def test_a_robot_carries_what_is_put_on_its_tray(room):
    simulation = room(Pose(0.6, 0.5))
    simulation.control.place(Placing("can", on="robot", pose=Pose(0.05, 0.0)))
    simulation.control.place(Placing("more", kind="cup", on="robot", pose=Pose(-0.05, 0.05)))
    run(simulation, 6.0, 0.3)
    robot = simulation.robots[""].body.pose()
    can, height = stands(simulation, "can")
    assert robot.x == pytest.approx(0.6 + 1.755, abs=0.03)  # nothing holds it back
    assert can.distance(robot.compose(Pose(0.13, 0.0))) < 0.01 and 0.3 < height < 0.6
    assert simulation.physics.place_of("can").distance(can) < 0.01
    simulation.control.place(Placing("can", on="table", pose=Pose(0.2, 0.1)))
    assert stands(simulation, "can") == (Pose(5.2, 4.1), 0.7)


def test_the_same_calls_at_the_same_times_make_the_same_world(room):
    def play(seed):
        simulation = room(Pose(1.0, 3.0, -1.0), seed)
        run(simulation, 0.5)
        simulation.control.place(Placing("cleo", kind="person", pose=Pose(2.0, 3.0)))
        simulation.control.walk("cleo", [(0.5, 2.0)], speed=0.8)
        simulation.control.place(Placing("plate_9", kind="cup", on="trolley", pose=Pose(-0.1, 0.0)))
        run(simulation, 6.0, 0.3)
        where = [walker.pose for walker in simulation.control.people]
        where += [thing.thing.solid.pose for thing in simulation.scene.objects.values()]
        robot = simulation.robots[""]
        return where, robot.body.pose(), robot.odometry.pose, simulation.scan(robot)

    one, two, other = play(3), play(3), play(4)
    assert one[:3] == two[:3] and np.array_equal(one[3], two[3])
    assert not np.array_equal(one[3], other[3])


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (Placing("zoe", pose=Pose(1, 3)), "no person, object or furniture 'zoe'"),
        (Placing("zoe", kind="dragon", pose=Pose(1, 3)), "no kind 'dragon'; known are"),
        (Placing("zoe!", kind="cup", pose=Pose(1, 3)), "is not a name"),
        (Placing("ann", kind="cup", pose=Pose(1, 3)), "ann is person, not cup"),
        (Placing("ann", pose=Pose(3, 4)), "ann cannot be at (3, 4): wall_4_0 is there"),
        (Placing("ann", pose=Pose(1, 1.2)), "robot is there"),
        (Placing("ann", pose=Pose(2.3, 1)), "trolley is there"),
        (Placing("ann", pose=Pose(9, 1)), "outside the walls"),
        (Placing("ann", pose=Pose(math.nan, 1)), "nan is not a place"),
        (Placing("ann", on="table"), "stands on the floor"),
        (Placing("table", pose=Pose(1, 3)), "cannot be moved"),
        (Placing("wall_4_0", kind="cup", pose=Pose(1, 3)), "part of the building"),
        (Placing("chair", pose=Pose(1, 2)), "ann is there"),
        (Placing("chair", pose=Pose(1, 4)), "box is there"),
        (Placing("ann", pose=Pose(1, 4)), "box is there"),
        (Placing("can", on="shelf"), "no such furniture or robot"),
        (Placing("can", on="table", pose=Pose(0.6, 0)), "beside table"),
        (Placing("can", on="robot", pose=Pose(0.3, 0)), "fall off the tray"),
        (Placing("can", on="trolley", pose=Pose(0.1, 0.1)), "cup does"),
        (Placing("can", pose=Pose(5, 4), z=0.2), "table is there"),
        (Placing("can", pose=Pose(1, 3), z=-1.0), "-1 m high"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(room, what, words):
    simulation = room()
    before = (
        simulation.physics.place_of("cup"),
        person(simulation, "ann").pose,
        len(simulation.control.people),
    )
    with pytest.raises(ChangeRefused) as refused:
        simulation.control.place(what)
    assert words in str(refused.value)
    after = simulation.physics.place_of("cup"), person(simulation, "ann").pose, len(simulation.control.people)
    assert before == after and not simulation.scene.objects["can"].there


def test_where_a_person_is_not_is_not_looked_at(room):
    simulation = room()
    simulation.control.place(Placing("ann", absent=True, on="shelf", pose=Pose(math.nan, 9), z=5.0))
    assert person(simulation, "ann").state is WalkState.ABSENT


@pytest.mark.parametrize(
    ("walk", "words"),
    [
        (("zoe", [(1, 3)]), "no person 'zoe'"),
        (("bob", [(1, 3)]), "bob is absent"),
        (("ann", [(1, math.inf)]), "inf is not a number"),
        (("ann", [(1, 3)], 9.0), "9 m/s"),
        (("ann", [(7, 3)]), "outside the walls"),
        (("ann", [(5, 4)]), "table is there"),
    ],
)
def test_impossible_walks_are_refused(room, walk, words):
    with pytest.raises(ChangeRefused) as refused:
        room().control.walk(*walk)
    assert words in str(refused.value)


def test_the_camera_sees_who_and_what_came_at_run_time(room):
    simulation = room(Pose(3.6, 1.0))

    robot, pictures = simulation.robots[""], PictureEngine()

    def picture():
        return pictures.expose(simulation.shot(robot)).astype(int)

    def changed(before):
        return int(np.sum(np.abs(picture() - before).max(axis=-1) > 60))

    empty = picture()
    simulation.control.place(Placing("plate_7", kind="plate", pose=Pose(5.0, 1.0), z=0.7))
    with_plate = changed(empty)
    simulation.control.place(Placing("cleo", kind="person", pose=Pose(5.5, 1.3)))
    with_cleo = changed(empty)
    simulation.control.place(Placing("cleo", absent=True))
    simulation.control.place(Placing("plate_7", absent=True))
    assert 0 == changed(empty) < with_plate - 50 < with_cleo - 500
