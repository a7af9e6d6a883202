# SPDX-License-Identifier: Apache-2.0
"""One container as introspection shows it."""

import threading
import time
from typing import Any, Callable, Dict, Iterable, List, Optional, Sequence

import rospy
from smach_msgs.msg import SmachContainerStatus, SmachContainerStructure

import smach
from smach.container import Container
from smach.labels import text_of
from smach_ros.userdata_codec import encode

CHEAP = 0.0005  # s of encoding that is always allowed
SHARE = 20  # encoding that takes longer takes at most one part in so many of the time


class ContainerProxy:
    """Makes the messages of a container.

    :param path: of the container.
    :param container: the container.
    """

    def __init__(self, path: str, container: Container) -> None:
        self.path = path
        self.container = container
        self._note: Optional[Callable[[ContainerProxy, List[str], str], None]] = None
        self._lock = threading.Lock()  # guards the encoded userdata
        self._local_data = ""
        self._encode_after = 0.0  # monotonic time

    def attach(self, note: Callable[["ContainerProxy", List[str], str], None]) -> None:
        """Reports changes: ``note(proxy, active states, info)``, in the container's thread."""
        if self._note is not None:
            return
        self._note = note
        self.container.register_start_cb(self._started)
        self.container.register_transition_cb(self._moved)
        self.container.register_termination_cb(self._terminated)

    def detach(self) -> None:
        """Ends the reports."""
        self._note = None
        for cb in (self._started, self._moved, self._terminated):
            self.container.unregister_cb(cb)

    def _started(self, userdata: smach.UserData, initial_states: List[str]) -> None:
        self._report(self.container.get_active_states(), "START")

    def _moved(self, userdata: smach.UserData, active_states: List[str]) -> None:
        self._report(active_states, "TRANSITION")

    def _terminated(self, userdata: smach.UserData, terminal_states: List[str], outcome: str) -> None:
        self._report(self.container.get_idle_states(), f"TERMINATED: {text_of(outcome)}")

    def _report(self, active: List[str], info: str) -> None:
        note = self._note
        if note is not None:
            note(self, list(active), info)

    def structure(self) -> SmachContainerStructure:
        """What the container consists of."""
        container = self.container
        message = SmachContainerStructure(path=self.path, children=texts(container.get_children()))
        message.header.stamp = rospy.Time.now()
        for outcome, source, target in container.get_internal_edges():
            message.internal_outcomes.append(text_of(outcome))
            message.outcomes_from.append(text_of(source))
            message.outcomes_to.append(text_of(target))
        message.container_outcomes = texts(container.get_registered_outcomes())
        return message

    def status(self, active: Optional[List[str]], info: str) -> SmachContainerStatus:
        """What the container does.

        :param active: labels of its active states; None: those of now.
        :param info: why the message is sent.
        """
        container = self.container
        message = SmachContainerStatus(path=self.path, info=info)
        message.header.stamp = rospy.Time.now()
        message.initial_states = texts(container.get_initial_states())
        message.active_states = texts(container.get_active_states() if active is None else active)
        message.local_data = self._encoded()
        return message

    def _encoded(self) -> str:
        with self._lock:
            begin = time.monotonic()
            if begin >= self._encode_after:
                with self.container.userdata.locked():
                    values = dict(self.container.userdata._data)
                self._local_data = encode(values)
                end = time.monotonic()
                # Large values must not slow down a machine that makes many transitions.
                cost = end - begin
                self._encode_after = end + cost * SHARE if cost > CHEAP else 0.0
            return self._local_data

    def initialise(self, initial_states: Sequence[str], values: Dict[str, Any]) -> None:
        """Sets initial states and userdata.

        :param initial_states: texts of labels.
        :raises smach.SmachError: a label that is not one of the container's.
        """
        labels = {text_of(label): label for label in self.container.get_children()}
        unknown = [text for text in initial_states if text not in labels]
        if unknown:
            raise smach.InvalidStateError(
                f"'{self.path}' has no states {unknown}; its states: {list(labels)}"
            )
        userdata = smach.UserData()
        userdata.update(values)
        self.container.set_initial_state([labels[text] for text in initial_states], userdata)


def texts(names: Iterable[str]) -> List[str]:
    """Labels or outcomes as messages carry them."""
    return [text_of(name) for name in names]
