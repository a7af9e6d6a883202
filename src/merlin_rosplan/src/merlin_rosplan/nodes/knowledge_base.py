# SPDX-License-Identifier: Apache-2.0
"""The knowledge base: ROSPlan's services and topics over the store."""

import os
import threading
from collections import OrderedDict
from typing import Any, Callable, List, Sequence, Tuple, Type

import rospkg
import rospy
from merlin_msgs.msg import KnowledgeChanges
from rosplan_knowledge_msgs import srv
from rosplan_knowledge_msgs.msg import StatusUpdate
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse, Trigger, TriggerRequest, TriggerResponse

from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import read_domain
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import read_problem
from merlin_pddl.text_reader import PddlError, shortened
from merlin_ros.actions.peers import sender_of
from merlin_ros.health import OK, Health
from merlin_ros.ports.service_server import Unanswered
from merlin_ros.ros_alarm import RosAlarm, RosStopwatch
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import JournalError, KnowledgeStore
from merlin_rosplan.knowledge.transaction import StateChange, Transaction
from merlin_rosplan.messages.knowledge_messages import KnowledgeReader, KnowledgeWriter, UpdateReader
from merlin_rosplan.messages.wire_items import AnyItem, UpdateArrayRequest, bounded, refuse_too_many
from merlin_rosplan.nodes.goal_leases import GoalLeases
from merlin_rosplan.nodes.state_services import DomainServices, ExecutionServices, StateServices
from merlin_rosplan.storage.state_file import StateFile, StateFileError
from merlin_rosplan.transport.component import Component, ComponentError

#: Items that one request may have: others wait for an array while it is stored.
MAX_ITEMS = 20_000
#: value of ``~state_file`` that stands for a file in the log folder of this run of ROS
RUN = "run"

#: How many clients' last refusals are kept.
REFUSALS_KEPT = 100
RETRY = 1.0  # s of wall time before a state file that could not be written is tried again
_ONLY_PDDL = "only PDDL domains (.pddl) are known, no PPDDL, RDDL or HDDL"


def ros_nanoseconds() -> int:
    """Now in ROS time, ns."""
    return int(rospy.get_rostime().to_nsec())


