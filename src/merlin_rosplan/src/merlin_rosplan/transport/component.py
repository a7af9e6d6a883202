# SPDX-License-Identifier: Apache-2.0
"""A part of the planning system: ROSPlan's node, as an object that can share a process with the others.

ROSPlan gives each part a node of its own and keeps its services, topics and parameters in that node's
private namespace. A :class:`Component` keeps them below ``<namespace>/<scope>/`` instead: the same names
when the scope is the node's own name, and unchanged ones when several components share a process.
"""

import gc
import math
import threading
from typing import Any, Callable, ClassVar, Dict, List, Optional, Type

import rospy

from merlin_ros.health import Health, HealthReporter
from merlin_ros.lean_start import importing
from merlin_ros.master.announcing import announced_together
from merlin_ros.node import keep_params, run_node
from merlin_ros.ports.service_server import Service
from merlin_ros.work.threads import log_failure
from merlin_rosplan.transport.direct_service import offer

#: Scope of the knowledge base where nothing else is said.
KNOWLEDGE_BASE = "rosplan_knowledge_base"

_NO_DEFAULT = object()


class ComponentError(Exception):
    """A component cannot start; the text names the mistake and the remedy."""


class _ComponentType(type):
    """Makes a component: announces its services when it has all of them, and notes that it is complete.

    What its `on_shutdown` ends exists only then.
    """

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        with announced_together():
            component = super().__call__(*args, **kwargs)
            component._complete = True
        return component


