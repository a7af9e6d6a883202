# SPDX-License-Identifier: Apache-2.0
"""The panel of the knowledge base. It is followed: everything by its services, then its changes.

Ours publishes every change on ``changes``. ROSPlan's says on ``status/update`` that an array was applied, and
says nothing of single updates; so it is read again then, and every few seconds.
"""

import threading
import time
from typing import Any, Dict, List, Optional

import rospy
from merlin_msgs.msg import KnowledgeChanges
from rosplan_knowledge_msgs.msg import StatusUpdate
from rosplan_knowledge_msgs.srv import GetDomainNameService

from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.knowledge_section import Contents, added, formulas
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_planning.knowledge_client import KnowledgeClient
from merlin_ros.alarms import Alarm, call_later
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_ros.work.threads import CallQueue, failure_text

READ_AGAIN = 2.0  # s of wall time between two readings of a knowledge base that does not publish its changes
SOON = 0.2  # s from an update to reading, so that one reading serves several updates
FOLLOWS = "every change as the knowledge base publishes it"
GONE = "the knowledge base has gone"
READS = "read again after updates and every 2 s: this knowledge base does not publish its changes"


class KnowledgePanel(Panel):
    """Objects, facts, values and goals."""

    name, title, place, width = "knowledge", "Knowledge", 70, 7

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        self._client = KnowledgeClient(
            self.ros.resolve(str(self.ros.parameter("~knowledge_base", "rosplan_knowledge_base")))
        )
        self._added: Dict[str, List[List[str]]] = {}  # of the thread that reads
        self._domain_name = ServiceProxy(
            f"{self._client.name}/domain/name", GetDomainNameService, timeout=5.0
        )
        self._reader = CallQueue("knowledge reader")
        self._lock = threading.Lock()  # guards the fields below
        self._reading_comes: Optional[Alarm] = None
        self._comes_at = 0.0  # s of wall time
        self._reading = False
        self._held: List[KnowledgeChanges] = []  # that arrived while it was read
        self._version: Optional[int] = None
        self._address = ""
        self._publishes = False
        self._by = ""
        self._first = True
        # A connection of one of them shows that the knowledge base lives.
        self._subscribers = [
            self.ros.subscribe(
                f"{self._client.name}/changes",
                KnowledgeChanges,
                self._changed,
                queue_size=1000,
                tcp_nodelay=True,
            ),
            self.ros.subscribe(
                f"{self._client.name}/status/update", StatusUpdate, self._updated, queue_size=100
            ),
        ]

    def source(self) -> Source:
        """The knowledge base."""
        return self.source_of(*self._subscribers)

    def look(self, topics: Dict[str, str]) -> None:
        """Notices a knowledge base that appeared or began anew."""
        address = self.ros.address_of(f"{self._client.name}/state/propositions")
        publishes = f"{self._client.name}/changes" in topics
        with self._lock:
            if not address:
                if self._address:
                    self._address = ""
                    self.state.inbox.put(self.state.knowledge.source, GONE)
                return
            if address != self._address or publishes != self._publishes:
                self._address, self._publishes, self._version = address, publishes, None
                self._want(0.0)
                self.state.inbox.put(self.state.knowledge.source, FOLLOWS if publishes else READS)
            elif not publishes:
                self._want(READ_AGAIN)

    def _want(self, delay: float) -> None:
        """Has all be read, in `delay` s at the latest; called with the lock held."""
        at = time.monotonic() + delay
        if self._reading_comes is not None:
            if self._comes_at <= at:
                return
            self._reading_comes.cancel()
        self._reading_comes = call_later(delay, lambda: self._reader.put(self._read_all))
        self._comes_at = at

    def _updated(self, message: StatusUpdate) -> None:
        with self._lock:
            if not self._publishes and self._address:
                self._by = message.last_update_client
                self._want(SOON)

    def _changed(self, message: KnowledgeChanges) -> None:
        with self._lock:
            if self._reading or self._reading_comes is not None:
                self._held.append(message)
                return
            if self._version is not None and message.version != self._version + 1:
                # Something was missed (or the knowledge base is new): all is read again.
                self._version = None
                self._held = [message]
                self._want(0.0)
                return
            self._version = message.version
            self._put(message)

    def _put(self, message: KnowledgeChanges) -> None:
        at = self.ros.time_of(message)
        self.state.inbox.put(self.state.knowledge.changed, message, at)

    def _read_all(self) -> None:
        with self._lock:
            self._reading_comes, self._reading = None, True
            # From a knowledge base that may be gone, or contained in what is read now.
            self._held.clear()
            by, self._by = self._by, ""
        try:
            self._take(self._read(), self._domain(), by)
        except Exception as error:  # what a foreign knowledge base answers may be odd, too
            if not rospy.is_shutdown():
                reason = error if isinstance(error, ServiceError) else failure_text(error)
                rospy.logwarn_throttle(30.0, f"monitor: the knowledge cannot be read: {reason}")
            with self._lock:
                self._reading = False
                if self._address:
                    self._want(READ_AGAIN)

    def _take(self, contents: Contents, domain: Dict[str, Any], by: str) -> None:
        with self._lock:
            at = self.ros.time()
            self.state.inbox.put(self.state.domain, domain, rospy.logwarn)
            self.state.inbox.put(self.state.knowledge.replace, contents, by, at, self._first)
            self._first = False
            self._reading = False
            held, self._held = self._held, []
            # Changes that were held may be in what was read already; to apply them again changes nothing.
            for message in held:
                self._put(message)
                self._version = message.version
            # Of a version not known yet, the next change is the following one, whatever its number.

    def _read(self) -> Contents:
        client = self._client
        objects = client.objects()
        return Contents(objects, client.propositions(), client.functions(), client.goals())

    def _adds(self) -> Dict[str, List[List[str]]]:
        """The facts that each operator makes true, with its variables: ``{"ask": [["checked", "p"]]}``."""
        names = sorted(self._client.operators())
        if names != sorted(self._added):
            # One call per operator, and ROSPlan's knowledge is read again and again.
            operators = [self._client.operator(name) for name in names]
            self._added = {operator.formula.name: added(operator) for operator in operators}
        return self._added

    def _domain(self) -> Dict[str, Any]:
        client = self._client
        return {
            "name": self._domain_name().domain_name,
            "types": client.types(),
            "predicates": formulas(client.predicates().values()),
            "functions": formulas(client.function_signatures().values()),
            "operators": formulas(client.operators().values()),
            "adds": self._adds(),
        }
