# SPDX-License-Identifier: Apache-2.0
"""What the master knows about the guard's surroundings: other guards, other publishers, motion servers."""

import contextlib
import http.client
import os
import sys
import xmlrpc.client
from typing import Any, Dict, List

import rosgraph
from rosgraph.names import get_ros_namespace, load_mappings, ns_join

GUARD_TYPE = "merlin_msgs/GuardStatus"
STATUS_TYPE = "actionlib_msgs/GoalStatusArray"
ANSWER = 2.0  # s for a node to answer

#: What a question to the master raises when it does not answer, or not sensibly.
MASTER_ERRORS = (rosgraph.MasterException, OSError, xmlrpc.client.Error, http.client.HTTPException)


class _Transport(xmlrpc.client.Transport):
    """HTTP that gives up: a hung node accepts connections and never answers."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = ANSWER
        return connection


class NodeGone(Exception):
    """The process of a node that the master knows has ended."""


def publications(node_uri: str) -> Dict[str, str]:
    """Topics and types that a node says it publishes.

    :raises NodeGone: nothing answers there.
    :raises OSError: it does not answer in time.
    """
    try:
        with xmlrpc.client.ServerProxy(node_uri, transport=_Transport()) as node:
            answer: Any = node.getPublications("/merlin_guard")
            _, _, topics = answer
    except ConnectionError as error:
        raise NodeGone(node_uri) from error
    except (xmlrpc.client.Error, http.client.HTTPException, ValueError) as error:
        raise NodeGone(f"{node_uri} is no longer a node: {error}") from error
    return dict(topics)


class RosGraph:
    """Questions to the master.

    :param caller: name of the node that asks.
    """

    def __init__(self, caller: str) -> None:
        self._caller = caller
        self._master = rosgraph.Master(caller)

    def other_guards(self, topic: str) -> List[str]:
        """Guards other than this one that publish a topic; a text for one that does not answer.

        :raises Exception: one of :data:`MASTER_ERRORS`, when the master does not answer.
        """
        guards = []
        types = dict(self._master.getTopicTypes())
        publishers = self._publishers()
        suspects = {
            node for name, nodes in publishers.items() if types.get(name) == GUARD_TYPE for node in nodes
        }
        for node in sorted(suspects.intersection(publishers.get(topic, ())) - {self._caller}):
            try:
                if topic in publications(self._master.lookupNode(node)):
                    guards.append(node)
            except (NodeGone, rosgraph.MasterException):
                continue
            except OSError:
                guards.append(f"{node} (which does not answer; end its process)")
        return guards

    def other_publishers(self, topic: str) -> List[str]:
        """Living nodes other than this one that publish a topic, too.

        :raises Exception: one of :data:`MASTER_ERRORS`, when the master does not answer.
        """
        found = []
        for node in sorted(set(self._publishers().get(topic, ())) - {self._caller}):
            with contextlib.suppress(NodeGone, rosgraph.MasterException, OSError):
                if topic in publications(self._master.lookupNode(node)):
                    found.append(node)
        return found

    def actions(self) -> List[str]:
        """Resolved names of the actions that are served.

        :raises Exception: one of :data:`MASTER_ERRORS`, when the master does not answer.
        """
        suffix = "/status"
        served = self._publishers()
        return sorted(
            name[: -len(suffix)]
            for name, type_name in self._master.getTopicTypes()
            if type_name == STATUS_TYPE and name.endswith(suffix) and served.get(name)
        )

    def _publishers(self) -> Dict[str, List[str]]:
        publishers, _, _ = self._master.getSystemState()
        return dict(publishers)


def living_guard_of_this_name(default_name: str) -> str:
    """The name that this process is going to have, if a living guard has it already; else empty.

    To be asked before `rospy.init_node`, because the master ends the older node of a name.
    """
    name = ns_join(get_ros_namespace(), load_mappings(sys.argv).get("__name", default_name))
    caller = f"/merlin_guard_start_{os.getpid()}"
    try:
        topics = publications(rosgraph.Master(caller).lookupNode(name))
    except (NodeGone, ValueError, *MASTER_ERRORS):  # init_node says what is wrong with the master
        return ""
    return name if GUARD_TYPE in topics.values() else ""
