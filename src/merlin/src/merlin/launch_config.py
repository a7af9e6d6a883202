# SPDX-License-Identifier: Apache-2.0
"""What a launch file starts and sets, read without starting it."""

import contextlib
import os
import shlex
import xml.etree.ElementTree as ElementTree
import xmlrpc.client
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple
from xml.parsers.expat import ExpatError

import roslaunch
import roslaunch.loader
import roslaunch.xmlloader
import roslib.packages
import rospkg
from roslaunch.core import Node

from merlin.launch_request import LaunchError, LaunchRequest, is_file, one_line
from merlin_actions.testing.result_script import fields_of
from merlin_ros.class_path import load_function
from merlin_ros.robot_values import of_robot, texts

#: Executable → the actions that it serves.
SERVED = {
    ("merlin_reactive", "navigation"): "move_base",
    ("merlin_actions", "simulated_base"): "move_base",
    ("merlin_reactive", "speech"): "sound_play",
    ("merlin_reactive", "speech_relay"): "sound_play",
    ("merlin_reactive", "listen"): "listen",
    ("merlin_reactive", "recognition"): "recognize",
}
#: Executable → what its server says of words or classes, ``package.module:function``.
JUDGES = {
    ("merlin_reactive", "listen"): "merlin_reactive.listening.speech_recognizer:unknown_words",
    ("merlin_reactive", "recognition"): "merlin_reactive.recognition.object_classes:unknown_classes",
}
#: Executables that stand in for a robot: with one of them the launch file starts every server itself.
STAND_INS = {("merlin_sim", "merlin_sim"), ("merlin_actions", "simulated_base")}
#: Executables that a parameter scripts, for all robots or for each.
SCRIPTED = {("merlin_actions", "simulated_action_server"), ("merlin_sim", "person_voice")}
KNOWLEDGE_BASE = "rosplan_knowledge_base"
#: Ends of the names of parameters that name a file which has to be there when a node starts.
FILE_PARAMETERS = ("/domain_path", "knowledge_base/problem_path", "/world_file", "/world_path")
#: Begins of the names of MERLIN's packages, and further packages whose nodes serve no actions.
OURS = ("merlin", "rosplan_")
WITHOUT_ACTIONS = {"robot_state_publisher", "rosbag", "rviz", "tf", "tf2_ros", "topic_tools"}
HOSTS = {("merlin_actions", "fsm_host"), ("merlin_actions", "naive_actions")}


class Loader(roslaunch.xmlloader.XmlLoader):
    """Finds the version and the name of ROS, which every launch sets, without processes of their own.

    Of a file that is not UTF-8 it says which.
    """

    _VERSION, _DISTRIBUTION = "rosversion roslaunch", "rosversion -d"

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        home = os.path.expanduser("~")
        if home != "~":  # its launch files ask for it, and services may have none
            os.environ.setdefault("HOME", home)

    def param_value(self, verbose: bool, name: str, ptype: str, *sources: Any) -> Any:
        """The value of a parameter.

        :param sources: value, text file, binary file and command; all but one are None.
        """
        found = None
        if sources[-1] == self._DISTRIBUTION:
            found = os.environ.get("ROS_DISTRO")
        elif sources[-1] == self._VERSION:
            with contextlib.suppress(rospkg.ResourceNotFound, OSError, ElementTree.ParseError):
                package = Path(rospkg.RosPack().get_path("roslaunch"), "package.xml")
                found = (ElementTree.parse(package).findtext("version") or "").strip()
        if found:
            return roslaunch.loader.convert_value(f"{found}\n", ptype)  # the command ends its line, too
        return super().param_value(verbose, name, ptype, *sources)

    def load_rosparam(
        self, context: Any, ros_config: Any, cmd: str, param: str, file_: Any, *more: Any, **options: Any
    ) -> None:
        """Loads parameters.

        :raises ValueError: when that is not possible; the text names the file.
        """
        try:
            super().load_rosparam(context, ros_config, cmd, param, file_, *more, **options)
        except UnicodeDecodeError as error:
            raise ValueError(f"{file_} is not UTF-8 text: {error.reason}") from error

    def add_param(self, ros_config: Any, param_name: str, param_value: Any, verbose: bool = True) -> None:
        """Adds a parameter, or those of a dictionary.

        :raises ValueError: a name is not a text; in YAML `on` is a truth value, and `1` a number.
        """
        for name in param_value if type(param_value) is dict else ():
            if not isinstance(name, str):
                raise ValueError(f"below {param_name}: {name!r} is not a text; write the name in quotes")
        super().add_param(ros_config, param_name, param_value, verbose=verbose)


