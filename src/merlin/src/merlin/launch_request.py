# SPDX-License-Identifier: Apache-2.0
"""What the user asked to run: a launch file, its arguments, and the port of the master.

Everything that can be wrong with a command line is found here, before any process is started.
"""

import contextlib
import difflib
import os
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, FrozenSet, Iterable, List, Mapping, Optional, Tuple

import roslaunch.arg_dump
import roslib.packages
import rospkg
from roslaunch.core import RLException
from roslaunch.loader import convert_value
from roslaunch.substitution_args import resolve_args

from merlin.linger import Linger
from merlin_pddl.text_reader import shortened

PORT_ARGUMENT = "port"
LINGER_ARGUMENT = "linger"


#: What `run` and `check` take.
HELP = """A launch file is a path, or a name in launch/ of the package; without a package it is MERLIN's.
name:=value sets its arguments, and those of the files that it includes with pass_all_args. They are listed by
  roslaunch --ros-args PACKAGE FILE
  roslaunch --ros-args merlin application.launch    what `rosrun merlin new` includes
`run` also takes port:=11311 (of the ROS master; otherwise a free one) and linger:=true (the page stays at the
end)."""


class LaunchError(Exception):
    """The run cannot start; the text is one line that says what is wrong and what to do."""


class HelpWanted(Exception):
    """The command line asks what may stand in it; the text says so."""


@dataclass(frozen=True)
class LaunchRequest:
    """A checked command line.

    :ivar launch_file: the file to run.
    :ivar arguments: arguments of the launch file, name → text.
    :ivar port: port of the ROS master; None: any free one.
    :ivar linger: whether the page stays when the run has ended.
    """

    launch_file: Path
    arguments: Dict[str, str] = field(default_factory=dict)
    port: Optional[int] = None
    linger: Linger = Linger.NEVER

    @classmethod
    def from_command_line(cls, words: Iterable[str]) -> "LaunchRequest":
        """Reads `[package] <launch file> name:=value …`.

        :raises HelpWanted: it has --help.
        :raises LaunchError: no such launch file, no such argument, a required argument is missing, a bad port
            or word for lingering, or an argument has two values or one that roslaunch drops.
        """
        files: List[str] = []
        pairs: Dict[str, str] = {}
        for word in words:
            if word in ("-h", "--help"):
                raise HelpWanted(f"[package] <launch file> name:=value …\n\n{HELP}")
            name, assigned, value = word.partition(":=")
            value = _as_nodes_find_it(value)
            if assigned and pairs.setdefault(name, value) != value:
                raise LaunchError(f"{name}:={pairs[name]} and {word} contradict each other; leave one out")
            if not assigned:
                files.append(word)
        if len(files) not in (1, 2):
            raise LaunchError(
                "name a launch file, or a package and a launch file, "
                "e.g. 'rosrun merlin run home.launch mission:=1'; there are: "
                + ", ".join(application_names())
            )
        launch_file = find_launch_file(files[0]) if len(files) == 1 else file_of_package(*files)
        declared = known_arguments(launch_file, pairs)
        port = None
        if PORT_ARGUMENT in pairs and PORT_ARGUMENT not in declared:
            port = _port(pairs.pop(PORT_ARGUMENT))
        linger = Linger.NEVER
        if LINGER_ARGUMENT in pairs and LINGER_ARGUMENT not in declared:
            linger = _linger(pairs.pop(LINGER_ARGUMENT))
        _check_names(launch_file, pairs, declared)
        return cls(launch_file, pairs, port, linger)

    def words(self) -> List[str]:
        """The arguments as roslaunch takes them."""
        return [f"{name}:={value}" for name, value in self.arguments.items()]


def launch_folder() -> Path:
    """Folder of the launch files that come with MERLIN.

    :raises LaunchError: when ROS does not find MERLIN.
    """
    try:
        return Path(rospkg.RosPack().get_path("merlin")) / "launch"
    except rospkg.ResourceNotFound:
        raise LaunchError(
            "ROS does not find the package merlin, as something has changed ROS_PACKAGE_PATH; "
            "source its workspace's devel/setup.bash again"
        ) from None


