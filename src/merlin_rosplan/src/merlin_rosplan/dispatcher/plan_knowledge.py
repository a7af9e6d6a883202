# SPDX-License-Identifier: Apache-2.0
"""What parser and dispatcher ask and hear of any ROSPlan knowledge base; one of this process without ROS."""

import functools
import os
import threading
from typing import (
    Any,
    Callable,
    Dict,
    FrozenSet,
    Iterable,
    List,
    Optional,
    Sequence,
    Set,
    Tuple,
    TypeVar,
    Union,
)

import rospy
from merlin_msgs.srv import ListExecutions
from rosplan_knowledge_msgs.msg import KnowledgeItem
from rosplan_knowledge_msgs.srv import GetAttributeService

from merlin_pddl.domain import Domain, depends_on
from merlin_pddl.domain_reader import read_domain
from merlin_pddl.evaluation import assigned
from merlin_pddl.formula import And, Atom, Comparison
from merlin_pddl.knowledge import ASSIGN, Fact, FunctionValue, Instance, Timed
from merlin_pddl.text_reader import PddlError
from merlin_planning.knowledge_client import CALL_LIMIT, KnowledgeClient, fact
from merlin_planning.knowledge_text import to_pddl
from merlin_ros.master.master_link import ERRORS, bounded_master, get_param
from merlin_ros.service_proxy import ServiceError
from merlin_rosplan.dispatch.dispatch_environment import PlanGoals, PlanKnowledgeError
from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions, PlanTerm
from merlin_rosplan.dispatch.plan_graph import TimedLiteral, TimedValue
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.messages.domain_messages import operator_message, read_operator
from merlin_rosplan.messages.expression_messages import ASSIGNMENTS, FormulaWriter
from merlin_rosplan.transport.component import Component
from merlin_rosplan.transport.direct_service import DirectServiceProxy

_Answer = TypeVar("_Answer")


