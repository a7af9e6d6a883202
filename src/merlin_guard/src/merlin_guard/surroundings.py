# SPDX-License-Identifier: Apache-2.0
"""Whether the guard is wired as it should: the one way to the base, and motion servers that exist."""

import contextlib
import threading
import time
from typing import Any, Dict, List, Set

import rosgraph
import rospy

from merlin_guard.guard_parameters import GuardParameters
from merlin_ros.master.master_link import ERRORS, MASTER_TIMEOUT, MasterSilent, bounded_master, bounded_proxy
from merlin_ros.parameters import ParameterError

GUARD_TYPE = "merlin_msgs/GuardStatus"
STATUS_TYPE = "actionlib_msgs/GoalStatusArray"
ANSWER = 2.0  # s for a node to answer
PERIOD = 5.0  # s of wall time between two looks at the ROS graph


class NodeGone(Exception):
    """The process of a node that the master knows has ended."""


def publications(node_uri: str) -> Dict[str, str]:
    """Topics and types that a node says it publishes.

    :raises NodeGone: nothing answers there.
    :raises OSError: it does not answer in time.
    """
    try:
        answer: Any = bounded_proxy(node_uri, ANSWER).getPublications("/merlin_guard")
        _, _, topics = answer
        return dict(topics)
    except ConnectionError as error:
        raise NodeGone(node_uri) from error
    except OSError:
        raise
    except (*ERRORS, TypeError, ValueError) as error:
        raise NodeGone(f"{node_uri} is no longer a node: {error}") from error


class RosGraph:
    """Questions to the master, each with an end. Not for several threads at a time.

    All methods raise one of :data:`merlin_ros.master.master_link.ERRORS` when the master does not answer.
    """

    def __init__(self) -> None:
        self._master = bounded_master(MASTER_TIMEOUT)

    def other_guards(self, topic: str) -> List[str]:
        """Guards other than this one that publish a topic; a text for one that does not answer."""
        publishers = self._publishers()
        status = [name for name, kind in self._master.getTopicTypes() if kind == GUARD_TYPE]
        guards = {node for name in status for node in publishers.get(name, ())}
        silent = " (which does not answer; end its process)"
        return self._living(topic, guards.intersection(publishers.get(topic, ())), silent)

    def other_publishers(self, topic: str) -> List[str]:
        """Nodes other than this one that answer, and publish a topic, too."""
        return self._living(topic, set(self._publishers().get(topic, ())))

    def actions(self) -> List[str]:
        """Resolved names of the actions that are served."""
        suffix = "/status"
        served = self._publishers()
        return sorted(
            name[: -len(suffix)]
            for name, type_name in self._master.getTopicTypes()
            if type_name == STATUS_TYPE and name.endswith(suffix) and served.get(name)
        )

    def _living(self, topic: str, nodes: Set[str], silent: str = "") -> List[str]:
        """Those of the nodes that publish a topic, without this one.

        :param silent: is added to the name of one that does not answer; empty: such a node is left out.
        """
        found = []
        for node in sorted(nodes - {rospy.get_name()}):
            with contextlib.suppress(NodeGone, rosgraph.MasterException):
                address = self._master.lookupNode(node)
                try:
                    found += [node] if topic in publications(address) else []
                except OSError:
                    found += [f"{node}{silent}"] if silent else []
        return found

    def _publishers(self) -> Dict[str, List[str]]:
        publishers, _, _ = self._master.getSystemState()
        return dict(publishers)


class Surroundings:
    """Looks at the ROS graph at the start and every few seconds, and says what is wrong with it.

    :param input_topic: resolved name of the topic on which velocities come.
    :param output_topic: resolved name of the topic to the base.
    :param parameters: of the node.
    """

    def __init__(self, input_topic: str, output_topic: str, parameters: GuardParameters) -> None:
        self._input = input_topic
        self._output = output_topic
        self._status = rospy.resolve_name("merlin/guard")
        self._server_wait = parameters.server_wait
        self._graph = RosGraph()
        self._lock = threading.Lock()  # guards _unheard
        self._unheard: Set[str] = set(parameters.servers)
        self._warned: Set[str] = set()  # servers that a warning named; only the thread uses it
        self._joy = rospy.resolve_name("joy") if parameters.stop_button >= 0 else ""
        self._said: Dict[str, str] = {}  # about what → the last warning
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="guard surroundings", daemon=True)

    def check_start(self) -> None:
        """Checks what has to be right before the guard begins.

        :raises ParameterError: when it is not, with what to do.
        :raises MasterSilent: the master does not answer, or not sensibly.
        """
        if self._input == self._output:
            raise ParameterError(
                f"cmd_vel_in and cmd_vel are the same topic, {self._output}: what the guard sends would come "
                "back. Remap cmd_vel_in to the topic of navigation, or cmd_vel to that of the base"
            )
        try:
            guards = self._graph.other_guards(self._output)
            neighbours = self._graph.other_guards(self._status)
        except ERRORS as error:
            raise MasterSilent(f"which guards there are is not known: {error}") from error
        if guards:
            raise ParameterError(
                f"{', '.join(guards)} guards {self._output} already. A base has one guard: end that one, or "
                "remap cmd_vel of this one to the topic of another base"
            )
        if neighbours:
            raise ParameterError(
                f"{', '.join(neighbours)} publishes {self._status} and serves merlin/stop already. A guard "
                "of another base needs a namespace of its own"
            )

    def start(self) -> None:
        """Begins to look; ends with the node."""
        rospy.on_shutdown(self._over.set)
        self._thread.start()

    def heard(self, server: str) -> None:
        """A motion server has published its status."""
        with self._lock:
            self._unheard.discard(server)

    def _watch(self) -> None:
        begun = time.monotonic()
        while not self._over.is_set():
            try:
                self._check_bypass()
                if time.monotonic() - begun >= self._server_wait:
                    self._check_servers()
                    self._check_joy()
            except ERRORS as error:
                rospy.logwarn_throttle(60.0, f"{rospy.get_name()}: the master does not answer: {error}")
            left = self._server_wait - (time.monotonic() - begun)
            self._over.wait(min(PERIOD, left) if left > 0.0 else PERIOD)

    def _check_bypass(self) -> None:
        found = self._graph.other_publishers(self._output)
        what = f"{', '.join(found)} publishes on {self._output}, past the guard, which cannot stop it. "
        self._warn("bypass", f"{what}Remap its cmd_vel to {self._input}" if found else "")

    def _check_joy(self) -> None:
        joyless = bool(self._joy) and not self._graph.other_publishers(self._joy)
        what = f"nothing publishes {self._joy}, so ~stop_button cannot stop the base"
        self._warn("joy", what if joyless else "")

    def _warn(self, about: str, text: str) -> None:
        """Says once what is wrong, as long as it is the same; empty: nothing is."""
        if text and text != self._said.get(about):
            rospy.logwarn(f"{rospy.get_name()}: {text}")
        self._said[about] = text

    def _check_servers(self) -> None:
        with self._lock:
            missing = self._unheard - self._warned
        if missing:
            known = ", ".join(self._graph.actions()) or "none"
            rospy.logwarn(
                f"{rospy.get_name()}: no motion server {', '.join(sorted(missing))} after "
                f"{self._server_wait:g} s; without one nothing drives. Actions that are served: {known}. "
                "Set ~motion_servers"
            )
            self._warned |= missing