def application_names() -> List[str]:
    """Names of the applications that come with MERLIN."""
    return sorted(path.name for path in launch_folder().glob("*.launch"))


def is_file(path: Path) -> bool:
    """Whether a path is that of a file.

    :raises LaunchError: that cannot be said, as this user may not look into its folder.
    """
    try:
        return path.is_file()
    except OSError as error:
        raise LaunchError(f"{path} cannot be read: {error.strerror}") from error


def find_launch_file(name: str) -> Path:
    """The file of a path, or of a name in MERLIN's launch folder.

    :raises LaunchError: when it does not exist.
    """
    for path in (Path(name), launch_folder() / name):
        if is_file(path):
            return path.resolve()
    raise LaunchError(
        f"there is no launch file '{name}'; give a path or one of: {', '.join(application_names())}"
    )


def file_of_package(package: str, name: str) -> Path:
    """A launch file by its name alone, anywhere in a package, as roslaunch finds it.

    :raises LaunchError: when there is no such package, or not exactly one such file in it.
    """
    try:
        folder = Path(rospkg.RosPack().get_path(package))
        found = roslib.packages.find_resource(package, name)
    except rospkg.ResourceNotFound:
        raise LaunchError(
            f"there is no package '{package}'; build it, and source its workspace's devel/setup.bash"
        ) from None
    if len(found) == 1:
        return Path(found[0]).resolve()
    names = ", ".join(sorted(path.name for path in folder.glob("launch/**/*.launch"))) or "none"
    raise LaunchError(
        f"package {package} has {len(found) or 'no'} files '{name}'; its launch files are: {names}"
    )


def declared_arguments(launch_file: Path) -> Dict[str, Optional[str]]:
    """Arguments that a launch file declares, name → default (None: required).

    :raises LaunchError: the file cannot be read as a launch file.
    """
    try:
        found = roslaunch.arg_dump.get_args([str(launch_file)])
    except (RLException, rospkg.ResourceNotFound) as error:
        raise LaunchError(f"{launch_file}: {one_line(error)}") from error
    # roslaunch lists a name whose fixed value is empty among the arguments that are required.
    tags = _own_arguments(ElementTree.parse(str(launch_file)).getroot())
    fixed = {tag.get("name") for tag in tags if "value" in tag.attrib}
    return {name: text for name, (_doc, text) in found.items() if text is not None or name not in fixed}


def known_arguments(launch_file: Path, given: Mapping[str, str] = {}) -> Dict[str, Optional[str]]:
    """Arguments that a launch file takes: its own, and those that it passes on without naming them.

    roslaunch gives all arguments of the command line to a file that is included with ``pass_all_args``, but
    for those that the including file sets: of these a value on the command line would count for nothing.

    :param given: values of arguments, which may decide on the files that are included.
    :raises LaunchError: when the file cannot be read as a launch file.
    """
    known: Dict[str, Optional[str]] = {}
    nothing: FrozenSet[str] = frozenset()
    waiting, seen = [(launch_file, nothing)], set()
    while waiting:
        file, fixed = waiting.pop()
        seen.add(file)
        for name, default in declared_arguments(file).items():
            # What an included file requires is given by the one that includes it; else roslaunch says so.
            if name not in fixed:
                known.setdefault(name, default if file == launch_file else default or "")
        values = {name: value for name, value in {**known, **given}.items() if value is not None}
        for included, its in _passed_on(file, values):
            if included not in seen:
                waiting.append((included, fixed | its))
    return known


def _passed_on(launch_file: Path, values: Mapping[str, str]) -> Iterable[Tuple[Path, FrozenSet[str]]]:
    """The files that a launch file with these arguments includes with all of them but some that it sets."""
    root = ElementTree.parse(str(launch_file)).getroot()
    context = _context(launch_file, root, values)
    for tag in root.iter("include"):
        if tag.get("pass_all_args", "").lower() not in ("true", "1"):
            continue
        try:
            included = Path(resolve_args(tag.get("file", ""), context))
        except Exception:  # of roslaunch, a missing package, or what an expression $(eval …) raises
            continue  # it is not included, or roslaunch says what is wrong
        if is_file(included):
            yield included, frozenset(each.get("name", "") for each in tag.iterfind("arg"))


