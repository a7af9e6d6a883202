# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin unit`: the systemd services of a robot's computer."""

import argparse
import getpass
import json
import os
import pwd
import re
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

import rosgraph
from rosgraph.network import parse_http_host_and_port
from roslaunch.core import Node

from merlin.launch_config import LaunchConfig
from merlin.launch_request import LaunchError, LaunchRequest, declared_arguments, launch_folder
from merlin.linger import Linger
from merlin.local_names import is_own

HEAD = "# Written by rosrun merlin unit"


@dataclass(frozen=True)
class Account:
    """Where and for whom services run.

    :ivar user: that they run as.
    :ivar folder: from which relative paths count.
    :ivar setup: the script of the workspace.
    :ivar environment: variables, name → text.
    """

    user: str
    folder: Path
    setup: Path
    environment: Dict[str, str]


def unit(
    account: Account,
    description: str,
    command: Sequence[str],
    starts: Sequence[str] = (),
    keep: bool = False,
    namespace: str = "",
) -> str:
    """The text of a service.

    :param command: the words of a command of ROS, which ends with SIGINT.
    :param starts: services that are started before it and ended after it; their death is not its own.
    :param keep: start it again however often it dies, and let the kernel spare it when memory is short;
        otherwise not more than 5 times within 300 s.
    :param namespace: in which its nodes are.
    """
    before = [f"{name}.service" for name in starts]
    environment = {**account.environment, **({"ROS_NAMESPACE": namespace} if namespace else {})}
    script = f". {shlex.quote(str(account.setup))} && exec {shlex.join(command)}"
    lines = [
        HEAD,
        "[Unit]",
        f"Description={_literal(description)}",
        f"After={' '.join(['network.target', *before])}",
        *([f"Wants={' '.join(before)}"] if before else ()),
        f"StartLimitIntervalSec={0 if keep else 300}",
        *([] if keep else ["StartLimitBurst=5"]),
        "",
        "[Service]",
        f"User={account.user}",
        "SupplementaryGroups=audio",
        f"WorkingDirectory={_literal(str(account.folder))}",
        *(f"Environment={_quoted(f'{name}={text}', '')}" for name, text in sorted(environment.items())),
        f"ExecStart=/bin/bash -c {_quoted(script, '$')}",
        "Restart=always",
        "RestartSec=1",
        "# roslaunch gives its nodes 15 s.",
        "KillSignal=SIGINT",
        "KillMode=mixed",
        "TimeoutStopSec=25",
        *(["OOMScoreAdjust=-900"] if keep else ()),
        "",
        "[Install]",
        "WantedBy=multi-user.target",
    ]
    return "\n".join(lines) + "\n"


def _literal(text: str) -> str:
    """Text without the meaning that % has for systemd."""
    return text.replace("%", "%%")


def _quoted(text: str, doubled: str) -> str:
    """Text as one word of systemd.

    :param doubled: characters with a meaning of their own beside %.
    """
    text = _literal(text).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    for character in doubled:
        text = text.replace(character, 2 * character)
    return f'"{text}"'


EXIT_REFUSED = 2
GUARD_FILE = "include/guard.launch"
GUARD = ("merlin_guard", "guard")
#: Variables that decide whom the nodes reach, and where their files are.
KEPT = ("ROS_IP", "ROS_HOSTNAME", "ROS_HOME", "ROS_LOG_DIR")


def main(arguments: Optional[List[str]] = None) -> int:
    """Writes the units of a launch file; returns the exit code, 2 when it is refused."""
    options = _options(arguments)
    try:
        units, notes = _units(options)
        folder = Path(options.folder)
        _write(folder, units)
    except (LaunchError, OSError) as error:
        print(f"merlin unit: {error}", file=sys.stderr)
        return EXIT_REFUSED
    files = shlex.join(f"{folder / name}.service" for name in units)
    print("".join(f"{note}\n" for note in notes) + f"{len(units)} units are written. Next:")
    print(f"  sudo cp {files} /etc/systemd/system/ && sudo systemctl daemon-reload")
    print(f"  sudo systemctl enable --now {' '.join(units)}")
    print(f"  journalctl -fu {options.name}")
    return 0


def _options(arguments: Optional[List[str]]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="rosrun merlin unit",
        description="Writes systemd services: ROS master, velocity guard, and a launch file. ROS_MASTER_URI, "
        "ROS_IP and the workspace are those of this shell; relative paths count from this folder.",
    )
    parser.add_argument(
        "words",
        nargs="+",
        metavar="WORD",
        help="[package] <launch file> name:=value …, as for rosrun merlin run",
    )
    parser.add_argument("--folder", default=".", help="for the units (default: this one)")
    parser.add_argument(
        "--name", default="merlin", help="first part of the services' names (default: merlin)"
    )
    parser.add_argument(
        "--user",
        default=os.environ.get("SUDO_USER"),
        help="that the services run as (default: who calls this)",
    )
    parser.add_argument(
        "--no-master",
        action="store_true",
        help="the robot's own software starts the master; also so when ROS_MASTER_URI is of another computer",
    )
    return parser.parse_intermixed_args(arguments)


