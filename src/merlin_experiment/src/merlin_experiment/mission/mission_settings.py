# SPDX-License-Identifier: Apache-2.0
"""Parameters of the mission node."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Tuple

from merlin_executor.resending import ON_LOST
from merlin_experiment.mission.real_time_factor import POLICIES
from merlin_experiment.oracle.motion_limits import MotionLimits
from merlin_home.mission_list import MissionTask, make_mission, mission_tasks

Point = Tuple[float, float]
APPROACHES = ("merlin", "naive")


class SettingsError(ValueError):
    """A parameter is missing or wrong; the text says which, why, and what to do."""


@dataclass(frozen=True)
class MissionSettings:
    """What a mission is to do.

    :ivar mission: 1, 2 or 3.
    :ivar approach: merlin or naive, for the records; what runs is decided by the launch file.
    :ivar seed: of the list.
    :ivar cancel_after: s of ROS time.
    :ivar tasks: length of the list; 0: the mission's own.
    :ivar marked_share: of the tasks, 0 to 1.
    :ivar factor: real-time factor asked for.
    :ivar policy: of the factor.
    :ivar results: folder.
    :ivar points: points of interest that the mission visits, frame map, m.
    :ivar limits: of the robot, for the oracle.
    :ivar goal_tolerance: m by which a drive may end before a point of interest.
    :ivar speech_length: s; 0: measured.
    :ivar world_file: of the simulated world, whose exact shapes the oracle uses; None: it uses the map.
    :ivar on_lost: what happens to a task during which the Executor is lost: end, or resend when it is back.
    """

    mission: int
    approach: str
    seed: int
    cancel_after: float
    tasks: int
    marked_share: float
    factor: float
    policy: str
    results: Path
    points: Dict[str, Point]
    limits: MotionLimits
    goal_tolerance: float
    speech_length: float
    world_file: Optional[Path] = None
    on_lost: str = ON_LOST[0]

    @classmethod
    def read(cls, get: Callable[[str, Any], Any], points: Any) -> "MissionSettings":
        """Reads the parameters.

        :param get: returns a parameter by name, or the default.
        :param points: `world/points_of_interest`.
        :raises SettingsError: a parameter is wrong.
        """
        defaults = MotionLimits()
        settings = cls(
            mission=_whole(get, "mission", 1),
            approach=_one_of(get, "approach", APPROACHES),
            seed=_whole(get, "seed", 1),
            cancel_after=_number(get, "cancel_after", 10.0, above=0.0),
            tasks=_whole(get, "tasks", 0),
            marked_share=_number(get, "marked_share", 0.5),
            factor=_number(get, "real_time_factor", 1.0),
            policy=_one_of(get, "rtf_policy", POLICIES),
            results=Path(str(get("results", "results"))).expanduser().absolute(),
            points=_chosen(_points(points), str(get("points", "")).split()),
            limits=MotionLimits(
                speed=_number(get, "limits/speed", defaults.speed, above=0.0),
                acceleration=_number(get, "limits/acceleration", defaults.acceleration, above=0.0),
                turn_rate=_number(get, "limits/turn_rate", defaults.turn_rate, above=0.0),
                turn_acceleration=_number(
                    get, "limits/turn_acceleration", defaults.turn_acceleration, above=0.0
                ),
                radius=_number(get, "limits/radius", defaults.radius),
            ),
            goal_tolerance=_number(get, "goal_tolerance", 0.1),
            speech_length=_number(get, "speech_length", 0.0),
            world_file=_file(str(get("world_file", ""))),
            on_lost=_one_of(get, "on_lost", ON_LOST),
        )
        settings.make_list()
        return settings

    def make_list(self) -> List[MissionTask]:
        """Makes the tasks of the mission, in their order."""
        try:
            count = self.tasks or mission_tasks(self.mission)
            return make_mission(list(self.points), count, self.seed, self.marked_share)
        except ValueError as error:
            raise SettingsError(str(error)) from error

    def columns(self) -> Dict[str, Any]:
        """The columns of runs.csv that are settings."""
        return {
            "mission": self.mission,
            "approach": self.approach,
            "seed": self.seed,
            "real_time_factor": self.factor,
            "rtf_policy": self.policy,
            "cancel_after": self.cancel_after,
            "marked_share": self.marked_share,
        }


def _number(get: Callable[[str, Any], Any], name: str, default: float, above: float = -math.inf) -> float:
    value = get(name, default)
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise SettingsError(f"parameter ~{name} is {value!r}; give a number") from None
    if not math.isfinite(number) or number < 0.0 or number <= above:
        least = "more than 0" if above == 0.0 else "0 or more"
        raise SettingsError(f"parameter ~{name} is {number:g}; give {least}")
    return number


def _whole(get: Callable[[str, Any], Any], name: str, default: int) -> int:
    number = _number(get, name, default)
    if number != int(number):
        raise SettingsError(f"parameter ~{name} is {number:g}; give a whole number")
    return int(number)


def _one_of(get: Callable[[str, Any], Any], name: str, choices: Tuple[str, ...]) -> str:
    value = get(name, choices[0])
    if value not in choices:
        raise SettingsError(f"parameter ~{name} is {value!r}; give one of {', '.join(choices)}")
    return str(value)


def _chosen(points: Dict[str, Point], names: List[str]) -> Dict[str, Point]:
    unknown = [name for name in names if name not in points]
    if unknown:
        raise SettingsError(
            f"parameter ~points: the world has no {', '.join(unknown)}; it has {', '.join(sorted(points))}"
        )
    return {name: points[name] for name in names or points}


def _file(path: str) -> Optional[Path]:
    if path and not Path(path).is_file():
        raise SettingsError(f"parameter ~world_file: there is no file {path}; empty: the oracle uses the map")
    return Path(path) if path else None


def _points(points: Any) -> Dict[str, Point]:
    try:
        return {name: (float(entry["x"]), float(entry["y"])) for name, entry in dict(points).items()}
    except (KeyError, TypeError, ValueError):
        raise SettingsError(
            "parameter world/points_of_interest has to map names to x, y (m) and yaw (rad); "
            "load a world with the launch argument world:="
        ) from None