def _own_arguments(root: ElementTree.Element) -> List[ElementTree.Element]:
    """The tags of a launch file's arguments; a group's come last, as they count in it alone."""
    return [*root.iterfind("arg"), *root.iterfind(".//group/arg")]


def _context(launch_file: Path, root: ElementTree.Element, values: Mapping[str, str]) -> Dict[str, Any]:
    """What resolves the texts of a launch file: the arguments that it is given, and those that it makes."""
    found = dict(values)
    context = {"arg": found, "filename": str(launch_file)}
    for tag in _own_arguments(root):
        name = tag.get("name", "")
        text, condition = tag.get("value", values.get(name)), tag.get("if", tag.get("unless"))
        with contextlib.suppress(Exception):  # roslaunch says what is wrong
            holds = condition is None or convert_value(resolve_args(condition, context), "bool")
            if text is not None and holds != ("unless" in tag.attrib):
                found[name] = resolve_args(text, context)
    return context


def one_line(error: object) -> str:
    """The first paragraph of an error's text on one line, and the tag that roslaunch names after it.

    Of a package that is missing, what the argument says that needs it and which no user can set.
    """
    if isinstance(error, rospkg.ResourceNotFound):
        place, _, package = str(error.args[0]).partition("\nROS path ")[0].rpartition(": ")
        advice = re.search(r'<arg (?=[^>]* value=)[^>]* doc="([^"]*)"', place)
        return f"there is no package '{package}'; {advice[1] if advice else 'build it, or correct $(find …)'}"
    paragraphs = str(error).strip().split("\n\n")
    if paragraphs[0].endswith(":"):  # what is run, and why that fails
        paragraphs[:2] = [" ".join(paragraphs[:2])]
    tags = [text[len("Arg xml is ") :] for text in paragraphs[1:] if text.startswith("Arg xml is ")]
    return shortened(" ".join(" ".join([paragraphs[0], *tags]).split()), 1000) or type(error).__name__


def _as_nodes_find_it(value: str) -> str:
    """A value that names a file from the caller's folder, for nodes, which start in another one."""
    if value.startswith("~/"):
        return os.path.expanduser(value)
    # A word as `run` or `1` is not meant as a path, whatever file has its name.
    return os.path.abspath(value) if set("/.") & set(value) and os.path.isfile(value) else value


def _check_names(launch_file: Path, given: Dict[str, str], declared: Dict[str, Optional[str]]) -> None:
    for name, value in given.items():
        fault = "has ':=' twice" if ":=" in value else ""
        if name in declared and not value.strip() and declared[name] != "":
            fault = "is empty"
        if fault:
            raise LaunchError(
                f"{name}:={value} {fault}, which roslaunch drops; give another value, or leave it out"
            )
        if name in declared:
            continue
        near = difflib.get_close_matches(name, declared, 1)
        hint = f"did you mean '{near[0]}'?" if near else "it knows: " + ", ".join(sorted(declared))
        raise LaunchError(f"{launch_file.name} has no argument '{name}'; {hint}")
    missing = [name for name, default in declared.items() if default is None and name not in given]
    if missing:
        raise LaunchError(f"{launch_file.name} needs {', '.join(f'{name}:=…' for name in missing)}")


def _port(text: str) -> int:
    if re.fullmatch("[0-9]{1,5}", text) and 0 < int(text) < 65536:
        return int(text)
    raise LaunchError(f"port:={text} is not a TCP port; give a number from 1 to 65535, or leave it out")


def _linger(text: str) -> Linger:
    try:
        return Linger(text)
    except ValueError:
        words = ", ".join(each.value for each in Linger)
        raise LaunchError(f"linger:={text} is not one of {words}; leave it out to end with the run") from None
