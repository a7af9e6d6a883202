# SPDX-License-Identifier: Apache-2.0
"""Whether another node of a name lives: starting a second one would make the master end the first."""

import socket
import xmlrpc.client
from typing import Any, NamedTuple, Optional
from urllib.parse import urlparse

import rosgraph
import rospy
from rospy.impl.masterslave import ROSHandler

from merlin_ros.master import master_link

#: Longest wait for a node's answer, s of wall time.
TIMEOUT = 1.0
#: In what a master says to the earlier of two nodes of one name.
_SAME_NAME = "new node registered with same name"


class Namesake(NamedTuple):
    """A node that lives."""

    name: str
    uri: str
    process: int
    """Its process id; 0: it does not answer."""

    def refusal(self) -> str:
        """The error message for a second node of the name."""
        if self.process:
            which = f"process {self.process} at {self.uri}"
            remedy = "end that one first"
        else:
            which = f"at {self.uri}, which takes connections and does not answer: it hangs"
            remedy = f"kill that one first (ss -ltnp 'sport = :{urlparse(self.uri).port}' shows its process)"
        return (
            f"node {self.name} runs already ({which}); {remedy}, or name this one differently with __name:="
        )


def living_namesake(name: str, master: rosgraph.Master) -> Optional[Namesake]:
    """The living node of a name; None: no such node, or it is dead, or its machine cannot be reached.

    :param name: global.
    :param master: with calls that end.
    :raises OSError: when the master does not answer.
    """
    try:
        uri = str(master.lookupNode(name))
    except rosgraph.MasterException:
        return None
    if not _takes_connections(uri):
        return None
    node = master_link.bounded_proxy(uri, TIMEOUT)
    try:
        if _name_of(node, name) != name:
            return None  # a dead node's port has gone to another one
        answer: Any = node.getPid(name)
        return Namesake(name, uri, int(answer[2]))
    except master_link.MasterSilent:
        return Namesake(name, uri, 0)
    except (*master_link.ERRORS, ValueError, TypeError, IndexError):
        return None  # it died meanwhile, or what listens there is not a node


def ignore_strays() -> None:
    """From now on rospy ends the node for a second one of its name only; once, before `rospy.init_node`.

    A master says that to the address of the earlier node. Where that one was killed, its port may be this
    node's by now, which may have another name, or another master.
    """
    shutdown = ROSHandler.shutdown

    def shutdown_if_replaced(handler: Any, caller_id: str, reason: str = "") -> Any:
        if _SAME_NAME not in str(reason) or not _is_registered(handler.uri):
            return shutdown(handler, caller_id, reason)
        rospy.logwarn(f"{rospy.get_name()}: not for this node, which goes on: {reason}")
        return 1, "that is another node", 0

    ROSHandler.shutdown = shutdown_if_replaced


def _is_registered(uri: str) -> bool:
    """Whether the master has this node at its address; a second one of its name has replaced that."""
    try:
        return str(master_link.bounded_master(TIMEOUT).lookupNode(rospy.get_name())) == uri
    except master_link.ERRORS:
        return False


def _takes_connections(uri: str) -> bool:
    address = urlparse(uri)
    try:
        with socket.create_connection((address.hostname or "", address.port or 0), TIMEOUT):
            return True
    except (OSError, ValueError):
        return False


def _name_of(node: xmlrpc.client.ServerProxy, name: str) -> str:
    try:
        return str(node.getName(name)[2])  # type: ignore[index]
    except xmlrpc.client.Fault:
        return name  # only nodes in Python answer with their name
