# SPDX-License-Identifier: Apache-2.0
"""What is made of a mission when it is over: the oracle's figures, the tables, the plot."""

from pathlib import Path
from typing import Dict, List, Optional, Sequence

import numpy as np

from merlin_experiment.mission.mission_settings import MissionSettings, Point
from merlin_experiment.mission.progress_view import closing_lines
from merlin_experiment.mission.speech_length import speech_length
from merlin_experiment.oracle.oracle import Oracle
from merlin_experiment.oracle.outlines import outlines_of_map, outlines_of_world
from merlin_experiment.oracle.shortest_path import NoPathError, ShortestPaths
from merlin_experiment.records.path_plot import MapPicture, plot_path
from merlin_experiment.records.result_files import write_run
from merlin_experiment.records.task_record import RunRecord
from merlin_experiment.records.trajectory import Sample
from merlin_reactive.speech.speech_synthesizer import SoundError
from merlin_sim.world.world_file import WorldError, load_world


class MissionResults:
    """The results of one run."""

    def __init__(self, settings: MissionSettings, run: RunRecord) -> None:
        self._settings = settings
        self._run = run
        self._picture: Optional[MapPicture] = None
        self._way: Sequence[Sample] = ()
        self._notes: List[str] = []

    def add_map(self, occupied: np.ndarray, resolution: float, origin: Point, way: Sequence[Sample]) -> None:
        """Adds the oracle's figures to the records, and makes the plot possible.

        :param occupied: obstacles of the map; row = y, column = x.
        :param resolution: edge of a cell, m.
        :param origin: map coordinates of the outer corner of cell (0, 0), m.
        :param way: where the robot was from the first goal on.
        """
        self._picture = MapPicture(occupied, resolution, origin)
        self._way = way
        settings = self._settings
        try:
            if settings.world_file is not None:
                outlines = outlines_of_world(load_world(settings.world_file))
            else:
                outlines = outlines_of_map(occupied, resolution, origin)
            oracle = Oracle(
                ShortestPaths(outlines, settings.limits.radius),
                settings.limits,
                settings.speech_length or speech_length(),
                settings.goal_tolerance,
            )
            for record in self._run.tasks:
                if record.start is None:
                    continue
                x, y, yaw = record.start
                limit = settings.cancel_after if record.task.marked else float("inf")
                best = oracle.task((x, y), yaw, settings.points[record.task.poi], limit, record.motion)
                record.oracle_time, record.oracle_distance = best.time, best.distance
        except (SoundError, NoPathError, WorldError) as error:
            self._notes.append(f"no oracle: {error}")

    def write(self) -> List[str]:
        """Writes the files; returns the lines for the screen.

        :raises OSError: the folder of the results cannot be written.
        """
        paths = write_run(self._settings.results, self._run)
        if self._picture is not None:
            paths["path.png"] = self._plot(self._picture)
            paths["track.npz"] = self._save_track(self._picture)
        return closing_lines(self._run, paths.values(), self._notes)

    def _save_track(self, picture: MapPicture) -> Path:
        """The map, and the way as rows of s, m, m, rad, m/s, rad/s: what other figures are drawn from."""
        path = self._settings.results / "track.npz"
        np.savez_compressed(
            path,
            way=np.array(self._way, dtype=np.float32).reshape(-1, len(Sample._fields)),
            occupied=picture.occupied,
            resolution=picture.resolution,
            origin=np.array(picture.origin),
            names=np.array(list(self._settings.points)),
            points=np.array(list(self._settings.points.values())),
        )
        return path

    def _plot(self, picture: MapPicture) -> Path:
        settings = self._settings
        path = settings.results / "path.png"
        by_task: Dict[int, Sample] = {}
        begin = self._way[0].time if self._way else 0.0
        for record in self._run.tasks:
            if record.cancel_sent is not None:
                before = [sample for sample in self._way if sample.time <= begin + record.cancel_sent]
                by_task.update({record.task.number: before[-1]} if before else {})
        plot_path(
            path,
            picture,
            settings.points,
            [(sample.x, sample.y) for sample in self._way],
            [(sample.x, sample.y) for sample in by_task.values()],
            f"Mission {settings.mission}, {settings.approach}, seed {settings.seed}",
        )
        return path
