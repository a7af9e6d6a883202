# SPDX-License-Identifier: Apache-2.0
"""Access to a ROSPlan knowledge base, ours or the original. One client per knowledge base and process."""

import threading
import time
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple, Type

import rospy
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import (
    DomainFormula,
    DomainInequality,
    DomainOperator,
    ExprBase,
    KnowledgeItem,
)
from rosplan_knowledge_msgs.srv import (
    GetAttributeService,
    GetDomainAttributeService,
    GetDomainOperatorDetailsService,
    GetDomainOperatorService,
    GetDomainTypeService,
    GetInstanceService,
    KnowledgeQueryService,
    KnowledgeUpdateServiceArray,
    KnowledgeUpdateServiceArrayRequest,
)
from std_srvs.srv import Trigger

from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import read_domain
from merlin_pddl.text_reader import PddlError
from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal, to_pddl
from merlin_ros.master.master_link import get_param
from merlin_ros.service_proxy import ServiceError, ServiceProxy

DEFAULT_KNOWLEDGE_BASE = "rosplan_knowledge_base"
ADD = KnowledgeUpdateServiceArrayRequest.ADD_KNOWLEDGE
ADD_GOAL = KnowledgeUpdateServiceArrayRequest.ADD_GOAL
REMOVE = KnowledgeUpdateServiceArrayRequest.REMOVE_KNOWLEDGE
REMOVE_GOAL = KnowledgeUpdateServiceArrayRequest.REMOVE_GOAL
CALL_LIMIT = 10.0  # s of wall time for one call; a knowledge base answers in milliseconds
START_LIMIT = 20.0  # s of wall time the first call gives a knowledge base that is being started


class Update(NamedTuple):
    """One step of a transaction: ADD, REMOVE, ADD_GOAL or REMOVE_GOAL, and the item."""

    kind: int
    item: KnowledgeItem


class KnowledgeError(RuntimeError):
    """The knowledge base refused an update or did not answer; the text says why."""


class KnowledgeBaseMissing(KnowledgeError):
    """The knowledge base did not appear in time; it may still come."""


class KnowledgeClient:
    """Calls the services of one knowledge base. The first call waits for one that is still being started.

    :param name: of the knowledge base, relative names allowed.
    :param proxy_class: calls its services.
    """

    def __init__(
        self, name: str = DEFAULT_KNOWLEDGE_BASE, proxy_class: Type[ServiceProxy] = ServiceProxy
    ) -> None:
        self.name = rospy.resolve_name(name)
        self._proxy_class = proxy_class
        self._domain: Dict[str, Any] = {}  # service of the domain -> its answer
        proxy = self._proxy
        self._update = proxy("update_array", KnowledgeUpdateServiceArray)
        self._last_refusal = self._proxy_class(f"{self.name}/last_refusal", Trigger, timeout=CALL_LIMIT)
        self._query = proxy("query_state", KnowledgeQueryService)
        self._instances = proxy("state/instances", GetInstanceService)
        self._propositions = proxy("state/propositions", GetAttributeService)
        self._functions = proxy("state/functions", GetAttributeService)
        self._goals = proxy("state/goals", GetAttributeService)
        self._types = proxy("domain/types", GetDomainTypeService)
        self._predicates = proxy("domain/predicates", GetDomainAttributeService)
        self._function_names = proxy("domain/functions", GetDomainAttributeService)
        self._operators = proxy("domain/operators", GetDomainOperatorService)
        self._operator = proxy("domain/operator_details", GetDomainOperatorDetailsService)

    def wait(self, timeout: Optional[float] = None) -> bool:
        """Waits until the knowledge base answers, s of wall time; None: until ROS shuts down."""
        return self._update.wait(timeout)

    def update(self, updates: Sequence[Update]) -> None:
        """Applies a transaction.

        :raises KnowledgeError: when it was refused. Ours changes nothing then; the original never refuses.
        """
        if (
            updates
            and not self._update([step.kind for step in updates], [step.item for step in updates]).success
        ):
            texts = ", ".join(to_pddl(step.item) for step in updates[:5])
            raise KnowledgeError(f"{self.name} refused an update with {texts}: {self._refusal()}")

    def _refusal(self) -> str:
        """Why the last update was refused. The last one of this process: threads that differ may share it."""
        try:
            return str(self._last_refusal().message)
        except ServiceError:
            return "its log says why"  # the original has no such service

    def query(self, items: Sequence[KnowledgeItem]) -> List[bool]:
        """Whether each item holds. Negative facts are asked as positive ones, which every version answers."""
        positive = [_positive(item) for item in items]
        results = self._query(positive).results
        asked = zip(items, positive, results)
        return [bool(result) != bool(item.is_negative and item is not sent) for item, sent, result in asked]

    def instances(self, type_name: str = "", constants: bool = True, subtypes: bool = True) -> List[str]:
        """Names of the objects of a type; an empty type means all."""
        return list(dict.fromkeys(self._instances(type_name, constants, subtypes).instances))

    def objects(self) -> Dict[str, str]:
        """The type of each object, by its name."""
        own = {name: kind for kind in self.types() for name in self.instances(kind, True, False)}
        return {**dict.fromkeys(self.instances(), "object"), **own}

    def propositions(self, predicate: str = "") -> List[KnowledgeItem]:
        """Facts of a predicate; an empty one means all."""
        return list(self._propositions(predicate).attributes)

    def functions(self, function: str = "") -> List[KnowledgeItem]:
        """Values of a numeric function; an empty one means all."""
        return list(self._functions(function).attributes)

    def goals(self) -> List[KnowledgeItem]:
        """All goals."""
        return list(self._goals("").attributes)

    def types(self) -> Dict[str, str]:
        """Types of the domain, with their parents."""
        answer = self._once(self._types)
        return dict(zip(answer.types, answer.super_types))

    def predicates(self) -> Dict[str, DomainFormula]:
        """Predicates of the domain by name."""
        return {formula.name: formula for formula in self._once(self._predicates).items}

    def function_signatures(self) -> Dict[str, DomainFormula]:
        """Numeric functions of the domain by name."""
        return {formula.name: formula for formula in self._once(self._function_names).items}

    def operators(self) -> Dict[str, DomainFormula]:
        """Operators of the domain by name."""
        return {formula.name: formula for formula in self._once(self._operators).operators}

    def operator(self, name: str) -> DomainOperator:
        """One operator with its conditions and effects."""
        return self._operator(name).op

    @property
    def stays(self) -> bool:
        """Whether the knowledge base that has described an operator last is still there, with that domain."""
        return self._operator.connected

    def _once(self, service: ServiceProxy) -> Any:
        """The answer of a service of the domain: a knowledge base keeps its domain as long as it lives."""
        if service.name not in self._domain or not service.connected:
            self._domain[service.name] = service()
        return self._domain[service.name]

    def _proxy(self, suffix: str, service_class: type) -> ServiceProxy:
        return self._proxy_class(
            f"{self.name}/{suffix}", service_class, timeout=CALL_LIMIT, patience=START_LIMIT
        )


