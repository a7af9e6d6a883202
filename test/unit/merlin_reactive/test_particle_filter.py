# SPDX-License-Identifier: Apache-2.0
"""Localisation by particles, against a laser computed from the map."""

import math
from pathlib import Path

import numpy as np
import pytest

from merlin_reactive.localization.particle_filter import FilterSettings, Localizer, ParticleFilter
from merlin_reactive.occupancy_grid import OCCUPIED, OccupancyGrid
from merlin_reactive.pose import Pose, wrap
from merlin_sim.robot.lidar import ScanOutlines
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_file import load_world

WORLDS = Path(__file__).resolve().parents[3] / "src" / "merlin_sim" / "worlds"
ANGLES = np.linspace(-math.pi, math.pi, 180, endpoint=False)
LASER = Pose(0.0, 0.0)


@pytest.fixture(scope="module")
def world():
    return load_world(WORLDS / "apartment.yaml")


@pytest.fixture(scope="module")
def outlines(world):
    outlines = ScanOutlines(0.33)
    for solid in [*world.wall_solids(), *world.furniture]:
        outlines.add(solid)
    return outlines


def wander(start, steps):
    """Poses of a robot that drives through the living room."""
    pose = start
    for index in range(steps):
        yield pose
        pose = pose.compose(Pose(0.07, 0.0, 0.09 * math.sin(index / 9)))


def follow(world, outlines, believed, drift=1.03):
    """Runs a filter along a way; returns the final error in m and rad."""
    settings = FilterSettings()
    particles = ParticleFilter(map_of(world), settings, 1, "test")
    if believed is not None:
        particles.believe(believed, 0.2, 0.2)
    localizer = Localizer(particles, settings)
    odometry, last = Pose(7.0, -3.0, 2.0), None
    for truth in wander(Pose(1.2, 2.7, 0.3), 60):
        if last is not None:
            step = last.inverse().compose(truth)
            odometry = odometry.compose(Pose(step.x * drift, step.y, step.yaw * drift))
        last = truth
        ranges = outlines.distances(truth.point, ANGLES + truth.yaw, 10.0)
        localizer.update(odometry, LASER, ANGLES, ranges)
    found = localizer.map_to_odom.compose(odometry)
    return found.distance(last), abs(wrap(found.yaw - last.yaw)), particles


def test_it_follows_a_robot_whose_odometry_drifts(world, outlines):
    error, turn, particles = follow(world, outlines, Pose(1.2, 2.7, 0.3))
    assert error < 0.1 and turn < 0.06
    covariance = particles.estimate()[1]
    assert 0.0 < covariance[0, 0] < 0.05 and np.allclose(covariance, covariance.T)


def test_it_recovers_from_a_wrong_start(world, outlines):
    error, turn, _ = follow(world, outlines, Pose(2.2, 2.2, 1.0))
    assert error < 0.15 and turn < 0.1


def test_it_finds_itself_from_nothing(world, outlines):
    error, turn, _ = follow(world, outlines, None)
    assert error < 0.15 and turn < 0.1


def test_a_standing_robot_changes_nothing(world, outlines):
    settings = FilterSettings()
    localizer = Localizer(ParticleFilter(map_of(world), settings, 1, "test"), settings)
    ranges = outlines.distances((1.2, 2.7), ANGLES, 10.0)
    assert localizer.update(Pose(0.0, 0.0), LASER, ANGLES, ranges)
    assert not localizer.update(Pose(0.01, 0.0), LASER, ANGLES, ranges)
    localizer.restart()
    assert localizer.update(Pose(0.01, 0.0), LASER, ANGLES, ranges)


def test_a_map_without_free_cells_is_refused():
    nowhere = OccupancyGrid(np.full((4, 4), OCCUPIED, dtype=np.int8), 0.05, (0.0, 0.0))
    with pytest.raises(ValueError, match="no cell of the map is free"):
        ParticleFilter(nowhere, FilterSettings(), 1, "test")
