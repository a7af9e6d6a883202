# SPDX-License-Identifier: Apache-2.0
"""Whether the guard is wired as it should: the one way to the base, and motion servers that exist."""

import threading
import time
from typing import List, Set

import rospy

from merlin_guard.guard_parameters import GuardParameters
from merlin_guard.ros_graph import MASTER_ERRORS, RosGraph
from merlin_ros.parameters import ParameterError

PERIOD = 5.0  # s of wall time between two looks at the ROS graph


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
        self._graph = RosGraph(rospy.get_name())
        self._lock = threading.Lock()  # guards _unheard
        self._unheard: Set[str] = set(parameters.servers)
        self._warned: Set[str] = set()  # servers that a warning named; only the thread uses it
        self._bypassing: List[str] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="guard surroundings", daemon=True)

    def check_start(self) -> None:
        """Checks what has to be right before the guard begins.

        :raises ParameterError: when it is not, with what to do.
        """
        if self._input == self._output:
            raise ParameterError(
                f"cmd_vel_in and cmd_vel are the same topic, {self._output}: what the guard sends would come "
                "back. Remap cmd_vel_in to the topic of navigation, or cmd_vel to that of the base"
            )
        try:
            guards = self._graph.other_guards(self._output)
            neighbours = self._graph.other_guards(self._status)
        except MASTER_ERRORS as error:
            raise ParameterError(f"the master does not say which guards there are: {error}") from error
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
            except MASTER_ERRORS as error:
                rospy.logwarn_throttle(60.0, f"{rospy.get_name()}: the master does not answer: {error}")
            left = self._server_wait - (time.monotonic() - begun)
            self._over.wait(min(PERIOD, left) if left > 0.0 else PERIOD)

    def _check_bypass(self) -> None:
        found = self._graph.other_publishers(self._output)
        if found and found != self._bypassing:
            rospy.logwarn(
                f"{rospy.get_name()}: {', '.join(found)} publishes on {self._output}, past the guard, which "
                f"cannot stop it. Remap its cmd_vel to {self._input}"
            )
        self._bypassing = found

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