_clients: Dict[str, KnowledgeClient] = {}
_clients_lock = threading.Lock()  # guards _clients


def knowledge_client(name: str = DEFAULT_KNOWLEDGE_BASE) -> KnowledgeClient:
    """The process's client of a knowledge base, made at its first use."""
    resolved = rospy.resolve_name(name)
    with _clients_lock:
        if resolved not in _clients:
            _clients[resolved] = KnowledgeClient(resolved)
        return _clients[resolved]


def known_domain(client: "KnowledgeClient") -> Optional[Tuple[Domain, Dict[str, Tuple[str, ...]]]]:
    """Domain and objects with their types; None: the file of the domain is not on this machine.

    :raises merlin_ros.service_proxy.ServiceError: when the knowledge base does not answer.
    """
    try:
        domain = read_domain(str(get_param(f"{client.name}/domain_path", "")))
    except PddlError:
        return None
    objects: Dict[str, Tuple[str, ...]] = {}
    for kind in domain.types:
        for name in client.instances(kind, constants=False, subtypes=False):
            objects[name.lower()] = (*objects.get(name.lower(), ()), kind)
    return domain, objects


def wait_for_knowledge_base(name: str, timeout: float) -> None:
    """Waits until a knowledge base answers.

    :param timeout: s of wall time.
    :raises KnowledgeBaseMissing: when it does not.
    """
    began = time.monotonic()
    knowledge = knowledge_client(name)
    if not knowledge.wait(timeout):
        waited = time.monotonic() - began
        raise KnowledgeBaseMissing(
            f"no knowledge base {knowledge.name} after {waited:.0f} s; is it launched?"
        )


def fact(predicate: str, *arguments: str, negative: bool = False) -> KnowledgeItem:
    """A fact as a knowledge item. Arguments count by position."""
    return KnowledgeItem(
        knowledge_type=KnowledgeItem.FACT,
        attribute_name=predicate,
        values=[KeyValue(key="", value=argument) for argument in arguments],
        is_negative=negative,
    )


def function_value(function: str, arguments: Sequence[str], value: float) -> KnowledgeItem:
    """The value of a numeric function as a knowledge item."""
    item = fact(function, *arguments)
    item.knowledge_type = KnowledgeItem.FUNCTION
    item.function_value = value
    return item


def instance(type_name: str, name: str) -> KnowledgeItem:
    """An object as a knowledge item."""
    return KnowledgeItem(knowledge_type=KnowledgeItem.INSTANCE, instance_type=type_name, instance_name=name)


def _positive(item: KnowledgeItem) -> KnowledgeItem:
    if item.knowledge_type != KnowledgeItem.FACT or not item.is_negative:
        return item
    return KnowledgeItem(
        knowledge_type=KnowledgeItem.FACT, attribute_name=item.attribute_name, values=item.values
    )


def parse_changes(text: str) -> List[Update]:
    """What makes a text true, ``(and (checked kitchen) (not (open door)) (= (battery) 20))``.

    :raises PDDLSyntaxError: when it is something else than facts, ``not``, values and ``and`` of them, or
        they cannot all be true.
    """
    updates = [_update(item) for item in parse_goal(text)]
    known: Dict[str, Update] = {}
    for update in updates:
        name = " ".join([update.item.attribute_name, *(each.value for each in update.item.values)])
        first = known.setdefault(name.lower(), update)
        if (first.kind, first.item.function_value) != (update.kind, update.item.function_value):
            raise PDDLSyntaxError(f"({name}) is given twice, and both cannot be true")
    return updates


def _update(item: KnowledgeItem) -> Update:
    if item.knowledge_type == KnowledgeItem.INEQUALITY:
        return Update(ADD, _value(item))
    kind = REMOVE if item.is_negative else ADD
    item.is_negative = False
    return Update(kind, item)


def _value(item: KnowledgeItem) -> KnowledgeItem:
    left, right = item.ineq.LHS.tokens, item.ineq.RHS.tokens
    if (
        item.ineq.comparison_type != DomainInequality.EQUALS
        or [token.expr_type for token in left] != [ExprBase.FUNCTION]
        or [token.expr_type for token in right] != [ExprBase.CONSTANT]
    ):
        raise PDDLSyntaxError(f"{to_pddl(item)} sets no value; write (= (battery) 20)")
    function = left[0].function
    return function_value(
        function.name, [entry.value for entry in function.typed_parameters], right[0].constant
    )