class KnowledgeBase(Component):
    """The knowledge base as a component. See the README for its names and parameters.

    :raises ComponentError: no domain, or the state file cannot be used.
    """

    def __init__(self, scope: str) -> None:
        super().__init__(scope)
        self.domain = self._read_domain()
        self.strict = self.flag("strict", True)
        self.param("use_unknowns", False)  # ROSPlan reads it and never uses it
        max_items = int(self.number("max_items", MAX_ITEMS, 0))
        self.store = self._make_store()
        self._reader = KnowledgeReader(self.domain, keys=self.strict)
        self._updates = UpdateReader(self.domain, self.store.objects, self.strict)
        self._writer = KnowledgeWriter(self.domain)
        self._status = self.publisher("status/update", StatusUpdate)
        self._changes = self.publisher("changes", KnowledgeChanges, queue_size=1000)
        self._load_problem()
        self.store.listen(self._publish_change)
        self.own(TimedKnowledge(self.store, self.scope))
        DomainServices(self, self.domain, self.store.sensed)
        StateServices(self, self.store, max_items, self.strict)
        ExecutionServices(self, self.store, self._status)  # before what clients wait for, update_array
        self.service("update", srv.KnowledgeUpdateService, self._update)
        updates = bounded(srv.KnowledgeUpdateServiceArray, UpdateArrayRequest, max_items)
        self.service("update_array", updates, self._update_array)
        self.service("clear", Empty, self._clear)
        self.service("update_constraints_oneof", srv.KnowledgeUpdateServiceArray, self._oneof)
        self.service("update_sensed_predicates", srv.SetNamedBool, self._sensed)
        self._refusals = Refusals()
        self.service("last_refusal", Trigger, self._refusals.answer)
        self._goal_leases = GoalLeases(self.scope, self.store, self._updates)

    def service(self, name: str, service_class: Type[Any], callback: Callable[[Any], Any]) -> rospy.Service:
        """Offers a service. Once the store is to be closed it does not answer.

        A refusal would count, and the end of an action would be lost: its client waits for the next process.
        """

        def answer(request: Any) -> Any:
            try:
                return callback(request)
            finally:
                if self.closed:
                    raise Unanswered

        return super().service(name, service_class, answer)

    def on_shutdown(self) -> None:
        """Stops watching owners, and closes the store."""
        self._goal_leases.shutdown()
        self.store.close()

    def health(self) -> Health:
        """The version of the knowledge and the number of goals."""
        values = {"version": self.store.version, "goals": len(self.store.goals())}
        return Health(OK, f"version {self.store.version}", values)

    # --- start ----------------------------------------------------------------------------------

    def _read_domain(self) -> Domain:
        path = self.param("domain_path", None) or rospy.get_param(
            "/rosplan/domain_path", "common/domain.pddl"
        )
        self.domain_path = os.path.abspath(str(path))
        extension = os.path.splitext(self.domain_path)[1]
        if extension != ".pddl":
            raise ComponentError(f"{self.resolve('domain_path')} is '{path}': {_ONLY_PDDL}")
        try:
            return read_domain(self.domain_path)
        except PddlError as error:
            raise ComponentError(f"the domain cannot be used: {error}") from error

    def _make_store(self) -> KnowledgeStore:
        path = self._state_path(str(self.param("state_file", "")))
        reset = self.flag("reset_state", False)
        try:
            journal = StateFile(path, self.domain, reset) if path else None
            store = KnowledgeStore(
                self.domain, self.strict, ros_nanoseconds, journal, self._warn, RosStopwatch().look
            )
        except StateFileError as error:
            raise ComponentError(str(error)) from error
        if path:
            # Decided once per launch: a respawned process continues with the same file, also at a master
            # that was restarted, which has another /run_id or none.
            rospy.set_param(self.resolve("state_file"), path)
            if reset:
                rospy.set_param(self.resolve("reset_state"), False)
        return store

    def _state_path(self, value: str) -> str:
        if value != RUN:
            return value
        run = rospy.get_param("/run_id", None)
        if run is None:
            raise ComponentError(
                f"{self.resolve('state_file')} is '{RUN}', but this master has no /run_id; "
                "start it with roscore or roslaunch, or name a file"
            )
        name = self.scope.strip("/").replace("/", "-")
        return os.path.join(rospkg.get_log_dir(), str(run), f"{name}.sqlite")

    def _warn(self, text: str) -> None:
        rospy.logwarn_throttle_identical(60.0, f"{self.scope}: {shortened(text)}")

    def _load_problem(self) -> None:
        path = self.param("problem_path", "")
        if not path:
            return
        if self.store.version:
            rospy.loginfo("%s continues with the content of its state file; %s is not read", self.scope, path)
            return
        try:
            problem = read_problem(str(path), self.domain)
            if not self.flag("problem_goals", True):
                problem.goals.clear()  # a file must state one; a mission brings its own
            self.store.load_problem(problem, rospy.get_name())
        except (PddlError, UpdateRefused) as error:
            if self.strict:
                raise ComponentError(f"the problem cannot be used: {error}") from error
            rospy.logerr("%s starts with nothing: the problem cannot be used: %s", self.scope, error)

    # --- changes --------------------------------------------------------------------------------

    def _publish_change(self, change: StateChange) -> None:
        if not self._changes.get_num_connections():
            return
        write = self._writer
        message = KnowledgeChanges(
            version=change.version,
            client=change.client,
            added=[write.item(row) for row in change.added],
            removed=[write.item(row) for row in change.removed],
            changed=[write.item(row) for row in change.changed],
            goals_added=[write.goal(goal) for goal in change.goals_added],
            goals_removed=[write.goal(goal) for goal in change.goals_removed],
            cleared=change.cleared,
        )
        message.header.stamp = rospy.get_rostime()
        self._changes.publish(message)

    def _update(self, request: srv.KnowledgeUpdateServiceRequest) -> srv.KnowledgeUpdateServiceResponse:
        return srv.KnowledgeUpdateServiceResponse(
            self._apply("update", [request.update_type], [request.knowledge], sender_of(request))
        )

    def _update_array(
        self, request: srv.KnowledgeUpdateServiceArrayRequest
    ) -> srv.KnowledgeUpdateServiceArrayResponse:
        refuse_too_many(request)
        client = sender_of(request)
        success = self._apply("update_array", list(request.update_type), request.knowledge, client)
        if success:
            self._status.publish(StatusUpdate(client, rospy.get_rostime()))
        return srv.KnowledgeUpdateServiceArrayResponse(success)

    def _apply(self, service: str, kinds: List[int], items: Sequence[AnyItem], client: str) -> bool:
        """All of the updates, or none of them."""

        def update(transaction: Transaction) -> None:
            if len(kinds) != len(items) and self.strict:
                raise UpdateRefused(f"{len(kinds)} update types for {len(items)} items")
            for number, (kind, item) in enumerate(zip(kinds, items)):
                try:
                    self._updates.apply(transaction, kind, item)
                except UpdateRefused as error:
                    place = f"item {number}: " if len(items) > 1 else ""
                    raise UpdateRefused(f"{place}{error}") from error

        return self._change(service, client, update)

    def _change(self, service: str, client: str, change: Callable[[Transaction], None]) -> bool:
        """Whether a change counts; where it is refused, the client can ask for the reason."""
        try:
            with self.store.transaction(client) as transaction:
                change(transaction)
        except UpdateRefused as error:
            self._refusals.note(client, str(error))
            sender = shortened(client, 200)
            rospy.logwarn("%s/%s refused what %s sent: %s", self.scope, service, sender, error)
            return False
        return True

    def _clear(self, request: EmptyRequest) -> EmptyResponse:
        try:
            with self.store.transaction(sender_of(request)) as transaction:
                transaction.clear()
        except UpdateRefused as error:
            raise rospy.ServiceException(str(error)) from error
        return EmptyResponse()

    def _oneof(
        self, request: srv.KnowledgeUpdateServiceArrayRequest
    ) -> srv.KnowledgeUpdateServiceArrayResponse:
        """Stores a group of facts of which one is true. As in ROSPlan, no service uses it."""

        def store(transaction: Transaction) -> None:
            items = [self._reader.item(message).text() for message in request.knowledge]
            transaction.note(transaction.state.oneof, " ".join(items), {"items": items})

        stored = self._change("update_constraints_oneof", sender_of(request), store)
        return srv.KnowledgeUpdateServiceArrayResponse(stored)

    def _sensed(self, request: srv.SetNamedBoolRequest) -> srv.SetNamedBoolResponse:
        name = request.name.lower()

        def mark(transaction: Transaction) -> None:
            if self.strict and name not in self.domain.predicates and name not in self.domain.functions:
                raise UpdateRefused(f"unknown predicate '{request.name}'")
            transaction.note(transaction.state.sensed, name, {} if request.value else None)

        return srv.SetNamedBoolResponse(self._change("update_sensed_predicates", sender_of(request), mark))

    # --- for components of the same process ------------------------------------------------------

    def snapshot(self) -> Tuple[Domain, Problem]:
        """The domain and everything that is stored, at one moment."""
        return self.domain, self.store.snapshot()[1]


