# SPDX-License-Identifier: Apache-2.0
"""The physics behind the robot: limits, odometry, contact, sensors, repeatability."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from merlin_reactive.pose import Pose
from merlin_sim.engine.simulation import RobotSpec, Simulation
from merlin_sim.rendering.picture_engine import PictureEngine
from merlin_sim.robot.camera import CameraModel
from merlin_sim.robot.diff_drive import OdometryNoise
from merlin_sim.robot.lidar import ScanOutlines
from merlin_sim.world.world_file import load_world
from merlin_sim.world.world_model import DoorEvent, MoveEvent, Person, Solid

PACKAGE = Path(__file__).resolve().parents[4] / "src" / "merlin_sim"
URDF = PACKAGE / "urdf" / "rb1.urdf"


@pytest.fixture(scope="module")
def apartment():
    return load_world(PACKAGE / "worlds" / "apartment.yaml")


@pytest.fixture
def simulate(apartment):
    made = []

    def make(*starts, seed=1, world=apartment, **spec):
        specs = [RobotSpec(f"r{i}", start, **spec) for i, start in enumerate(starts)]
        made.append(Simulation(world, specs, URDF, seed))
        return made[-1]

    yield make
    for simulation in made:
        simulation.close()


def run(simulation, seconds, *commands):
    """Steps with a constant command per robot; returns the fastest change of speed seen, m/s²."""
    robots = list(simulation.robots.values())
    speeds = [robots[0].body.velocity()[0]]
    for _ in range(round(seconds * 100)):
        for robot, command in zip(robots, commands):
            robot.base.command(*command, simulation.time)
        simulation.step()
        speeds.append(robots[0].body.velocity()[0])
    # Over a tenth of a second: a single step shows the solver, not the robot.
    return max(abs(b - a) / 0.1 for a, b in zip(speeds, speeds[10:]))


def test_it_begins_on_its_wheels(simulate):
    simulation = simulate(Pose(0.6, 3.4))
    body = simulation.robots["r0"].body
    before = body.camera_pose().position
    run(simulation, 1.0)
    after = body.camera_pose().position
    assert after[2] == pytest.approx(before[2], abs=0.002)
    assert after == pytest.approx(before, abs=0.006)  # it leans on its casters by a hair
    assert before[2] == pytest.approx(1.40, abs=0.002)


def test_it_drives_as_commanded_within_its_limits(simulate):
    simulation = simulate(Pose(0.6, 3.4))
    robot = simulation.robots["r0"]
    acceleration = run(simulation, 5.0, (0.3, 0.0))
    assert robot.body.velocity()[0] == pytest.approx(0.3, abs=0.01)
    assert acceleration < 1.15
    # 5 s at 0.3 m/s less the ramp of 0.3 s.
    assert robot.body.pose().x - 0.6 == pytest.approx(1.5 - 0.045, abs=0.02)
    assert robot.body.pose().y == pytest.approx(3.4, abs=0.01)
    run(simulation, 0.5, (0.0, 0.0))
    stood = robot.body.pose()
    run(simulation, 5.0, (0.0, 0.0))
    assert robot.body.pose().distance(stood) < 0.002


def test_commands_beyond_the_limits_are_cut_and_nonsense_stops(simulate):
    simulation = simulate(Pose(0.6, 3.4))
    robot = simulation.robots["r0"]
    run(simulation, 2.0, (9.0, 0.0))
    assert robot.body.velocity()[0] == pytest.approx(1.0, abs=0.05)
    run(simulation, 1.5, (math.nan, 0.0))
    assert robot.body.velocity()[0] == pytest.approx(0.0, abs=0.01)


def test_odometry_is_good_without_noise_and_bounded_with_it(simulate):
    for noise, bound in ((OdometryNoise(), 0.03), (OdometryNoise(0.0, 0.0, 0.005, 0.005), 0.15)):
        simulation = simulate(Pose(1.6, 2.6), odometry_noise=noise)
        robot = simulation.robots["r0"]
        for _ in range(4):
            run(simulation, 3.0, (0.3, 0.0))
            run(simulation, 0.5, (0.0, 0.0))
            run(simulation, math.pi / 2, (0.0, 1.0))
            run(simulation, 0.75, (0.0, 0.0))
        truth = Pose(1.6, 2.6).inverse().compose(robot.body.pose())
        assert robot.distance > 3.3
        assert truth.distance(robot.odometry.pose) < bound


def test_a_wall_stops_it(simulate):
    simulation = simulate(Pose(8.0, 3.55))
    robot = simulation.robots["r0"]
    run(simulation, 4.0, (0.7, 0.0))
    assert robot.body.touches()
    assert robot.body.pose().x < 8.95 - 0.24


def test_a_thing_with_mass_is_pushed_and_never_passed_through(apartment, simulate):
    chair = Solid("chair", Pose(4.0, 3.5), 0.9, size=(0.4, 0.4), mass=4.0)
    simulation = simulate(Pose(3.0, 3.5), world=dataclasses.replace(apartment, unmapped=[chair]))
    robot = simulation.robots["r0"]
    ahead = len(simulation.scan(robot)) // 2
    assert simulation.scan(robot)[ahead] == pytest.approx(0.8, abs=0.05)
    closest = math.inf
    for _ in range(60):
        run(simulation, 0.1, (0.3, 0.0))
        closest = min(closest, simulation.physics.place_of("chair").x - robot.body.pose().x)
    pushed = simulation.physics.place_of("chair")
    assert pushed.x > 4.2 and abs(pushed.y - 3.5) < 0.3
    assert closest > 0.25 + 0.2 - 0.03
    assert simulation.scan(robot)[ahead] == pytest.approx(0.25, abs=0.08)  # seen where it is now


def test_robots_bump_into_each_other_and_see_each_other(simulate):
    simulation = simulate(Pose(3.0, 3.5), Pose(4.0, 3.5))
    one, two = simulation.robots.values()
    ahead = len(simulation.scan(one)) // 2
    assert simulation.scan(one)[ahead] == pytest.approx(0.75, abs=0.05)
    run(simulation, 3.0, (0.4, 0.0), (0.0, 0.0))
    assert two.body.pose().x > 4.0
    assert two.body.pose().x - one.body.pose().x > 0.49


def test_robots_are_in_each_others_pictures(simulate):
    simulation = simulate(Pose(3.0, 3.5), Pose(4.5, 3.5), camera=CameraModel(64, 48, noise=0.0))
    one, two = simulation.robots.values()
    pictures = PictureEngine()
    with_it = pictures.expose(simulation.shot(one))
    two.body.place(Pose(1.0, 3.5))
    changed = (pictures.expose(simulation.shot(one)) != with_it).any(axis=2)
    assert changed[:, 24:40].mean() > 0.1  # straight ahead
    assert not changed[:, :16].any() and not changed[:, 48:].any()


def test_equal_seeds_give_equal_runs_whoever_looks(simulate):
    def trace(seed, look):
        noise = OdometryNoise(0.01, 0.01, 0.005, 0.005)
        simulation = simulate(Pose(2.6, 3.4), seed=seed, odometry_noise=noise)
        robot = simulation.robots["r0"]
        for tick in range(300):
            robot.base.command(0.3, 0.2, simulation.time)
            simulation.step()
            if look and tick % 7 == 0:
                simulation.scan(robot)
        return robot.odometry.pose, simulation.scan(robot)

    pose, scan = trace(1, look=False)
    again, same = trace(1, look=True)
    other, different = trace(2, look=False)
    assert pose == again and np.array_equal(scan, same)
    assert pose != other and not np.array_equal(scan, different)


def test_rays_meet_boxes_and_cylinders_exactly():
    outlines = ScanOutlines(0.3)
    outlines.add(Solid("box", Pose(2.0, 0.0, math.pi / 4), 1.0, size=(1.0, 1.0)))
    outlines.add(Solid("post", Pose(0.0, -3.0), 1.0, radius=0.5))
    outlines.add(Solid("mat", Pose(-1.0, 0.0), 0.1, size=(1.0, 1.0)))
    angles = np.array([0.0, -math.pi / 2, math.pi, math.pi / 2])
    expected = [2.0 - math.sqrt(0.5), 2.5, math.inf, math.inf]
    assert outlines.distances((0.0, 0.0), angles, 10.0) == pytest.approx(expected)
    outlines.remove("box")
    assert outlines.distances((0.0, 0.0), angles, 10.0, [(0.0, 2.0, 0.5)]) == pytest.approx(
        [math.inf, 2.5, math.inf, 1.5]
    )
    assert np.isinf(outlines.distances((0.0, 0.0), angles, 2.0)).all()


def test_the_world_changes_when_its_time_has_come(apartment, simulate):
    world = dataclasses.replace(
        apartment,
        events=[DoorEvent(1.0, "dorm_door", False), MoveEvent(2.0, "plant", Pose(4.8, 3.4))],
        people=[Person("ann", ((1.0, 2.6), (2.0, 2.6)), speed=0.5, delay=1.0)],
    )
    simulation = simulate(Pose(2.95, 3.4, math.pi / 2), world=world)
    robot = simulation.robots["r0"]
    ahead = len(simulation.scan(robot)) // 2
    run(simulation, 0.9)
    assert simulation.scan(robot)[ahead] > 1.5
    run(simulation, 1.2)
    assert simulation.scan(robot)[ahead] == pytest.approx(0.95, abs=0.05)
    assert simulation.scan(robot)[ahead - 90] == pytest.approx(1.65, abs=0.05)
    run(simulation, 0.5)
    ann = simulation.scene.outlines._solids["ann"].pose
    assert ann.x == pytest.approx(1.0 + 0.5 * 1.6, abs=0.05)


def test_a_door_that_waits_holds_nothing_else_up(apartment, simulate):
    door = apartment.doors[0]
    middle = Pose((door.start[0] + door.end[0]) / 2, (door.start[1] + door.end[1]) / 2)
    thing = apartment.furniture[0]
    there = Pose(thing.pose.x + 0.01, thing.pose.y)
    events = [
        DoorEvent(0.1, door.name, False),
        DoorEvent(0.2, door.name, True),
        MoveEvent(0.2, thing.name, there),
    ]
    simulation = simulate(middle, world=dataclasses.replace(apartment, events=events))
    run(simulation, 0.5)
    assert simulation.scene.furniture[thing.name].pose == there
    assert simulation.scene.is_there(thing.name) and not simulation.scene.is_there(door.name)


def test_a_door_waits_for_a_robot_and_a_polite_person_stops(apartment, simulate):
    world = dataclasses.replace(
        apartment,
        events=[DoorEvent(0.5, "dorm_door", False)],
        people=[Person("ann", ((1.2, 3.4), (2.95, 4.3)), speed=1.0)],
    )
    simulation = simulate(Pose(2.95, 4.3), world=world)
    robot = simulation.robots["r0"]
    run(simulation, 4.0)
    assert not robot.body.touches()
    assert robot.body.pose().distance(Pose(2.95, 4.3)) < 0.01
    assert "dorm_door" not in simulation.scene.outlines._solids
