# SPDX-License-Identifier: Apache-2.0
"""A robot says that it lives: the host of its state machines does, for all bridges of the planning system."""

import re
import threading
import time
from typing import Mapping, Set

import rospy
from merlin_msgs.msg import RobotHost
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from merlin_actions.core.robot_book import GONE_AFTER, WORD_PERIOD
from merlin_ros.actions.lease_holder import LIFE
from merlin_ros.actions.peers import connected_peers
from merlin_ros.alarms import call_later, every
from merlin_ros.master.master_link import ERRORS, MasterSilent, bounded_master, get_param, set_param
from merlin_ros.publishing import OnSubscriber, publish

CONNECT_LIMIT = 3.0  # s for the connections to other hosts; one that was killed keeps its entry at the master
CONNECTION_LOOK = 0.02  # s between two looks for them, of which rospy gives no event
TAKEN_OUT = "was taken out by its operator"
TAKEN_OUT_PARAM = "~taken_out"  # keeps it over a restart of the host
_NAME = re.compile(r"[a-z][a-z0-9_]*")


class RobotPresence:
    """Publishes ``<kb>/robots``, and serves ``merlin/available``, which takes the robot out and back in.

    A robot that was taken out stays out when its host is restarted.

    :param robot: its name, an object of the problem.
    :param knowledge_base: global name of the knowledge base.
    :param parameters: operator that it serves -> the variable that names the robot.
    :raises ValueError: when the name cannot be that of a robot.
    """

    def __init__(self, robot: str, knowledge_base: str, parameters: Mapping[str, str]) -> None:
        if not _NAME.fullmatch(robot):
            raise ValueError(
                f"a robot cannot be named {robot!r}: small letters, digits and _ make its namespace"
            )
        self.robot = robot
        self._parameters = dict(parameters)
        self._changed = threading.Condition()  # guards the fields below and the order of messages
        self._keeping = threading.Lock()  # orders those that take the robot out and in
        self._out = TAKEN_OUT if get_param(TAKEN_OUT_PARAM, False) else ""
        self._begun = self._ended = False
        self._others: Set[str] = set()
        newcomers = OnSubscriber(lambda _: call_later(0.0, self._beat))  # a bridge hears of it at once
        self._topic = f"{knowledge_base}/robots"
        self._publisher = rospy.Publisher(
            self._topic, RobotHost, subscriber_listener=newcomers, queue_size=10
        )

    def refuse_second(self) -> None:
        """Listens for another host of the same robot, as long as it may be silent.

        A busy machine opens connections late, so that time begins when all hosts are connected.

        :raises ValueError: when there is one.
        """
        hosts = self._hosts()
        listener = rospy.Subscriber(self._topic, RobotHost, self._hear, tcp_nodelay=True)
        last = time.monotonic() + CONNECT_LIMIT
        with self._changed:
            while not self._others and not rospy.is_shutdown():
                now = time.monotonic()
                if now < last and not hosts <= connected_peers(listener):
                    self._changed.wait(CONNECTION_LOOK)
                    continue
                self._changed.wait_for(lambda: self._others, GONE_AFTER / 2)
                break
        listener.unregister()
        if self._others:
            raise ValueError(
                f"{', '.join(sorted(self._others))} says already that it is robot {self.robot}; "
                "give this one another name"
            )

    def _hosts(self) -> Set[str]:
        """The other nodes that say that a robot lives; none when the master does not answer."""
        try:
            publishers = dict(bounded_master().getSystemState()[0])
        except ERRORS:
            return set()
        return set(publishers.get(self._topic, [])) - {rospy.get_name()}

    def start(self) -> None:
        """Begins to say that the robot lives."""
        service = rospy.Service("merlin/available", SetBool, self._serve_available)
        if self._out:
            rospy.logwarn(
                f"robot {self.robot} {TAKEN_OUT}; it was so when its host began. "
                f"Call {service.resolved_name} with true to let it take actions again."
            )
        self._begun = True
        self._beat()
        every(WORD_PERIOD, self._beat)  # wall time: a paused simulator must not look like a death

    def shutdown(self) -> None:
        """Says that the robot leaves."""
        with self._changed:
            self._ended = True
            self._say()

    def _hear(self, word: RobotHost) -> None:
        if word.robot == self.robot and word.node != rospy.get_name() and not word.leaving:
            with self._changed:
                self._others.add(word.node)
                self._changed.notify_all()

    def _serve_available(self, request: SetBoolRequest) -> SetBoolResponse:
        said = f"robot {self.robot} {'takes actions' if request.data else TAKEN_OUT}"
        with self._keeping:
            with self._changed:
                self._out = "" if request.data else TAKEN_OUT
                self._say()
            try:
                set_param(TAKEN_OUT_PARAM, not request.data)
            except MasterSilent as error:
                said += f"; a restart of its host would not know that: {error}"
        rospy.loginfo(said)
        return SetBoolResponse(True, said)

    def _beat(self) -> None:
        with self._changed:
            if self._begun and not self._ended:
                self._say()

    def _say(self) -> None:
        """Called with the lock held."""
        message = RobotHost(
            robot=self.robot,
            node=rospy.get_name(),
            life=LIFE,
            out=self._out,
            leaving=self._ended,
            operators=list(self._parameters),
            robot_parameters=list(self._parameters.values()),
        )
        message.header.stamp = rospy.Time.now()
        publish(self._publisher, message)