def _units(options: argparse.Namespace) -> Tuple[Dict[str, str], List[str]]:
    """The texts of the units by their names, in the order of their start, and sentences for the user.

    :raises LaunchError: when something is wrong with what was asked for.
    """
    if not re.fullmatch(r"[A-Za-z][\w-]*", options.name):
        raise LaunchError(f"--name {options.name} is not a name; take letters, digits, '-' and '_'")
    request = LaunchRequest.from_command_line(options.words)
    if request.port is not None or request.linger is not Linger.NEVER:
        raise LaunchError("port:= and linger:= are of 'run' only; the master is that of ROS_MASTER_URI")
    uri = rosgraph.get_master_uri()
    try:
        host, port = parse_http_host_and_port(uri)
    except ValueError:
        raise LaunchError(f"ROS_MASTER_URI={uri} is not an address; give http://HOST:11311") from None
    kept = {name: os.environ[name] for name in KEPT if os.environ.get(name)}
    account = Account(_user(options.user), Path.cwd(), _setup(), {"ROS_MASTER_URI": uri, **kept})
    master, guard, name = f"{options.name}-master", f"{options.name}-guard", options.name
    found: Dict[str, str] = {}
    notes = ["the services run as root; --user gives another"] if account.user == "root" else []
    if options.no_master or not is_own(host):
        notes.append(f"no unit starts the master: the services wait for the one of {uri}")
    else:
        found[master] = unit(account, "ROS master", ["roscore", "-p", str(port)], keep=True)
    own = _guard(request)
    if own is None:
        notes.append("no unit starts the guard: the launch file has none for a single robot")
    else:
        namespace, words = own
        request.arguments["guard"] = "elsewhere"
        command = ["roslaunch", "--wait", str(launch_folder() / GUARD_FILE), *words]
        found[guard] = unit(account, "MERLIN's velocity guard", command, list(found), True, namespace)
    command = ["roslaunch", "--wait", str(request.launch_file), *request.words()]
    found[name] = unit(account, f"MERLIN: {request.launch_file.stem}", command, list(found))
    return found, notes


def _guard(request: LaunchRequest) -> Optional[Tuple[str, List[str]]]:
    """Namespace of the guard that a launch file starts, and what guard.launch needs to start the same one.

    :return: None: it starts none, or several.
    :raises LaunchError: the launch file cannot leave it out.
    """
    config = LaunchConfig(request)
    found = _guards(config)
    if len(found) != 1:
        return None
    words = [str(request.launch_file), *request.words()]
    if _guards(LaunchConfig(LaunchRequest.from_command_line([*words, "guard:=elsewhere"]))):
        raise LaunchError(
            f"{request.launch_file.name} starts a guard also with guard:=elsewhere; hand guard on to its file"
        )
    (node,) = found
    arguments = []
    for name, default in declared_arguments(launch_folder() / GUARD_FILE).items():
        value = config.param(f"{node.namespace}{node.name}/{name}", dict(node.remap_args).get(name, ""))
        text = value if isinstance(value, str) else json.dumps(value)
        if text not in ("", default):
            arguments.append(f"{name}:={text}")
    return node.namespace.strip("/"), arguments


def _guards(config: LaunchConfig) -> List[Node]:
    return [node for node in config.nodes if (node.package, node.type) == GUARD]


def _user(name: Optional[str]) -> str:
    try:
        return pwd.getpwnam(name or getpass.getuser()).pw_name
    except (KeyError, OSError) as error:
        if not name:  # a container may have no names of users
            raise LaunchError("this user has no name here; give one that exists: --user NAME") from error
        raise LaunchError(f"there is no user {name}; add him first: sudo adduser --system {name}") from error


def _setup() -> Path:
    """The script of the workspace that was sourced last."""
    for folder in os.environ.get("CMAKE_PREFIX_PATH", "").split(os.pathsep):
        if folder and (Path(folder) / "setup.bash").is_file():
            return Path(folder).resolve() / "setup.bash"
    raise LaunchError("no workspace is sourced; source its devel/setup.bash, or /opt/merlin/setup.bash")


def _write(folder: Path, units: Dict[str, str]) -> None:
    """Writes units into a folder, which is made; those of an earlier call are replaced, and no other file.

    :raises LaunchError: another file is in the way, or one cannot be written.
    """
    files = {folder / f"{name}.service": text for name, text in units.items()}
    try:
        for file in files:
            if file.exists() and not file.read_text(encoding="utf-8", errors="replace").startswith(HEAD):
                raise LaunchError(f"{file} was not written by this command; take another --folder or --name")
        folder.mkdir(parents=True, exist_ok=True)
        for file, text in files.items():
            file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise LaunchError(f"{error.filename} cannot be written: {error.strerror}") from error