class Refusals:
    """The last refusal of each client, for the client itself. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the field below
        self._reasons: OrderedDict[str, str] = OrderedDict()

    def note(self, client: str, reason: str) -> None:
        """What a client sent was refused."""
        with self._lock:
            self._reasons[client] = reason
            self._reasons.move_to_end(client)
            if len(self._reasons) > REFUSALS_KEPT:
                self._reasons.popitem(last=False)

    def answer(self, request: TriggerRequest) -> TriggerResponse:
        """The answer of the service: the last refusal of the client that asks; no success without one."""
        with self._lock:
            reason = self._reasons.get(sender_of(request))
        return TriggerResponse(reason is not None, reason or "nothing of this client was refused")


class TimedKnowledge:
    """Applies a store's timed items when their ROS time has come.

    :param store: holds the items.
    :param client: the name that is reported as the author of the changes.
    """

    def __init__(self, store: KnowledgeStore, client: str) -> None:
        self._store = store
        self._client = client
        self._ended = threading.Event()
        self._setting = threading.Lock()  # what was asked for last is set last
        self._alarm = RosAlarm(self._fire, f"{client} timed knowledge")
        store.listen(lambda _: self._wait())
        self._wait()

    def shutdown(self) -> None:
        """Ends the thread."""
        self._ended.set()
        self._alarm.shutdown()

    def _wait(self) -> None:
        with self._setting:
            due = self._store.next_due()
            self._alarm.set(None if due is None else due / 1e9)

    def _fire(self) -> None:
        try:
            for reason in self._store.fire_due(self._client):
                rospy.logwarn("%s: %s", self._client, shortened(reason))
        except JournalError as error:
            rospy.logerr_throttle(60.0, f"{self._client}: what is due has to wait: {error}")
            self._ended.wait(RETRY)
        self._wait()
