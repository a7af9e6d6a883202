# SPDX-License-Identifier: Apache-2.0
"""Introspection: containers shown to, and set up from, other processes such as smach_viewer.

The topics of a server carry all its containers, so latching, which keeps one message, cannot serve a late
viewer. Instead every new subscriber gets the state of all containers at once, to itself. One thread per
server encodes and publishes; a container that makes a transition only leaves a note for it.
"""

import threading
import time
from typing import Any, Callable, Dict, List, Optional, Sequence

import rospy
import rostopic
from smach_msgs.msg import (
    SmachContainerInitialStatusCmd,
    SmachContainerStatus,
    SmachContainerStructure,
)

import smach
from smach.container import Container
from smach.labels import text_of
from smach_ros.container_proxy import ContainerProxy, texts
from smach_ros.userdata_codec import UserDataError, decode, encode
from smach_ros.waiting import OnSubscriber, wait_until_sent

__all__ = ["INIT_TOPIC", "STATUS_TOPIC", "STRUCTURE_TOPIC", "IntrospectionClient", "IntrospectionServer"]

STATUS_TOPIC = "/smach/container_status"
INIT_TOPIC = "/smach/container_init"
STRUCTURE_TOPIC = "/smach/container_structure"

HEARTBEAT = 2.0  # s of wall time between two messages that repeat a container's state
QUEUE = 1000  # messages that wait for a slow subscriber: several for each container
NOTES = 200  # transitions that wait to be published; of more, only the last of each container is
LAST_WORDS = 3.0  # s of wall time that a server that stops has for what a subscriber has not read
REMOTE_INIT = "REMOTE_INIT"  # info of the status that answers an init command
REPEAT_INIT = 0.3  # s of wall time between two init commands


class IntrospectionServer:
    """Publishes structure and status of a container and of all containers in it.

    :param server_name: topics are ``<server_name>/smach/container_…``; relative names as usual.
    :param state: the root container.
    :param path: of the root, by convention ``/SM_ROOT``.
    """

    def __init__(self, server_name: str, state: smach.State, path: str) -> None:
        self._server_name = server_name
        self._state = state
        self._path = path
        self._changed = threading.Condition()  # guards the fields below
        self._proxies: Dict[str, ContainerProxy] = {}
        self._notes: List[Callable[[], None]] = []
        self._dirty: Dict[str, str] = {}  # path -> info, of transitions that were skipped
        self._worker: Optional[threading.Thread] = None
        self._stopping = False
        self._structure_publisher: Optional[rospy.Publisher] = None
        self._status_publisher: Optional[rospy.Publisher] = None
        self._init_subscriber: Optional[rospy.Subscriber] = None

    def start(self) -> None:
        """Begins to publish; if it has begun, only finds the containers that :meth:`clear` forgot."""
        with self._changed:
            if not self._proxies:
                self._find(self._path, self._state)
            for proxy in self._proxies.values():
                proxy.attach(self._note)
            if self._worker is not None:
                return
            self._stopping = False
            self._notes.clear()
            self._dirty.clear()
            name = self._server_name
            self._structure_publisher = rospy.Publisher(
                name + STRUCTURE_TOPIC,
                SmachContainerStructure,
                OnSubscriber(lambda one: self._greet(one, self._structures)),
                queue_size=QUEUE,
            )
            self._status_publisher = rospy.Publisher(
                name + STATUS_TOPIC,
                SmachContainerStatus,
                OnSubscriber(lambda one: self._greet(one, self._statuses)),
                tcp_nodelay=True,
                queue_size=QUEUE,
            )
            self._init_subscriber = rospy.Subscriber(
                name + INIT_TOPIC, SmachContainerInitialStatusCmd, self._initialise
            )
            self._worker = threading.Thread(
                target=self._work, name=f"smach introspection {name}", daemon=True
            )
            self._worker.start()

    def stop(self) -> None:
        """Ends everything that :meth:`start` began."""
        with self._changed:
            worker, self._worker = self._worker, None
            if worker is None:
                return
            self._stopping = True
            for proxy in self._proxies.values():
                proxy.detach()
            topics = [self._structure_publisher, self._status_publisher, self._init_subscriber]
            self._changed.notify_all()
        if worker is not threading.current_thread():
            worker.join(LAST_WORDS + 2.0)
        if rospy.core.is_shutdown_requested():
            return  # rospy ends all of them at once; one by one they would ask a master that may hang
        for topic in topics:
            if topic is not None:
                topic.unregister()

    def clear(self) -> None:
        """Forgets the containers; :meth:`start` finds them anew."""
        with self._changed:
            for proxy in self._proxies.values():
                proxy.detach()
            self._proxies.clear()

    def _find(self, path: str, state: Any) -> None:
        if not isinstance(state, Container):
            return
        self._proxies[path] = ContainerProxy(path, state)
        for label, child in state.get_children().items():
            self._find(f"{'' if path == '/' else path}/{text_of(label)}", child)

    # --- publishing ----------------------------------------------------------------------------------------

    def _note(self, proxy: ContainerProxy, active: List[str], info: str) -> None:
        """A container has changed; called in its thread, so it only leaves a note."""
        with self._changed:
            if self._status_publisher is None or not self._status_publisher.get_num_connections():
                return
            if len(self._notes) >= NOTES:
                self._dirty[proxy.path] = info
                return
            self._notes.append(lambda: self._publish_status(proxy, active, info))
            self._changed.notify_all()

    def _work(self) -> None:
        heartbeat = time.monotonic() + HEARTBEAT  # a subscriber of before is greeted
        while True:
            with self._changed:
                while not self._notes and not self._stopping:
                    left = heartbeat - time.monotonic()
                    if left <= 0.0:
                        break
                    self._changed.wait(left)
                if rospy.is_shutdown():
                    return
                stopping = self._stopping
                notes, self._notes = self._notes, []
                dirty, self._dirty = self._dirty, {}
                proxies = dict(self._proxies)
            for note in notes:
                note()
            for path, info in dirty.items():
                if path in proxies:
                    self._publish_status(proxies[path], None, info)
            if stopping:
                wait_until_sent((self._structure_publisher, self._status_publisher), LAST_WORDS)
                return
            if time.monotonic() >= heartbeat:
                heartbeat = time.monotonic() + HEARTBEAT
                for proxy in proxies.values():
                    if self._structure_publisher and self._structure_publisher.get_num_connections():
                        self._publish(self._structure_publisher, proxy.structure)
                    if self._status_publisher and self._status_publisher.get_num_connections():
                        self._publish_status(proxy, None, "HEARTBEAT")

    def _greet(self, peer_publish: Callable[[Any], None], make: Callable[[], List[Any]]) -> None:
        """A subscriber has come. The worker serves it: rospy does not lock what goes to a single one."""

        def greet() -> None:
            for message in make():
                peer_publish(message)

        with self._changed:
            self._notes.append(lambda: self._guard(greet))
            self._changed.notify_all()

    def _publish_status(self, proxy: ContainerProxy, active: Optional[List[str]], info: str) -> None:
        self._publish(self._status_publisher, lambda: proxy.status(active, info))

    def _publish(self, publisher: Any, make: Callable[[], Any]) -> None:
        self._guard(lambda: publisher.publish(make()))

    def _guard(self, publish: Callable[[], None]) -> None:
        try:
            publish()
        except Exception as error:
            # A container that cannot be shown must not hide the others, nor end the thread.
            if not rospy.is_shutdown() and not self._stopping:
                rospy.logerr_throttle(
                    10.0, f"Introspection {self._server_name}: {type(error).__name__}: {error}"
                )

    def _structures(self) -> List[Any]:
        return [proxy.structure() for proxy in list(self._proxies.values())]

    def _statuses(self) -> List[Any]:
        return [proxy.status(None, "Initial state") for proxy in list(self._proxies.values())]

    # --- the init command ----------------------------------------------------------------------------------

    def _initialise(self, message: SmachContainerInitialStatusCmd) -> None:
        proxy = self._proxies.get(message.path)
        if proxy is None:
            return
        try:
            proxy.initialise(message.initial_states, decode(message.local_data))
        except (UserDataError, smach.SmachError) as error:
            rospy.logerr(f"Init command for '{message.path}' refused: {error}")
            return
        self._note(proxy, proxy.container.get_active_states(), REMOTE_INIT)


