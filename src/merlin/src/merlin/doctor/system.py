# SPDX-License-Identifier: Apache-2.0
"""What runs below a master, for the doctor."""

import contextlib
import threading
from typing import Any, Dict, List, Tuple

import rospy
from actionlib_msgs.msg import GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray
from merlin_msgs.msg import GuardStatus
from rosgraph.network import parse_http_host_and_port
from tf2_msgs.msg import TFMessage

from merlin.doctor.findings import GUARD_TYPE, STATUS_TYPE, Graph, Heard
from merlin.local_names import is_own, resolves
from merlin_ros.master.master_link import ERRORS, bounded_master, bounded_proxy
from merlin_ros.work.threads import start_thread

CALLER = "/merlin_doctor"
ANSWER = 3.0  # s for a node to answer: after so much silence a server counts as dead, too
LISTEN = 3.5  # s: a status comes once per second, and a server that is silent for 3 s counts as dead
TYPES = {"/tf": TFMessage, "/tf_static": TFMessage, "/diagnostics": DiagnosticArray}


def look_at_graph() -> Graph:
    """Asks the master and each node.

    :raises Exception: one of :data:`merlin_ros.master.master_link.ERRORS`, when the master does not answer.
    """
    master = bounded_master()
    publishers, subscribers, services = master.getSystemState()
    names = {node for kind in (publishers, subscribers, services) for _, nodes in kind for node in nodes}
    silent: Dict[str, str] = {}
    hosts: Dict[str, str] = {}
    for thread in [start_thread(f"ask {name}", _ask, name, silent, hosts) for name in sorted(names)]:
        thread.join()  # each question ends by itself
    elsewhere = not is_own(parse_http_host_and_port(master.master_uri)[0])
    misnamed = {
        node: host for node, host in hosts.items() if not resolves(host) or (elsewhere and is_own(host))
    }
    commands = [name for name in master.getParamNames() if name.endswith("/planner_command")]
    return Graph(
        dict(publishers),
        dict(subscribers),
        dict(master.getTopicTypes()),
        silent,
        misnamed,
        master.hasParam("/use_sim_time") and bool(master.getParam("/use_sim_time")),
        any(master.getParam(name) for name in commands),
    )


def _ask(node: str, silent: Dict[str, str], hosts: Dict[str, str]) -> None:
    """Asks a node for a sign of life; notes why there is none, and its host. One that has ended is none."""
    try:
        uri = bounded_master(ANSWER).lookupNode(node)
    except ERRORS:
        return
    try:
        bounded_proxy(uri, ANSWER).getPid(CALLER)
    except ERRORS as error:
        silent[node] = f"{uri}: {getattr(error, 'strerror', None) or error}"
        with contextlib.suppress(ValueError):  # with a port in ROS_IP it is no address
            hosts[node] = parse_http_host_and_port(uri)[0]


class Listener:
    """Hears what a system publishes. In a node that is initialised.

    :param graph: what is published.
    """

    def __init__(self, graph: Graph) -> None:
        self._statuses = graph.of_type(STATUS_TYPE)
        self._guards = graph.of_type(GUARD_TYPE)
        self._others = [topic for topic in TYPES if graph.who(topic)]
        self._simulated = graph.simulated_time
        self._lock = threading.Lock()  # guards the fields below
        self._ahead: Dict[str, Any] = {}
        self._parents: Dict[str, List[str]] = {}
        self._health: Dict[str, Tuple[int, str]] = {}
        self._warnings: Dict[str, str] = {}

    def listen(self) -> Heard:
        """Listens for a while of wall time."""
        wanted = {
            **dict.fromkeys(self._statuses, GoalStatusArray),
            **dict.fromkeys(self._guards, GuardStatus),
            **{topic: TYPES[topic] for topic in self._others},
        }
        subscribers = [
            rospy.Subscriber(topic, kind, self._receive, topic, queue_size=100)
            for topic, kind in wanted.items()
        ]
        threading.Event().wait(LISTEN)
        for subscriber in subscribers:
            subscriber.unregister()
        with self._lock:
            # A message that is late changes none of what is judged.
            return Heard(
                LISTEN, dict(self._ahead), dict(self._parents), dict(self._health), dict(self._warnings)
            )

    def _receive(self, message: Any, topic: str) -> None:
        with self._lock:
            if isinstance(message, TFMessage):
                for each in message.transforms:
                    parents = self._parents.setdefault(each.child_frame_id.lstrip("/"), [])
                    parent = each.header.frame_id.lstrip("/")
                    if parent not in parents:
                        parents.append(parent)
                if topic == "/tf" and message.transforms:
                    self._note(topic, max(each.header.stamp for each in message.transforms))
            elif isinstance(message, DiagnosticArray):
                for state in message.status:
                    self._health[state.name] = (state.level, state.message)
            else:
                self._note(topic, message.header.stamp)
                if isinstance(message, GuardStatus):
                    self._warnings[topic] = message.warning

    def _note(self, topic: str, stamp: rospy.Time) -> None:
        # A simulator's time is one for all, and so fast that a message is late by more than a clock would be.
        known = not (stamp.is_zero() or self._simulated)
        self._ahead[topic] = (stamp - rospy.Time.now()).to_sec() if known else None