def read_launch(request: LaunchRequest, port: Optional[int] = None) -> roslaunch.config.ROSLaunchConfig:
    """A launch file as roslaunch reads it.

    :param port: of the ROS master.
    :raises LaunchError: when it, or a file it includes, cannot be read, or nothing can be started so.
    """
    files = [(str(request.launch_file), request.words())]
    try:
        config = roslaunch.config.load_config_default(files, port, loader=Loader(), verbose=False)
    except Exception as error:  # of roslaunch, a missing package, or what an expression $(eval …) raises
        raise LaunchError(one_line(error)) from error
    parameters = values_of(config)
    check_values(parameters)
    check_words(config.nodes)
    check_scripts(config.nodes, parameters)
    return config


def values_of(config: roslaunch.config.ROSLaunchConfig) -> Dict[str, Any]:
    """The parameters that a launch file sets, name → value."""
    return {key: param.value for key, param in config.params.items()}


def check_values(parameters: Dict[str, Any]) -> None:
    """Looks for values that a ROS master cannot take.

    :raises LaunchError: there is one.
    """
    for key, value in parameters.items():
        try:
            xmlrpc.client.loads(xmlrpc.client.dumps((value,)))
        except (TypeError, OverflowError, RecursionError, ExpatError) as error:
            raise LaunchError(
                f"parameter {key} has a value that a ROS master cannot keep: {error}; it keeps texts (write "
                "dates in quotes), whole numbers of 32 bits, others, true, false, lists and dictionaries"
            ) from error


class LaunchConfig:
    """A launch file as roslaunch reads it.

    :raises LaunchError: when it, or a file it includes, cannot be read.
    """

    def __init__(self, request: LaunchRequest) -> None:
        config = read_launch(request)
        self.nodes: List[Node] = list(config.nodes)
        self._params = values_of(config)

    def param(self, name: str, default: Any = None) -> Any:
        """The value of a parameter; a folder of parameters becomes a dictionary."""
        return _param(self._params, name, default)

    def hosts(self) -> Iterator[Tuple[str, Node]]:
        """The hosts of action classes, with their namespaces, which end in a slash."""
        for node in self.nodes:
            if (node.package, node.type) in HOSTS:
                yield node.namespace, node

    def knowledge_base(self, host: Node) -> str:
        """Global name of the knowledge base of a host."""
        return dict(host.remap_args).get(KNOWLEDGE_BASE, f"{host.namespace}{KNOWLEDGE_BASE}")

    def robots(self) -> List[str]:
        """The robots that it names; empty: it starts one robot without a name."""
        names = [self.param(f"{namespace}{host.name}/robot", "") for namespace, host in self.hosts()]
        return [str(name) for name in names if name]

    def servers(self, namespace: str) -> Dict[str, str]:
        """Actions that a namespace's nodes serve → the node."""
        return {action: node.name for action, node in self._servers(namespace)}

    def judges(self, namespace: str) -> Dict[str, Callable[[Sequence[str]], str]]:
        """Actions that a namespace's nodes serve → what the server says of words or classes."""
        return {
            action: load_function(JUDGES[node.package, node.type])
            for action, node in self._servers(namespace)
            if (node.package, node.type) in JUDGES
        }

    def _servers(self, namespace: str) -> Iterator[Tuple[str, Node]]:
        for node in self.nodes:
            if node.namespace != namespace:
                continue
            actions: Any = SERVED.get((node.package, node.type), "")
            if (node.package, node.type) == ("merlin_actions", "simulated_action_server"):
                actions = self.param(f"{namespace}{node.name}/action", "")
            for action in actions if isinstance(actions, list) else [str(actions)] * bool(actions):
                yield dict(node.remap_args).get(action, action), node

    @property
    def strangers(self) -> List[str]:
        """Nodes that are not MERLIN's: which actions they serve is not known."""
        return [
            full_name(node)
            for node in self.nodes
            if not node.package.startswith(OURS) and node.package not in WITHOUT_ACTIONS
        ]

    @property
    def has_robot(self) -> bool:
        """Whether it starts something that stands in for a robot, so that no server comes from elsewhere."""
        return any((node.package, node.type) in STAND_INS for node in self.nodes)

    def file(self, name: str) -> Path:
        """The file that a parameter names.

        :raises LaunchError: when it names none, or the file is missing.
        """
        value = str(self.param(name, ""))
        if not value or not is_file(Path(value)):
            raise LaunchError(f"parameter {name} names no file that exists: '{value}'; give its path")
        return Path(value)


