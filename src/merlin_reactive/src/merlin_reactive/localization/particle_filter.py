# SPDX-License-Identifier: Apache-2.0
"""Monte Carlo localisation: where on the map the scans and the odometry of a robot make sense.

After Thrun, Burgard and Fox, *Probabilistic Robotics* (2005): a likelihood field for the laser, odometry
motion noise, low-variance resampling, and new particles when the scans fit worse than they used to.
"""

import math
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from merlin_reactive.distance_field import distance_field
from merlin_reactive.occupancy_grid import FREE, OCCUPIED, OccupancyGrid, hit_points
from merlin_reactive.pose import Pose, wrap
from merlin_reactive.seeded_random import draw

VAGUE = 10  # times sigma, from which on a hit is an outlier, however far it is
SEARCH = 5  # times as many guesses when nothing is known


@dataclass(frozen=True)
class FilterSettings:
    """m, rad, s where not said otherwise."""

    particles: int = 350
    beams: int = 48  # of a scan that are looked at
    sigma: float = 0.10  # of a hit beside an obstacle of the map
    outliers: float = 0.15  # part of the beams that hit what is not on the map
    informative: float = 0.4  # weight of one beam: they are not independent witnesses
    distance_noise: float = 0.08  # per metre driven
    turn_noise: float = 0.08  # per radian turned
    turn_per_metre: float = 0.04  # rad per metre driven
    jitter: Tuple[float, float] = (0.004, 0.003)  # per update: m, rad
    update_distance: float = 0.05  # driven before the next scan is used
    update_turn: float = 0.05
    lost: float = 0.6  # part of its usual value to which the fit of the scans falls when the robot is lost
    poor: float = 0.55  # fit, of 1, that is too bad in any case
    guesses: int = 3000  # poses that are tried at once when it is lost
    injected: float = 0.10  # part of the particles that guesses replace


