# SPDX-License-Identifier: Apache-2.0
"""Registering a node once more: at a master that was started anew, or hung while something was asked."""

import threading
import xmlrpc.client
from typing import Any, Callable, Dict, List, NamedTuple, Set, Tuple

import rosgraph
import rospy
from rospy.impl.registration import get_service_manager

from merlin_ros.master import master_link

#: Longest wait for this node's own answers, s of wall time.
OWN_TIMEOUT = 2.0


class RegistrationError(Exception):
    """The master refused something; the text says what and why."""


class Registrations(NamedTuple):
    """What a node has registered."""

    published: Dict[str, str]
    """Topics this node publishes → type."""
    subscribed: Dict[str, str]
    """Topics this node subscribes to → type."""
    served: Dict[str, str]
    """Services of this node → address."""


class KeptParameters:
    """The parameters that this node brings back to a master that has lost them.

    Those below the names given to :meth:`keep`, ``/use_sim_time``, and what was read or set by
    :mod:`merlin_ros.master.master_link`.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards both fields
        self._names: Set[str] = {"/use_sim_time"}
        self._values: Dict[str, Any] = {}

    def keep(self, name: str) -> None:
        """Keeps a parameter, or all below a name.

        :param name: global.
        """
        with self._lock:
            self._names.add(name)

    def look(self, master: rosgraph.Master, *only: str) -> Dict[str, Any]:
        """Notes the present values, and returns them. What is no longer set is kept as it was.

        :param only: some of the names; none: all of them.
        :raises OSError: when the master does not answer.
        """
        with self._lock:
            names = set(only) or set(self._names)
        present = master_link.ask_each(master, "getParam", names)
        with self._lock:
            self._values.update(present)
        return present

    def restore(self, master: rosgraph.Master) -> None:
        """Sets each parameter that the master does not have. One that it cannot take is logged.

        :raises OSError: when the master does not answer.
        """
        with self._lock:
            values = {**master_link.known_params(), **self._values}
        for name, value in values.items():
            for leaf, leaf_value in _leaves(name, value):
                try:
                    if not master.hasParam(leaf):
                        master.setParam(leaf, leaf_value)
                except UNSENDABLE as error:  # the node and its other parameters shall be there all the same
                    rospy.logerr(f"the parameter {leaf} cannot be set at the new master: {error}")


def _leaves(name: str, value: Any) -> List[Any]:
    """A parameter's parts that are not mappings: one of them may have been set anew, the others not."""
    if not isinstance(value, dict) or not value:
        return [(name, value)]
    return [leaf for key, part in value.items() for leaf in _leaves(f"{name}/{key}", part)]


def register_again(master: rosgraph.Master, going_on: Callable[[], bool]) -> None:
    """Makes the master's picture of this node true again.

    Registers publishers, subscribers and services, connects to the publishers that the master names, and
    takes back what the master has of this node and is there no more. What is registered already stays so.

    :param master: with calls that end.
    :param going_on: asked before each step; registering a node that ends would harm the next of its name.
    :raises OSError: when the master, or this node itself, does not answer.
    :raises RegistrationError: when the master refuses.
    """
    uri, name = rospy.core.get_node_uri(), rospy.get_name()
    node = master_link.bounded_proxy(uri, OWN_TIMEOUT)
    register_at(master, name, uri, _own(node, name), going_on)
    if going_on():
        _take_back(master, node, name, uri)


def register_at(
    master: rosgraph.Master, name: str, uri: str, things: Registrations, going_on: Callable[[], bool]
) -> None:
    """Registers what a node has, and connects it to the publishers that the master names.

    :param name: of the node, which may be another one than this.
    :param uri: of its XML-RPC server.
    :param going_on: asked before each step.
    :raises OSError: when the master, or the node, does not answer.
    :raises RegistrationError: when the master refuses.
    """
    node = master_link.bounded_proxy(uri, OWN_TIMEOUT)
    for topic, kind in things.published.items():
        if not going_on():
            return
        answer_of(master.handle.registerPublisher(name, topic, kind, uri))
    for topic, kind in things.subscribed.items():
        if not going_on():
            return
        _subscribe(master, node, name, uri, topic, kind)
    for service, address in things.served.items():
        if not going_on():
            return
        answer_of(master.handle.registerService(name, service, address, uri))