def check_files(parameters: Dict[str, Any]) -> None:
    """Looks for the files that parameters name.

    :raises LaunchError: one is missing.
    """
    for key, value in parameters.items():
        if key.endswith(FILE_PARAMETERS) and value and not is_file(Path(str(value))):
            raise LaunchError(
                f"the file {value} (parameter {key}) is missing; give the path of one that exists"
            )


def check_words(nodes: Iterable[Node]) -> None:
    """Takes the command lines of nodes apart, as roslaunch does when it starts them.

    :raises LaunchError: a quotation mark stands alone.
    """
    for node in nodes:
        for text in (node.args, node.launch_prefix or ""):
            try:
                shlex.split(text)
            except ValueError as error:
                raise LaunchError(f"node {full_name(node)}: {text}: {error}") from None


def check_scripts(nodes: Iterable[Node], parameters: Dict[str, Any]) -> None:
    """Looks at what simulated servers hear and see, and what simulated persons answer.

    :raises LaunchError: it has a wrong shape, or names a robot that there is not.
    """
    for node in nodes:
        if (node.package, node.type) not in SCRIPTED:
            continue
        own = full_name(node)
        robot, robots = str(_param(parameters, f"{own}/robot", "")), _param(parameters, f"{own}/robots", [])
        for key in ("answers", "sees"):
            try:
                value = of_robot(key, _param(parameters, f"{own}/{key}"), robot, robots)
                if node.package == "merlin_actions":
                    fields_of({key: value})
                elif value is not None:
                    texts(key, value)
            except ValueError as error:
                raise LaunchError(str(error)) from None


def full_name(node: Node) -> str:
    """A node's name with its namespace."""
    return f"{node.namespace}{node.name}"


def _param(parameters: Dict[str, Any], name: str, default: Any = None) -> Any:
    if name in parameters:
        return parameters[name]
    found: Dict[str, Any] = {}
    for key, value in parameters.items():
        if key.startswith(f"{name}/"):
            *folders, last = key[len(name) + 1 :].split("/")
            place = found
            for folder in folders:
                place = place.setdefault(folder, {})
            place[last] = value
    return found or default


def check_executables(nodes: Iterable[Node]) -> None:
    """Looks for the executables of nodes; roslaunch itself would start the others and continue.

    :raises LaunchError: one is missing.
    """
    rospack = rospkg.RosPack()
    for node in nodes:
        try:
            found = roslib.packages.find_node(node.package, node.type, rospack=rospack)
        except rospkg.ResourceNotFound:
            found = []
        if not found:
            raise LaunchError(
                f"there is no executable {node.package}/{node.type} (node '{node.name}'); "
                "correct the name, or run 'make build' if it is new"
            )