class ParticleFilter:
    """Believes in poses. Used by one thread at a time.

    :param grid: unknown cells have no influence.
    :raises ValueError: no cell of it is free.
    """

    def __init__(self, grid: OccupancyGrid, settings: FilterSettings, seed: int, name: str) -> None:
        self.grid = grid
        self._settings = settings
        self._seed, self._name = seed, name + "/particles"
        seen = math.ceil(VAGUE * settings.sigma / grid.resolution)
        self._distance = distance_field(grid.cells != OCCUPIED, seen) * np.float32(grid.resolution)
        self._free = np.argwhere(grid.cells == FREE)
        if not len(self._free):
            raise ValueError("no cell of the map is free: there is nowhere a robot could be")
        self._draws = 0
        self._usual_fit = 0.0  # slow average of how well the scans fit, per beam
        self._recent_fit = 0.0  # fast average
        self.poses = np.zeros((settings.particles, 3))
        self.weights = np.full(settings.particles, 1.0 / settings.particles)
        self.scatter()

    def scatter(self) -> None:
        """Believes in every free place of the map alike."""
        self.poses = self._anywhere(self._settings.particles)
        self.weights.fill(1.0 / len(self.weights))
        self._usual_fit = self._recent_fit = 0.0
        self._scattered = True

    def believe(self, pose: Pose, xy: float, yaw: float) -> None:
        """Believes in poses around one, with standard deviations in m and rad."""
        spread = self._random().standard_normal((self._settings.particles, 3)) * (xy, xy, yaw)
        self.poses = np.array([pose.x, pose.y, pose.yaw]) + spread
        self.weights.fill(1.0 / len(self.weights))
        self._usual_fit = self._recent_fit = 0.0
        self._scattered = False

    def move(self, step: Pose) -> None:
        """Moves every particle by what odometry says, each with an error of its own.

        :param step: of the robot, in its frame before the step.
        """
        settings = self._settings
        errors = self._random().standard_normal((len(self.poses), 3))
        driven, turned = math.hypot(step.x, step.y), abs(step.yaw)
        length = 1.0 + settings.distance_noise * errors[:, 0]
        yaw = self.poses[:, 2] + settings.turn_per_metre * driven * errors[:, 1]
        cos, sin = np.cos(yaw), np.sin(yaw)
        self.poses[:, 0] += length * (cos * step.x - sin * step.y)
        self.poses[:, 1] += length * (sin * step.x + cos * step.y)
        self.poses[:, 2] = yaw + step.yaw + settings.turn_noise * turned * errors[:, 2]
        self.poses += self._random().standard_normal(self.poses.shape) * (
            settings.jitter[0],
            settings.jitter[0],
            settings.jitter[1],
        )

    def see(self, mount: Pose, angles: np.ndarray, ranges: np.ndarray) -> None:
        """Weighs the particles by a scan.

        :param mount: of the laser on the robot.
        :param angles: of the rays (rad), ranges in m, infinite where nothing was hit.
        """
        points = self._beams(mount, angles, ranges)
        if len(points) < 10:
            return
        if self._scattered:
            self._scattered = False
            self._search(points)
        fits = self._fits(self.poses, points)
        weights = self.weights * np.exp(self._settings.informative * len(points) * (fits - fits.max()))
        self.weights = weights / weights.sum()
        fit = float(np.exp(self.weights @ fits))
        self._usual_fit += (0.02 if self._usual_fit else 1.0) * (fit - self._usual_fit)
        self._recent_fit += (0.3 if self._recent_fit else 1.0) * (fit - self._recent_fit)
        if 1.0 / np.square(self.weights).sum() < 0.5 * len(self.weights):
            self._resample()
        if self._recent_fit < max(self._settings.lost * self._usual_fit, self._settings.poor):
            self._guess(points)

    def estimate(self) -> Tuple[Pose, np.ndarray]:
        """The mean of the heaviest cluster and its covariance (3 x 3: x, y, yaw)."""
        best = self.poses[np.argmax(self.weights)]
        near = np.hypot(*(self.poses[:, :2] - best[:2]).T) < 0.7
        near &= np.abs(_wrapped(self.poses[:, 2] - best[2])) < 0.7
        weights = self.weights[near] / self.weights[near].sum()
        offsets = self.poses[near] - best
        offsets[:, 2] = _wrapped(offsets[:, 2])
        mean = weights @ offsets
        spread = offsets - mean
        covariance = (weights[:, None] * spread).T @ spread
        # What lies outside the cluster is doubt, too.
        covariance += (1.0 - self.weights[near].sum()) * np.eye(3)
        return Pose(best[0] + mean[0], best[1] + mean[1], wrap(best[2] + mean[2])), covariance

    def _beams(self, mount: Pose, angles: np.ndarray, ranges: np.ndarray) -> np.ndarray:
        """The ends of some beams in the robot's frame."""
        hit = np.flatnonzero(np.isfinite(ranges))
        if len(hit) > self._settings.beams:
            hit = hit[np.linspace(0, len(hit) - 1, self._settings.beams).astype(int)]
        return hit_points(mount, angles[hit], ranges[hit])

    def _fits(self, poses: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Mean logarithm of the beams' likelihoods at each pose, 0 at best."""
        cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        x = poses[:, :1] + cos * points[:, 0] - sin * points[:, 1]
        y = poses[:, 1:2] + sin * points[:, 0] + cos * points[:, 1]
        columns = ((x - self.grid.origin[0]) / self.grid.resolution).astype(int)
        rows = ((y - self.grid.origin[1]) / self.grid.resolution).astype(int)
        height, width = self._distance.shape
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        distance = np.where(inside, self._distance[rows % height, columns % width], 1.0)
        outliers = self._settings.outliers
        likelihood = (1 - outliers) * np.exp(-((distance / self._settings.sigma) ** 2) / 2) + outliers
        fits = np.log(likelihood).mean(axis=1)
        # The robot cannot stand in a wall.
        own = np.clip(((poses[:, 1] - self.grid.origin[1]) / self.grid.resolution).astype(int), 0, height - 1)
        across = np.clip(
            ((poses[:, 0] - self.grid.origin[0]) / self.grid.resolution).astype(int), 0, width - 1
        )
        return fits - (self._distance[own, across] < 0.1)

    def _resample(self) -> None:
        count = len(self.poses)
        places = (np.arange(count) + self._random().random()) / count
        chosen = np.minimum(np.searchsorted(np.cumsum(self.weights), places), count - 1)
        self.poses = self.poses[chosen]
        self.weights.fill(1.0 / count)

    def _search(self, points: np.ndarray) -> None:
        """Draws the particles from many more poses, by how well one scan fits there."""
        guesses = self._anywhere(SEARCH * self._settings.guesses)
        fits = self._fits(guesses, points)
        weights = np.exp(self._settings.informative * len(points) * (fits - fits.max()) / 2)
        random = self._random()
        self.poses = guesses[random.choice(len(guesses), len(self.poses), p=weights / weights.sum())]

    def _guess(self, points: np.ndarray) -> None:
        """Replaces the lightest particles by the best of many guesses, as heavy as their fit deserves."""
        guesses = self._anywhere(self._settings.guesses)
        fits = self._fits(guesses, points)
        count = max(1, round(self._settings.injected * len(self.poses)))
        best = np.argsort(fits)[-count:]
        worst = np.argsort(self.weights)[:count]
        self.poses[worst] = guesses[best]
        self.weights[worst] = 1.0 / len(self.weights)
        self.weights /= self.weights.sum()

    def _anywhere(self, count: int) -> np.ndarray:
        random = self._random()
        cells = self._free[random.integers(0, len(self._free), count)]
        x, y = self.grid.point(0, 0)
        return np.stack(
            [
                x + (cells[:, 1] + random.random(count) - 0.5) * self.grid.resolution,
                y + (cells[:, 0] + random.random(count) - 0.5) * self.grid.resolution,
                random.uniform(-math.pi, math.pi, count),
            ],
            axis=1,
        )

    def _random(self) -> np.random.Generator:
        self._draws += 1
        return draw(self._seed, self._name, self._draws)


def _wrapped(angles: np.ndarray) -> np.ndarray:
    return np.arctan2(np.sin(angles), np.cos(angles))


class Localizer:
    """A particle filter fed with odometry poses and scans, as they come."""

    def __init__(self, filter: ParticleFilter, settings: FilterSettings) -> None:
        self.filter = filter
        self._settings = settings
        self._odometry: Optional[Pose] = None
        self.map_to_odom = Pose(0.0, 0.0)

    def update(self, odometry: Pose, mount: Pose, angles: np.ndarray, ranges: np.ndarray) -> bool:
        """Takes a scan made at an odometry pose; returns whether it was used."""
        if self._odometry is not None:
            step = self._odometry.inverse().compose(odometry)
            moved = math.hypot(step.x, step.y) >= self._settings.update_distance
            if not moved and abs(step.yaw) < self._settings.update_turn:
                return False
            self.filter.move(step)
        self._odometry = odometry
        self.filter.see(mount, angles, ranges)
        self.map_to_odom = self.filter.estimate()[0].compose(odometry.inverse())
        return True

    def restart(self) -> None:
        """Uses the next scan, wherever the robot is."""
        self._odometry = None