def subscribe_again(topic: str, kind: str) -> List[str]:
    """Connects this node to the publishers of a topic that it has subscribed to.

    The master tells a node once of each new publisher: what it has said to one that hung may be lost.

    :param topic: global.
    :param kind: type of the topic.
    :return: the addresses of the nodes that publish it.
    :raises OSError: when the master, or this node itself, does not answer.
    :raises RegistrationError: when the master refuses.
    """
    uri = rospy.core.get_node_uri()
    node = master_link.bounded_proxy(uri, OWN_TIMEOUT)
    return _subscribe(master_link.bounded_master(), node, rospy.get_name(), uri, topic, kind)


def _subscribe(
    master: rosgraph.Master, node: xmlrpc.client.ServerProxy, name: str, uri: str, topic: str, kind: str
) -> List[str]:
    publishers: List[str] = answer_of(master.handle.registerSubscriber(name, topic, kind, uri))
    if publishers:
        try:
            node.publisherUpdate("/master", topic, publishers)
        except master_link.ERRORS as error:  # of the node; the master answers
            raise RegistrationError(f"{name} does not take the publishers of {topic}: {error}") from error
    return publishers


def _own(node: xmlrpc.client.ServerProxy, name: str) -> Registrations:
    """The registrations of this node."""
    # Asked as another node would ask: rospy's own list may be locked by a call that waits for the master.
    published, subscribed = topics_of(node, name)
    services = get_service_manager()
    if not services.lock.acquire(timeout=OWN_TIMEOUT):
        raise master_link.MasterSilent(f"{name} is busy announcing a service")
    try:
        return Registrations(published, subscribed, dict(services.get_services()))
    finally:
        services.lock.release()


def _take_back(master: rosgraph.Master, node: xmlrpc.client.ServerProxy, name: str, uri: str) -> None:
    has = [{thing for thing, nodes in part if name in nodes} for part in master.getSystemState()]
    published, subscribed, served = _own(node, name)
    for topic in has[0].difference(published):
        master.handle.unregisterPublisher(name, topic, uri)
    for topic in has[1].difference(subscribed):
        master.handle.unregisterSubscriber(name, topic, uri)
    for service in has[2].difference(served):
        master.handle.unregisterService(name, service, master.lookupService(service))


def topics_of(node: xmlrpc.client.ServerProxy, name: str) -> Tuple[Dict[str, str], Dict[str, str]]:
    """What a node publishes and subscribes to, by topic its type.

    :param name: of the node.
    :raises OSError: when it does not answer.
    :raises RegistrationError: when it answers something else.
    """
    answers = answer_of(node.getPublications(name)), answer_of(node.getSubscriptions(name))
    try:
        published, subscribed = ({str(topic): str(kind) for topic, kind in topics} for topics in answers)
    except (TypeError, ValueError) as error:
        raise RegistrationError(f"{name} does not say what its topics are: {error}") from error
    return published, subscribed


def answer_of(answer: Any) -> Any:
    """The value in an answer of a master or a node.

    :raises RegistrationError: when it is a refusal, or no answer as ROS knows it.
    """
    try:
        code, text, value = answer
    except (TypeError, ValueError) as error:
        raise RegistrationError(f"an answer is {answer!r}") from error
    if code != 1:
        raise RegistrationError(text)
    return value


#: What a value may raise that XML-RPC cannot carry: a number beyond 32 bits, half of a character.
UNSENDABLE = (TypeError, ValueError, OverflowError, xmlrpc.client.Error, rosgraph.MasterException)
#: What a refused or unanswered registration may raise.
ERRORS = (*master_link.ERRORS, RegistrationError)
