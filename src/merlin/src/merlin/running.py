# SPDX-License-Identifier: Apache-2.0
"""The runs of `rosrun merlin run` on this machine, and the commands for what runs: which master they mean.

Each run has a master of its own. It leaves a note in ROS's folder as long as it lives, so that `rosrun merlin
reload` and `rosrun merlin send` need no address.
"""

import contextlib
import json
import os
import socket
import sys
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Optional, Tuple, Type

import rosgraph
import rospkg
from rosgraph.network import parse_http_host_and_port

from merlin.launch_request import LaunchError
from merlin.local_names import use_loopback

EXECUTOR = "merlin_executor"
EXIT_REFUSED = 2
EXIT_INTERRUPTED = 130


class NothingRuns(LaunchError):
    """No master has what is wanted."""


class RunningLaunch(NamedTuple):
    """A run that lives."""

    pid: int
    began: str  # of the process, as the kernel counts: a number may be another process's later
    uri: str  # of its master
    launch_file: str
    log_folder: str


def folder() -> Path:
    """Where the notes are."""
    return Path(rospkg.get_ros_home()) / "merlin" / "runs"


@contextlib.contextmanager
def announced(uri: str, launch_file: Path, log_folder: Path) -> Iterator[None]:
    """Within it, other processes find this run. A folder that cannot be written keeps no run from going."""
    run = RunningLaunch(os.getpid(), _began(os.getpid()), uri, str(launch_file), str(log_folder))
    note = folder() / f"{run.pid}.json"
    with contextlib.suppress(OSError):
        note.parent.mkdir(parents=True, exist_ok=True)
        note.write_text(json.dumps(run._asdict()), encoding="utf-8")
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            note.unlink()


def living() -> List[RunningLaunch]:
    """The runs of this machine, oldest first; notes of runs that were killed are removed."""
    runs = []
    for note in folder().glob("*.json"):
        try:
            run = RunningLaunch(**json.loads(note.read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError):
            continue  # it ends, or is being written
        if _began(run.pid) == run.began:
            runs.append(run)
        else:
            with contextlib.suppress(OSError):
                note.unlink()
    return sorted(runs, key=lambda run: int(run.began))


def choose(find: Callable[[List[str], List[str]], List[str]], wanted: str) -> Tuple[str, List[str]]:
    """The master that a command means: that of ROS_MASTER_URI, if that is set, else the one that has it.

    :param find: from the nodes and the services of a master to the names that are wanted.
    :param wanted: the same in words.
    :return: the master's address, and the names.
    :raises NothingRuns: when no master has it.
    :raises LaunchError: when that of ROS_MASTER_URI has not, and several runs have it.
    """
    # It imports rospy, which a run that is only announced does without.
    from merlin_ros.master.master_link import MASTER_TIMEOUT, UNASKED, bounded_proxy, why_unasked

    faults: Dict[str, str] = {}

    def found_at(uri: str) -> List[str]:
        try:
            return find(*_graph(bounded_proxy(uri, MASTER_TIMEOUT)))
        except UNASKED as error:
            faults[uri] = f": {why_unasked(uri, error)}"
            return []

    use_loopback()
    own = rosgraph.get_master_uri()
    names = found_at(own)
    named = "ROS_MASTER_URI" in os.environ
    if names and named:  # whatever else runs, as for each command of ROS
        return own, names
    # A master of another name is asked once.
    runs = {run.uri: Path(run.launch_file).name for run in living() if _place(run.uri) != _place(own)}
    found = {own: names} if names else {}
    found.update((uri, names) for uri, names in zip(runs, map(found_at, runs)) if names)
    runs = {own: "ROS_MASTER_URI" if named else "the usual one", **runs}
    if len(found) == 1:
        return next(iter(found.items()))
    if found:
        choice = ", ".join(f"ROS_MASTER_URI={uri} ({runs[uri]})" for uri in found)
        raise LaunchError(f"several systems have {wanted}; choose one: {choice}")
    asked = ", ".join(f"{uri} ({name}{faults.get(uri, '')})" for uri, name in runs.items())
    raise NothingRuns(f"no running system has {wanted}; asked: {asked}")


def begin_node(name: str) -> None:
    """Begins the node of a command.

    :raises SystemExit: with 130, when it is interrupted meanwhile: a node of a launch would end with 0.
    """
    from merlin_ros.node import init_node

    try:
        init_node(name, anonymous=True)
    except SystemExit as ended:
        raise SystemExit(ended.code or EXIT_INTERRUPTED) from None


def beside(
    command: str,
    find: Callable[[List[str], List[str]], List[str]],
    wanted: str,
    do: Callable[[List[str]], Optional[int]],
    *refusals: Type[Exception],
) -> int:
    """Runs a function as a node beside what runs.

    :param command: with which its messages begin.
    :param find: see :func:`choose`; `wanted` likewise.
    :param do: takes the names that were found; returns the exit code, None for 0.
    :param refusals: what it raises when it was not done.
    :return: the exit code, 2 when it was not done, 130 after Ctrl-C.
    :raises SystemExit: with 130, when it is interrupted before its node has begun.
    """
    from rospy.core import is_shutdown_requested

    from merlin_ros.node import end_node

    refused: Tuple[Type[Exception], ...] = (LaunchError, *refusals)
    try:
        os.environ["ROS_MASTER_URI"], found = choose(find, wanted)
        sys.argv[1:] = []  # the arguments are not those of a node
        begin_node(command.replace(" ", "_"))
        try:
            return do(found) or 0
        except refused:
            if is_shutdown_requested():  # it ends the calls that are under way
                return EXIT_INTERRUPTED
            raise
        finally:
            end_node("done")
    except refused as error:
        print(f"{command}: {error}", file=sys.stderr)
        return EXIT_REFUSED


def at_robot(
    command: str, robot: Optional[str], do: Callable[[str], Optional[int]], *refusals: Type[Exception]
) -> int:
    """Likewise beside the running robot.

    :param robot: its namespace; None: the only one.
    :param do: takes its namespace, with a slash at its end.
    """

    def executors(nodes: List[str], _: List[str]) -> List[str]:
        if robot is None:
            return [node for node in nodes if node.rpartition("/")[2] == EXECUTOR]
        return [node for node in nodes if node.strip("/") == f"{robot.strip('/')}/{EXECUTOR}".strip("/")]

    def at(found: List[str]) -> Optional[int]:
        robots = [name.rpartition("/")[0] for name in found]
        if len(robots) > 1:
            raise LaunchError(f"there are several robots; choose one, --robot: {', '.join(robots)}")
        return do(f"{robots[0]}/")

    below = f" in the namespace {robot} (robots of one plan share one: leave --robot out)" if robot else ""
    return beside(command, executors, f"an Executor{below}", at, *refusals)


def _place(uri: str) -> Tuple[str, int]:
    """Address and port of a master."""
    try:
        host, port = parse_http_host_and_port(uri)
        return socket.gethostbyname(host), port
    except (OSError, ValueError):
        return uri, 0


def _graph(master: Any) -> Tuple[List[str], List[str]]:
    publishers, subscribers, services = master.getSystemState("/merlin")[2]
    nodes = {node for kind in (publishers, subscribers, services) for _, owners in kind for node in owners}
    return sorted(nodes), sorted(name for name, _ in services)


def _began(pid: int) -> str:
    """When a process began, in ticks since the machine started; empty: no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text("utf-8", "replace").rsplit(")", 1)[1].split()[19]
    except OSError:
        return ""
