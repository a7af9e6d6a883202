# SPDX-License-Identifier: Apache-2.0
"""Runs the problems, each with its seeds, and prints a table: `solve --problem 3 --seeds 20`."""

import argparse
import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import List, Optional

from deliberation.problems import PROBLEMS, Run, problem_of, run_of, table
from deliberation.simulation import check_pyrobosim
from deliberation.world_file import WorldError
from merlin_ros.processes.tidy_end import handled

MISTAKE = 2


def _arguments(words: Optional[List[str]]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="solve", description=__doc__)
    parser.add_argument("--problem", type=int, help="1 to 4; all of them without it")
    parser.add_argument("--seed", type=int, default=1, help="of the first run (1)")
    parser.add_argument(
        "--seeds", type=int, default=1, help="runs of each problem, with seeds that follow (1)"
    )
    parser.add_argument(
        "--cancels", type=int, default=0, help="of each run; with any, also an urgent request (0)"
    )
    parser.add_argument("--rtf", type=float, default=5.0, help="simulated seconds per second (5)")
    parser.add_argument("--world", help="another world file, such as one of the workshop")
    parser.add_argument("--goals", help="instead of those of the problem: '(is_at mug table)'")
    parser.add_argument("--urgent", help="likewise, of the urgent request")
    parser.add_argument("--planner", help="command line of another planner, or of two, as of planner_command")
    parser.add_argument("--known", action="store_true", help="the robot knows where the things are at first")
    parser.add_argument("--results", type=Path, default=Path("results/deliberation"), help="folder")
    return parser.parse_args(words)


def main(words: Optional[List[str]] = None) -> int:
    """Returns 0 when every run was solved, 1 when one was not, 2 for a mistake."""
    asked = _arguments(words)
    try:
        check_pyrobosim()
        numbers = [asked.problem] if asked.problem is not None else list(PROBLEMS)
        for number in numbers:
            problem_of(number)
        least = min(asked.seeds - 1, asked.seed, asked.cancels)
        if least < 0 or not asked.rtf > 0:
            raise ValueError(
                "--seeds has to be at least 1, --seed and --cancels at least 0, --rtf more than 0"
            )
        if asked.world and not Path(asked.world).is_file():
            raise WorldError(f"there is no world {asked.world}; give another one, --world FILE")
    except (WorldError, ValueError) as error:
        print(f"solve: {error}", file=sys.stderr)
        return MISTAKE
    runs: List[Run] = []
    for number in numbers:
        for seed in range(asked.seed, asked.seed + asked.seeds):
            code = _run(asked, number, seed, runs)
            if code in (MISTAKE, 130):
                return code
    print()
    print("\n".join(table(runs)))
    return 0 if all(run.solved for run in runs) else 1


def _run(asked: argparse.Namespace, number: int, seed: int, runs: List[Run]) -> int:
    """Runs one in processes of its own; returns the exit code."""
    folder = (asked.results / f"problem_{number}_seed_{seed}").resolve()
    file = folder / "run.json"
    file.unlink(missing_ok=True)
    named = [f"problem:={number}", f"seed:={seed}", f"cancels:={asked.cancels}", f"rtf:={asked.rtf}"]
    named += [f"results:={folder}", "monitor_port:=0", f"known:={str(asked.known).lower()}"]
    named += [f"world:={Path(asked.world).resolve()}"] if asked.world else []
    named += [f"{name}:={value}" for name in ("goals", "urgent") if (value := getattr(asked, name))]
    named += [f"planner_command:={asked.planner}"] if asked.planner else []
    command = ["rosrun", "merlin", "run", "deliberation", "deliberation.launch", *named]
    with handled({signal.SIGINT: lambda *_: None}):  # the run has got Ctrl-C too, and tidies up
        code = subprocess.run(command, check=False).returncode
    if not file.is_file():
        if code not in (MISTAKE, 130):
            runs.append(Run(number, seed, False, 0, 0, None, 0.0, 0, 0.0, 0, 0, [f"ended with {code}"]))
            print(f"problem {number}, seed {seed}: it ended with {code} and wrote nothing", flush=True)
        return code
    run = run_of(json.loads(file.read_text(encoding="utf-8")))
    runs.append(run)
    oracle = "none" if run.oracle is None else f"{run.oracle:.1f}"
    print(
        f"problem {number}, seed {seed}: {'solved' if run.solved else 'NOT SOLVED'}, {run.steps} actions "
        f"({run.failed} failed; oracle {oracle}), {run.replans} new plans, {run.time:.1f} s",
        flush=True,
    )
    return code