class PlanKnowledge:
    """Asks one knowledge base about operators, conditions and goals; safe to share between threads.

    Every method raises :class:`PlanKnowledgeError` when there is no answer.

    :param knowledge_base: its global name.
    """

    def __init__(self, knowledge_base: str) -> None:
        self._client = KnowledgeClient(knowledge_base, DirectServiceProxy)
        self._lock = threading.Lock()  # guards the four fields below
        self._domain: Optional[Domain] = None  # of the knowledge base in this process
        self._models: Dict[str, ActionModel] = {}
        self._written: Optional[Tuple[Optional[Domain]]] = None  # of one in another process, once looked for
        self._lists: Optional[bool] = None  # whether it lists executions, once that is known
        self._domain_file = DomainFile(knowledge_base)
        self._timed = DirectServiceProxy(
            f"{knowledge_base}/state/timed_knowledge", GetAttributeService, CALL_LIMIT
        )
        self._executions = DirectServiceProxy(f"{knowledge_base}/executions", ListExecutions, CALL_LIMIT)

    def operator(self, name: str) -> ActionModel:
        """An operator of the domain; an unknown name is an error."""
        local = Component.in_process(self._client.name)
        domain: Optional[Domain] = getattr(local, "domain", None)
        if domain is None or name.lower() not in domain.operators:
            return self._ask_operator(name)
        # A knowledge base keeps its domain as long as it lives.
        with self._lock:
            if domain is not self._domain:
                self._domain, self._models = domain, {}
            if name not in self._models:
                written = domain.operators[name.lower()]
                self._models[name] = ActionModel.of(written, domain.derived, domain.constraints)
            return self._models[name]

    def _ask_operator(self, name: str) -> ActionModel:
        with self._lock:
            if self._domain is not None or not self._client.stays:
                self._domain, self._models, self._written, self._lists = None, {}, None, None
            if name in self._models:
                return self._models[name]
        model = self._read_operator(name)
        with self._lock:
            return self._models.setdefault(name, model)

    def _read_operator(self, name: str) -> ActionModel:
        try:
            message = self._client.operator(name)
            operator = read_operator(message)
        except (ServiceError, UpdateRefused) as error:
            if "does not answer" in str(error):
                raise PlanKnowledgeError(str(error)) from error
            raise PlanKnowledgeError(f"the domain has no operator '{name}' ({error})") from error
        # The file has what the message cannot carry, if it still is what the knowledge base has read. To look
        # for it takes the master two calls, longer than all the rest.
        with self._lock:
            looked = self._written
        (domain,) = looked or (self._domain_file.domain(),)
        with self._lock:
            self._written = (domain,)
        written = domain.operators.get(operator.name.lower()) if domain is not None else None
        if domain is None or written is None or operator_message(domain, written) != message:
            return ActionModel.of(operator, {})
        return ActionModel.of(written, domain.derived, domain.constraints)

    def false_of_each(self, asked: Sequence[Conditions]) -> List[Conditions]:
        """Those ground conditions of each action that do not hold now, asked in one call.

        A negative one holds when the positive fact is absent: ROSPlan's own knowledge base answers true for
        a negative query only when an explicit negative fact is stored.
        """
        store = None
        if not any(conditions.comparisons or conditions.expressions for conditions in asked):
            store = getattr(Component.in_process(self._client.name), "store", None)
        results = iter(self._query_each(asked) if store is None else _look_up(store, asked))

        def holds(atom: PlanTerm) -> bool:
            return _equal(atom) if atom.name == "=" else next(results)

        return [
            Conditions(
                tuple([atom for atom in conditions.positive if not holds(atom)]),
                tuple([atom for atom in conditions.negative if holds(atom)]),
                tuple([entry for entry in conditions.comparisons if not next(results)]),
                tuple([entry for entry in conditions.expressions if not next(results)]),
            )
            for conditions in asked
        ]

    def _query_each(self, asked: Sequence[Conditions]) -> List[bool]:
        items: List[KnowledgeItem] = []
        for conditions in asked:
            items += [fact(atom.name, *atom.arguments) for atom in _stored(conditions)]
            items += [comparison_item(entry.condition) for entry in conditions.comparisons]
            items += [  # as PDDL text, which only our knowledge base understands
                KnowledgeItem(knowledge_type=KnowledgeItem.EXPRESSION, attribute_name=str(entry))
                for entry in conditions.expressions
            ]
        return self.query(items) if items else []

    def query(self, items: Sequence[KnowledgeItem]) -> List[bool]:
        """Whether each item is true now; negative facts are asked as positive ones and turned round."""
        results = _answer(lambda: self._client.query(items))
        if len(results) != len(items):
            raise PlanKnowledgeError(
                f"{self._client.name}/query_state gave {len(results)} answers to {len(items)} items"
            )
        return results

    def unmet_goals(self) -> List[str]:
        """The goals that do not hold now, as PDDL text."""
        goals = _answer(self._client.goals)
        return [to_pddl(goal) for goal, true in zip(goals, self.query(goals) if goals else []) if not true]

    def timed(self) -> List[Union[TimedLiteral, TimedValue]]:
        """Facts and function values that wait for their time; times in s from now."""
        items = _answer(lambda: self._timed(predicate_name="")).attributes
        now = rospy.Time.now()
        rows: List[Timed] = []
        changes: Set[str] = set()  # functions that are increased, and the like
        for item in items:
            name, args = _term(item)
            at = (item.initial_time - now).to_nsec()
            if item.knowledge_type == KnowledgeItem.FACT:
                rows.append(Timed(at, Fact(name, args, bool(item.is_negative))))
            elif item.knowledge_type == KnowledgeItem.FUNCTION:
                op = ASSIGNMENTS.get(item.assign_op, ASSIGN)
                rows.append(Timed(at, FunctionValue(name, args, item.function_value, op=op)))
                changes |= {name} if op != ASSIGN else set()
        values = {(term.name, *term.arguments): value for term, value in self.values(changes).items()}
        return [_timed(row) for row in assigned(rows, values)]

    def timed_changes(self) -> List[Tuple[float, str]]:
        """ROS time, s, and name of everything that waits for its time."""
        items = _answer(lambda: self._timed(predicate_name="")).attributes
        return [(item.initial_time.to_sec(), item.attribute_name.lower()) for item in items]

    def values(self, names: Iterable[str]) -> Dict[PlanTerm, float]:
        """What the terms of some functions are worth now."""
        return {
            _term(item).key: item.function_value
            for name in sorted(names)
            for item in _answer(functools.partial(self._client.functions, name))
        }

    def objects(self) -> FrozenSet[str]:
        """All objects and constants, lower-case."""
        return frozenset(name.lower() for name in _answer(self._client.instances))

    def held(self, plan_id: int) -> Optional[Dict[int, FrozenSet[PlanTerm]]]:
        """The actions of a dispatch whose executions are open, by id.

        With each the facts, lower-case, that are as they are only while it runs. None when the knowledge base
        does not list executions.
        """
        with self._lock:
            lists = self._lists
        if lists is None:
            lists = _answer(self._executions.offered)
            if not lists and not self._client.wait(0.0):
                raise PlanKnowledgeError(f"{self._client.name} is not there")
            with self._lock:
                self._lists = lists
        if not lists:
            return None
        found: Dict[int, FrozenSet[PlanTerm]] = {}
        for execution in _answer(lambda: self._executions("").executions):
            plan, _, rest = execution.token.partition("/")
            action = rest.partition("/")[0]
            if plan == str(plan_id) and action.isdigit():
                words = [
                    text.replace("(not ", "").strip("() ").lower().split() for text in execution.meanwhile
                ]
                found[int(action)] = frozenset(PlanTerm(each[0], tuple(each[1:])) for each in words if each)
        return found

    def goals(self) -> Optional[PlanGoals]:
        """What plans are for; None where it is not known which predicates are derived."""
        domain = (
            getattr(Component.in_process(self._client.name), "domain", None) or self._domain_file.domain()
        )
        if domain is None:
            return None
        literals = Conditions()
        reads: Set[str] = set()
        for item in _answer(self._client.goals):
            name = item.attribute_name.lower()
            if item.knowledge_type == KnowledgeItem.FACT and name not in domain.derived:
                atom = (_term(item),)
                literals += Conditions(negative=atom) if item.is_negative else Conditions(positive=atom)
            else:
                words = to_pddl(item).lower().replace("(", " ").replace(")", " ").split()
                reads |= depends_on(And(tuple(Atom(word, ()) for word in words)), domain.derived)
        return PlanGoals(literals, frozenset(reads))

    def goals_hold(self) -> bool:
        """Whether there are goals, and all hold now."""
        goals = _answer(self._client.goals)
        return bool(goals) and all(self.query(goals))


