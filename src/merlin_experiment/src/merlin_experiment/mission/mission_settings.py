# SPDX-License-Identifier: Apache-2.0
"""Parameters of the mission node."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

import rospy

from merlin_executor.resending import ON_LOST
from merlin_experiment.mission.real_time_factor import POLICIES
from merlin_experiment.oracle.motion_limits import MotionLimits
from merlin_experiment.records.task_record import SETTINGS
from merlin_home.mission_list import MissionTask, make_mission, mission_tasks
from merlin_ros.parameters import ParameterError, choice, number, whole

Point = Tuple[float, float]
APPROACHES = ("merlin", "naive")
#: Least cancel time (s), speed, acceleration and radius: what is no time and no motion has no oracle.
LEAST = 0.001


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
    def read(cls) -> "MissionSettings":
        """Reads the parameters of the node, and `world/points_of_interest`.

        :raises ParameterError: a parameter is wrong.
        """
        usual = asdict(MotionLimits())
        settings = cls(
            mission=whole("~mission", 1),
            approach=choice("~approach", APPROACHES),
            seed=whole("~seed", 1),
            cancel_after=number("~cancel_after", 10.0, LEAST),
            tasks=whole("~tasks", 0, 0),
            marked_share=number("~marked_share", 0.5, 0.0),
            factor=number("~real_time_factor", 1.0, 0.0),
            policy=choice("~rtf_policy", POLICIES),
            results=Path(str(rospy.get_param("~results", "results"))).expanduser().absolute(),
            points=_chosen(_points(), str(rospy.get_param("~points", "")).split()),
            limits=MotionLimits(**{name: number(f"~limits/{name}", usual[name], LEAST) for name in usual}),
            goal_tolerance=number("~goal_tolerance", 0.1, 0.0),
            speech_length=number("~speech_length", 0.0, 0.0),
            world_file=_file(str(rospy.get_param("~world_file", ""))),
            on_lost=choice("~on_lost", ON_LOST),
        )
        settings.make_list()
        return settings

    def make_list(self) -> List[MissionTask]:
        """Makes the tasks of the mission, in their order."""
        try:
            count = self.tasks or mission_tasks(self.mission)
            return make_mission(list(self.points), count, self.seed, self.marked_share)
        except ValueError as error:
            raise ParameterError(str(error)) from error

    def columns(self) -> Dict[str, Any]:
        """The columns of runs.csv that are settings."""
        values = (self.mission, self.approach, self.seed, self.factor, self.policy)
        return dict(zip(SETTINGS, (*values, self.cancel_after, self.marked_share)))


def _chosen(points: Dict[str, Point], names: List[str]) -> Dict[str, Point]:
    unknown = [name for name in names if name not in points]
    if unknown:
        raise ParameterError(
            f"parameter ~points: the world has no {', '.join(unknown)}; it has {', '.join(sorted(points))}"
        )
    return {name: points[name] for name in names or points}


def _file(path: str) -> Optional[Path]:
    if path and not Path(path).is_file():
        raise ParameterError(
            f"parameter ~world_file: there is no file {path}; empty: the oracle uses the map"
        )
    return Path(path) if path else None


def _points() -> Dict[str, Point]:
    points = rospy.get_param("world/points_of_interest", {})
    try:
        return {name: (float(entry["x"]), float(entry["y"])) for name, entry in dict(points).items()}
    except (KeyError, TypeError, ValueError):
        raise ParameterError(
            "parameter world/points_of_interest has to map names to x, y (m) and yaw (rad); "
            "load a world with the launch argument world:="
        ) from None