class Component(metaclass=_ComponentType):
    """Base of all parts of the planning system.

    :param scope: namespace of this component's names and parameters, relative to the node's namespace or
        absolute. A component that has a node of its own takes the name of that node.

    A subclass makes its publishers, services and subscribers in ``__init__`` (in this order: a callback
    must be able to publish) and raises :class:`ComponentError` when it cannot start.
    """

    _running: ClassVar[Dict[str, "Component"]] = {}
    _running_lock: ClassVar[threading.Lock] = threading.Lock()

    def __init__(self, scope: str) -> None:
        self.scope: str = rospy.resolve_name(scope)
        self._at_start = keep_params(self.scope)  # one question to the master instead of one for each
        self._handles: List[Any] = []
        self._closed = threading.Event()
        self._complete = False
        with Component._running_lock:
            if self.scope in Component._running:
                raise ComponentError(f"two components of this process have the scope {self.scope}")
            Component._running[self.scope] = self
        #: Global name of the knowledge base. ``~knowledge_base`` is a name without its leading slash, as in
        #: ROSPlan; without the parameter it is the knowledge base of the own namespace.
        name = self.param("knowledge_base", None)
        name = KNOWLEDGE_BASE if name is None else "/" + str(name).lstrip("/")
        self.knowledge_base: str = rospy.resolve_name(name)

    # --- names and parameters -------------------------------------------------------------------

    def resolve(self, name: str) -> str:
        """The global name of one of this component's names: ``x`` and ``~x`` mean ``<scope>/x``."""
        if name.startswith("/"):
            return rospy.resolve_name(name)
        return rospy.resolve_name(f"{self.scope}/{name.lstrip('~')}")

    def param(self, name: str, default: Any = _NO_DEFAULT) -> Any:
        """The value of ``<scope>/<name>``.

        :raises ComponentError: the parameter is not set and there is no default.
        """
        full = self.resolve(name)
        try:
            if self._at_start is None or self._complete or not full.startswith(f"{self.scope}/"):
                return rospy.get_param(full)
            value: Any = self._at_start
            for key in full[len(self.scope) + 1 :].split("/"):
                if not isinstance(value, dict):
                    raise KeyError(full)
                value = value[key]
            return value
        except KeyError:
            if default is _NO_DEFAULT:
                raise ComponentError(f"the parameter {full} is required and not set") from None
            return default

    def number(self, name: str, default: float, minimum: float = float("-inf")) -> float:
        """A parameter that must be a finite number of at least `minimum`.

        :raises ComponentError: it is not a number, not finite, or too small.
        """
        value = self.param(name, default)
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value) or value < minimum:
            raise ComponentError(
                f"the parameter {self.resolve(name)} is {value!r}, expected a finite number"
                + (f" of at least {minimum:g}" if minimum > float("-inf") else "")
            )
        return float(value)

    def flag(self, name: str, default: bool) -> bool:
        """A parameter that must be true or false; 1 and 0 count as these.

        :raises ComponentError: it is something else; a text as `false` would count as true.
        """
        value = self.param(name, default)
        if value not in (True, False):
            raise ComponentError(
                f"the parameter {self.resolve(name)} is {value!r}; it has to be true or false"
            )
        return bool(value)

    @staticmethod
    def in_process(scope: str) -> Optional["Component"]:
        """The component of that global scope, if it lives in this process: it can be read without ROS."""
        with Component._running_lock:
            return Component._running.get(scope)

    # --- services and topics --------------------------------------------------------------------

    def service(self, name: str, service_class: Type[Any], callback: Callable[[Any], Any]) -> rospy.Service:
        """Offers a service; its callback raises ``rospy.ServiceException`` to make the call fail."""
        service = self.own(Service(self.resolve(name), service_class, callback))
        offer(service, self._closed)
        return service

    def publisher(
        self, name: str, message_class: Type[Any], queue_size: int = 100, latch: bool = False
    ) -> rospy.Publisher:
        """Advertises a topic; publishing never waits for a subscriber."""
        return self.own(
            rospy.Publisher(self.resolve(name), message_class, queue_size=queue_size, latch=latch)
        )

    def subscriber(
        self,
        name: str,
        message_class: Type[Any],
        callback: Callable[[Any], None],
        queue_size: Optional[int] = None,
    ) -> rospy.Subscriber:
        """Subscribes with TCP_NODELAY: without it a message may be late by 40 ms."""
        return self.own(
            rospy.Subscriber(
                self.resolve(name), message_class, callback, queue_size=queue_size, tcp_nodelay=True
            )
        )

    def own(self, handle: Any) -> Any:
        """Remembers something with ``shutdown()`` or ``unregister()``, to be ended with this component."""
        self._handles.append(handle)
        return handle

    def health(self) -> Health:
        """How the component does, for ``/diagnostics``; must not block."""
        return Health()

    # --- start and end --------------------------------------------------------------------------

    @property
    def closed(self) -> bool:
        """Whether the component is shut down."""
        return self._closed.is_set()

    def prepare(self) -> None:
        """For subclasses: imports and makes what the first answer can do without.

        Called once all components of the process serve. A request that comes before must not fail.
        """

    def on_shutdown(self) -> None:
        """For subclasses: wakes and joins their threads, closes what they hold. Called once at most.

        A component that could not start is not asked; what it gave to :meth:`own` is ended all the same.
        """

    def shutdown(self) -> None:
        """Ends the component: subclass first, then services and topics. A second call does nothing."""
        with Component._running_lock:
            if self._closed.is_set():
                return
            self._closed.set()
            if Component._running.get(self.scope) is self:
                del Component._running[self.scope]
        try:
            if self._complete:
                self.on_shutdown()
        finally:
            # An ending node closes its services and topics itself, and does not ask the master for each.
            node_ends = rospy.core.is_shutdown_requested()
            for handle in reversed(self._handles):
                if isinstance(handle, rospy.Service):
                    if not node_ends:
                        handle.shutdown("component ended")
                elif hasattr(handle, "unregister"):
                    if not node_ends:
                        handle.unregister()
                else:
                    handle.shutdown()
            self._handles.clear()

    @staticmethod
    def checks() -> Dict[str, Callable[[], Health]]:
        """The :meth:`health` of every component of this process, by scope."""
        with Component._running_lock:
            return {scope.lstrip("/"): component.health for scope, component in Component._running.items()}

    @staticmethod
    def prepare_all() -> None:
        """Lets every component of this process make the rest of what it needs."""
        with Component._running_lock:
            running = list(Component._running.values())
        with importing():
            for component in running:
                component.prepare()

    @staticmethod
    def shutdown_all() -> None:
        """Ends every component of this process, the youngest first; one that fails keeps no other one."""
        with Component._running_lock:
            running = list(Component._running.values())
        for component in reversed(running):
            try:
                component.shutdown()
            except Exception:
                log_failure(component.scope)


def run_components(node_name: str, make: Callable[[str], Any]) -> int:
    """Runs components as a node until a signal or rospy ends it.

    :param node_name: default name of the node.
    :param make: gets the node's base name and makes the components; what it raises ends the node.

    Returns the exit code of :func:`merlin_ros.node.run_node`; 2 when a component cannot start.
    """
    # A store of 100 000 facts is a million objects that stay: looking through them after every 700 new ones,
    # Python's default, makes single calls wait for 100 ms.
    gc.set_threshold(50_000, 20, 20)

    def start() -> None:
        rospy.on_shutdown(Component.shutdown_all)
        make(rospy.get_name().rsplit("/", 1)[-1])
        HealthReporter(Component.checks()).start()
        Component.prepare_all()

    return run_node(node_name, start, ComponentError)