class IntrospectionClient:
    """Finds servers and sets up their containers."""

    def get_servers(self) -> List[str]:
        """Names of all introspection servers (as ``IntrospectionServer`` got them, resolved)."""
        topics = rostopic.find_by_type(SmachContainerStatus._type)
        return [topic[: -len(STATUS_TOPIC)] for topic in topics if topic.endswith(STATUS_TOPIC)]

    def set_initial_state(
        self,
        server: str,
        path: str,
        initial_states: Sequence[str],
        initial_userdata: Optional[smach.UserData] = None,
        timeout: Any = None,
    ) -> Optional[bool]:
        """Sets the initial state and userdata of a container.

        :param server: its server's name.
        :param path: of the container.
        :param timeout: rospy.Duration (or s) of wall time to wait for the answer; None: only sends.
        :return: whether the container has taken it over; None without a timeout.
        """
        values = dict(initial_userdata._data) if initial_userdata is not None else {}
        labels = texts(initial_states)
        command = SmachContainerInitialStatusCmd(path=path, initial_states=labels, local_data=encode(values))
        answered = threading.Event()

        def receive(status: SmachContainerStatus) -> None:
            # A server tells its state at other times, too: before it has read the command, or refuses it.
            taken = status.info == REMOTE_INIT and status.path == path
            if taken and list(status.initial_states) == labels:
                answered.set()

        publisher = _init_publisher(server + INIT_TOPIC)
        if timeout is None:
            publisher.publish(command)
            return None
        subscriber = rospy.Subscriber(server + STATUS_TOPIC, SmachContainerStatus, receive, tcp_nodelay=True)
        end = time.monotonic() + (timeout.to_sec() if hasattr(timeout, "to_sec") else float(timeout))
        try:
            while not publisher.get_num_connections() and time.monotonic() < end:
                answered.wait(0.01)
            while not rospy.is_shutdown():
                publisher.publish(command)
                if answered.wait(max(0.0, min(REPEAT_INIT, end - time.monotonic()))):
                    return True
                if time.monotonic() >= end:
                    break
            return False
        finally:
            subscriber.unregister()


_init_publishers: Dict[str, rospy.Publisher] = {}
_init_lock = threading.Lock()  # guards _init_publishers


def _init_publisher(topic: str) -> rospy.Publisher:
    """The process's publisher of init commands for a server.

    It stays: where one goes and the next comes at once, rospy's subscriber still has the link of the first,
    and makes none for the second.
    """
    resolved = rospy.resolve_name(topic)
    with _init_lock:
        if resolved not in _init_publishers:
            _init_publishers[resolved] = rospy.Publisher(
                resolved, SmachContainerInitialStatusCmd, queue_size=1
            )
        return _init_publishers[resolved]
