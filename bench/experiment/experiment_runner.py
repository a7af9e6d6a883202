# SPDX-License-Identifier: Apache-2.0
"""Carries the runs out, one after the other; what is done already is not done again."""

import contextlib
import fcntl
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Dict, Iterator, List, Optional, Sequence, Tuple

from experiment.generated_world import write_world
from experiment.run_plan import ExperimentRun
from experiment.run_table import Row, finished
from merlin.running import living
from merlin_ros.processes.process_tree import descendants

LAUNCH_FILE = "experiment.launch"
#: Between two looks for the master of a run that begins, s.
LOOK = 0.2
#: First guess of the wall time that a run needs besides its simulated time, s.
OVERHEAD = 15.0
#: First guess of the simulated time of a task, s.
TASK_TIME = {"naive": 30.0, "merlin": 20.0}


class ExperimentInterrupted(Exception):
    """The user has stopped the experiment."""


class ExperimentRunner:
    """Runs into folders below `<results>/runs`, which other processes may fill at the same time."""

    def __init__(self, results: Path, record: bool = False) -> None:
        """:param results: folder of the experiment.
        :param record: whether each run records a bag.
        """
        self._folder = results / "runs"
        self._record = record
        self._costs: Dict[Tuple[int, str], List[float]] = {}

    def run_all(self, runs: Sequence[ExperimentRun]) -> List[ExperimentRun]:
        """Carries out what is not done.

        :return: Runs that did not come to their end.
        :raises ExperimentInterrupted: on SIGINT and SIGTERM.
        """
        todo = [run for run in runs if finished(self._folder / run.name) is None]
        say(f"{len(runs)} runs, {len(runs) - len(todo)} done before")
        failed = []
        for index, run in enumerate(todo):
            with self._claim(run) as mine:
                if not mine:
                    say(f"{run.name}: another process works on it")
                    continue
                if finished(self._folder / run.name) is not None:
                    continue
                began = time.monotonic()
                row = self._carry_out(run)
                cost = time.monotonic() - began
            if row is None:
                failed.append(run)
            else:
                self._costs.setdefault((run.mission, run.approach), []).append(cost)
            say(f"{index + 1}/{len(todo)}  {outcome_line(run, row, cost)}; {self._left(todo[index + 1 :])}")
        return failed

    def _carry_out(self, run: ExperimentRun) -> Optional[Row]:
        folder = self._folder / run.name
        command = ["rosrun", "merlin", "run", LAUNCH_FILE, *run.words()]
        command += [f"results:={folder}", f"record:={str(self._record).lower()}"]
        if run.world:
            files = write_world(folder, run.world)
            command += [f"world_file:={files.world}", f"problem:={files.problem}"]
        with (folder / "output.txt").open("w") as output:
            # On a signal the runner ends all below it; a terminal sends it to the runner, too.
            process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
            try:
                with _fault(process, run.killed_in, folder) if run.killed_in else contextlib.nullcontext():
                    process.wait()
            except BaseException:
                process.send_signal(signal.SIGINT)
                process.wait()
                raise
        if process.returncode in (130, 143, -signal.SIGINT, -signal.SIGTERM):
            raise ExperimentInterrupted
        return finished(folder)

    @contextlib.contextmanager
    def _claim(self, run: ExperimentRun) -> Iterator[bool]:
        folder = self._folder / run.name
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / ".lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                yield False
            else:
                yield True

    def _left(self, runs: Sequence[ExperimentRun]) -> str:
        if not runs:
            return "that was the last"
        seconds = sum(map(self._estimate, runs))
        return f"about {duration_text(seconds)} left"

    def _estimate(self, run: ExperimentRun) -> float:
        known = self._costs.get((run.mission, run.approach))
        if known:
            return sum(known) / len(known)
        return OVERHEAD + run.tasks * TASK_TIME[run.approach] / max(1.0, run.factor)


@contextlib.contextmanager
def _fault(process: "subprocess.Popen[bytes]", task: int, folder: Path) -> Iterator[None]:
    """Within it, navigation is killed in a task of a run that begins; else the run is not finished."""
    uri = ""
    while not uri and process.poll() is None:
        time.sleep(LOOK)
        below = {process.pid, *descendants(process.pid)}
        uri = next((each.uri for each in living() if each.pid in below), "")
    program = (
        f"import sys; sys.path[:] = {sys.path!r}; "
        f"from experiment.fault_injector import main; sys.exit(main({task}))"
    )
    environment = {**os.environ, "ROS_MASTER_URI": uri}
    injector = subprocess.Popen([sys.executable, "-c", program], env=environment, stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        injector.terminate()
        if injector.wait():
            say(f"{folder.name}: navigation could not be killed, the run does not count")
            for table in folder.glob("*.csv"):
                table.unlink()


def outcome_line(run: ExperimentRun, row: Optional[Row], cost: float) -> str:
    """One line on a run that has ended; `cost` in s of wall time."""
    head = f"Mission {run.mission} {run.approach:<6} seed {run.seed}"
    if run.world:
        head += f" (generated world {run.world})"
    elif run.set != "main":
        head += (
            f" ({run.set}: cancel after {run.cancel_after:g} s, share {run.share:.2f}, rtf {run.factor:g})"
        )
    if row is None:
        return f"{head}: FAILED after {cost:.0f} s, see {run.name}/output.txt"
    efficiency = "-" if row["efficiency"] is None else f"{row['efficiency']:.3f}"
    odd = "" if row["right"] == row["tasks"] else f", {row['tasks'] - row['right']:.0f} tasks not as listed"
    return (
        f"{head}: {row['time_s']:.1f} s, {row['distance_m']:.1f} m, efficiency {efficiency}{odd} "
        f"({cost:.0f} s)"
    )


def duration_text(seconds: float) -> str:
    """`1 h 05 min`, `12 min`, `40 s`."""
    minutes = round(seconds / 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60:02d} min"
    return f"{minutes} min" if minutes >= 2 else f"{round(seconds)} s"


def say(text: str) -> None:
    """One line of progress, also where there is no terminal."""
    print(text, file=sys.stdout, flush=True)
