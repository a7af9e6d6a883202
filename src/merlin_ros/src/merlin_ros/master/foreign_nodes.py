# SPDX-License-Identifier: Apache-2.0
"""Nodes that do not register again by themselves, such as those of roscpp and plain rospy: one node of MERLIN
registers them.

What the master has of all nodes is looked at now and then. At a master that was started anew those are
registered that it does not know and that live.
"""

from typing import Any, Callable, Dict, List, Optional, Set

import rosgraph
import rospy

from merlin_ros.master import master_link
from merlin_ros.master.registration import (
    ERRORS,
    OWN_TIMEOUT,
    RegistrationError,
    Registrations,
    register_at,
    topics_of,
)


class ForeignNodes:
    """The nodes of one master. For one thread."""

    def __init__(self) -> None:
        self._state: Any = None  # as the master gives it
        self._addresses: Dict[str, str] = {}  # node -> its XML-RPC server
        self._services: Dict[str, str] = {}  # service -> its address
        self._begun: Set[str] = set()  # nodes of which the master has only a part
        self._silent: Set[str] = set()  # nodes that did not answer in time

    def look(self, master: rosgraph.Master) -> None:
        """Notes what is registered now.

        :param master: with calls that end.
        :raises OSError: when it does not answer.
        """
        state = master.getSystemState()
        addresses = master_link.ask_each(master, "lookupNode", sorted(_nodes(state)))
        if (state, addresses) == (self._state, self._addresses):
            return
        self._services = master_link.ask_each(master, "lookupService", [service for service, _ in state[2]])
        self._state, self._addresses = state, addresses

    def restore(self, master: rosgraph.Master, going_on: Callable[[], bool]) -> List[str]:
        """Registers those that a new master does not know, and those that an earlier try has left half done.

        :param going_on: asked before each node.
        :return: their names.
        :raises OSError: when the master does not answer; to be tried again.
        :raises RegistrationError: when a node is done in part only, or did not answer for the first time, the
            others as far as possible; likewise.
        """
        # Not by its address: rospy asks for a parameter with each line of its log, and then has one there.
        known = _nodes(master.getSystemState())
        done: List[str] = []
        fault: Optional[RegistrationError] = None
        for name, uri in self._addresses.items():
            if (name in known and name not in self._begun) or name == rospy.get_name():
                continue
            try:
                things = self._registrations(name, uri)
            except ERRORS as error:  # it has ended, or hangs; or all has stalled: it is asked once more
                again = isinstance(error, master_link.MasterSilent) and name not in self._silent
                if again:
                    self._silent.add(name)
                if again or (name in self._begun and not isinstance(error, ConnectionRefusedError)):
                    fault = RegistrationError(f"{name} does not answer: {error}")
                continue
            self._silent.discard(name)
            if things is None or not going_on():
                continue
            self._begun.add(name)  # the master knows it from the first of its topics on
            try:
                register_at(master, name, uri, things, lambda: True)
            except RegistrationError as error:
                fault = error
                continue
            self._begun.discard(name)
            done.append(name)
        if fault is not None:
            raise fault
        return done

    def _registrations(self, name: str, uri: str) -> Optional[Registrations]:
        """The registrations that a node reports; None: another node has its address."""
        node = master_link.bounded_proxy(uri, OWN_TIMEOUT)
        published, subscribed = topics_of(node, name)
        if not self._topics(0, name) <= set(published) or not self._topics(1, name) <= set(subscribed):
            return None
        served = {service: self._services[service] for service in self._topics(2, name) & set(self._services)}
        return Registrations(published, subscribed, served)

    def _topics(self, part: int, name: str) -> Set[str]:
        return {thing for thing, nodes in self._state[part] if name in nodes}


def _nodes(state: Any) -> Set[str]:
    """Names of the nodes that have a topic or a service."""
    return {node for part in state for _, names in part for node in names}