def _timed(row: Timed) -> Union[TimedLiteral, TimedValue]:
    item, time = row.item, row.at / 1e9
    assert not isinstance(item, Instance)
    term = PlanTerm(item.name, item.args)
    if isinstance(item, Fact):
        return TimedLiteral(time, term, item.negative)
    return TimedValue(time, term, item.value)


def _term(item: KnowledgeItem) -> PlanTerm:
    return PlanTerm(item.attribute_name, tuple(value.value for value in item.values))


def _answer(call: Callable[[], _Answer]) -> _Answer:
    try:
        return call()
    except ServiceError as error:
        raise PlanKnowledgeError(str(error)) from error


def _stored(conditions: Conditions) -> List[PlanTerm]:
    """The atoms of some conditions that a knowledge base has to be asked for."""
    return [atom for atom in conditions.positive + conditions.negative if atom.name != "="]


def _look_up(store: KnowledgeStore, asked: Sequence[Conditions]) -> List[bool]:
    """Whether the atoms of some conditions hold in a store of this process: nothing is made a message.

    A start waits for it: with ten robots the messages took a tenth of the time from an end to the next start.
    """
    return store.query([Fact(atom.name, atom.arguments) for each in asked for atom in _stored(each)])


def comparison_item(comparison: Comparison) -> KnowledgeItem:
    """A ground numeric condition; arguments count by position."""
    inequality = FormulaWriter(Domain("")).comparison(comparison)
    inequality.grounded = True
    return KnowledgeItem(knowledge_type=KnowledgeItem.INEQUALITY, ineq=inequality)


def _equal(atom: PlanTerm) -> bool:
    return len({argument.lower() for argument in atom.arguments}) <= 1


class DomainFile:
    """Reads the domain that a knowledge base of ours holds, again when the file has changed. Thread-safe.

    Only ours evaluates whole conditions for others; of the original's domain nothing is read.

    :param knowledge_base: its global name.
    """

    def __init__(self, knowledge_base: str) -> None:
        self._knowledge_base = knowledge_base
        self._lock = threading.Lock()  # guards the two fields below
        self._read: Optional[Tuple[str, int]] = None
        self._domain: Optional[Domain] = None

    def domain(self) -> Optional[Domain]:
        """The domain; None when it is not ours, or its file is not on this machine."""
        try:
            bounded_master().lookupService(f"{self._knowledge_base}/apply_effects")
            path: Any = get_param(f"{self._knowledge_base}/domain_path", None)
            path = str(path or get_param("/rosplan/domain_path", ""))
            key = (path, os.stat(path).st_mtime_ns)
        except ERRORS:
            return None
        with self._lock:
            if key != self._read:
                try:
                    self._domain = read_domain(path)
                except PddlError as error:
                    self._domain = None
                    rospy.logwarn(f"{path} has changed and cannot be used: {error}")
                self._read = key
            return self._domain
