# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin replay`: shows the page as it was while a bag was recorded."""

import argparse
import sys
import tempfile
from pathlib import Path
from typing import List

import rospkg
import yaml

from merlin.launch_request import LaunchError, LaunchRequest, launch_folder
from merlin.launch_runner import EXIT_REFUSED, LaunchRun
from merlin.running import EXIT_INTERRUPTED
from merlin_monitor.bag.recording import BagRecording, RecordingError, parameter_tree
from merlin_ros.lean_start import end_lightly
from merlin_ros.processes.option_number import option_number
from merlin_ros.processes.tidy_end import TIDY, handled

LAUNCH_FILE = "include/replay.launch"
#: Ends of the topics that the monitor follows, of those that are recorded.
FOLLOWED = (
    "/map",
    "/diagnostics",
    "/tf",
    "/tf_static",
    "/people",
    "/merlin_sim/status",
    "/merlin/status",
    "/merlin/queue",
    "/merlin/mission",
    "/merlin/guard",
    "/merlin/execute/result",
    "/changes",
    "/complete_plan",
    "/problem_instance",
    "/planner_output",
    "/planner_status",
    "/action_dispatch",
    "/action_feedback",
    "/dispatch_status",
    "/smach/container_structure",
    "/smach/container_status",
    "/move_base/result",
    "/move_base/goal",
    "/move_base/plan",
)


def main() -> int:
    """Replays a bag; returns the exit code: 0 at its end, 2 for a mistake, 130 after Ctrl-C."""
    given = _arguments(sys.argv[1:])
    end_lightly()
    try:
        recording = BagRecording(given.bag)
        # The bag's folder may be full or read-only.
        with handled(TIDY), tempfile.TemporaryDirectory(prefix="merlin-replay-") as folder:
            recording.write(Path(folder) / "replay.bag", given.start)
            (Path(folder) / "parameters.yaml").write_text(
                yaml.safe_dump(parameter_tree(recording.parameters))
            )
            left = recording.length - given.start
            print(
                f"{left:.1f} s of {given.bag}; space pauses, s goes one message on, Ctrl-C ends", flush=True
            )
            return LaunchRun(_request(recording, Path(folder), given), "merlin replay").run()
    except (RecordingError, LaunchError, OSError) as error:  # the disk is full
        print(f"merlin replay: {error}", file=sys.stderr)
        return EXIT_REFUSED
    except KeyboardInterrupt:  # while it reads
        return EXIT_INTERRUPTED


def _arguments(words: List[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="rosrun merlin replay",
        description="Shows the page as it was while a bag was recorded (record:=true).",
    )
    last = Path(rospkg.get_ros_home()) / "merlin"
    parser.add_argument(
        "bag",
        type=Path,
        nargs="?",
        default=last,
        help=f"the bag, or the results folder with run.bag ({last})",
    )
    parser.add_argument(
        "--rate",
        type=option_number("a number above 0, up to 1000", above=0.0, most=1000.0),
        default=1.0,
        help="s of the recording per s; 1 by default",
    )
    parser.add_argument(
        "--start",
        type=option_number("a number of seconds from 0 on", 0.0),
        default=0.0,
        metavar="S",
        help="begin after S seconds",
    )
    parser.add_argument("--pause", action="store_true", help="begin paused; space goes on")
    parser.add_argument("--keep", action="store_true", help="stay at the end, until Ctrl-C")
    parser.add_argument("--port", type=int, default=8080, help="of the page, or the next free one")
    return parser.parse_args(words)


def _request(recording: BagRecording, folder: Path, given: argparse.Namespace) -> LaunchRequest:
    followed = [name for name in recording.topics if name.endswith(FOLLOWED)]
    options = f"--rate={given.rate:g}" + (" --keep-alive" if given.keep else "")
    if not sys.stdout.isatty():  # its line of time, many times per second, is for a screen
        options += " --quiet"
    arguments = {
        "folder": str(folder),
        "robot": recording.namespace,
        "options": options,
        "begin": str(not given.pause).lower(),
        "followed": str(followed),
        "port": str(given.port),
    }
    return LaunchRequest(launch_folder() / LAUNCH_FILE, arguments)
