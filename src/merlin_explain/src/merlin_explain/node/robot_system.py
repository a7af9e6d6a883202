# SPDX-License-Identifier: Apache-2.0
"""What a question may ask of the running system. Nothing is connected before a question needs it."""

import threading
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import rospy
from merlin_msgs.msg import DispatchStatus, ExecutorStatus, GoalQueue
from merlin_msgs.srv import PreviewPlan, PreviewPlanResponse
from std_msgs.msg import String

from merlin_explain.claims import QuestionError, Words
from merlin_explain.core.why import Doing, Request
from merlin_monitor.text.request_words import sender_of
from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.text_reader import text_of
from merlin_planning.knowledge_client import KnowledgeClient, knowledge_client
from merlin_planning.knowledge_text import step_text, to_pddl
from merlin_planning.planning_client import TopicWatch
from merlin_ros.master.master_link import get_param
from merlin_ros.service_proxy import ServiceProxy

#: s of wall time for a plan that answers a question; the planner interface ends it earlier.
PLAN_LIMIT = 20.0
#: s of running time for the last message of a latched topic to arrive.
LATCHED = 1.0


class Names(NamedTuple):
    """Names of the planning system's nodes and of the Executor's topics."""

    knowledge: str = "rosplan_knowledge_base"
    problem: str = "rosplan_problem_interface"
    planner: str = "rosplan_planner_interface"
    dispatcher: str = "rosplan_plan_dispatcher"
    executor: str = "merlin"


USUAL = Names()


class RobotSystem:
    """Reads what the nodes of a robot say. Thread-safe.

    :param names: of its nodes.
    """

    def __init__(self, names: Names = USUAL) -> None:
        self.names = names
        self._lock = threading.Lock()  # guards the fields below
        self._topics: Dict[str, TopicWatch] = {}
        self._domain: Optional[Tuple[str, Domain]] = None
        self._words: Optional[Tuple[Domain, Words]] = None
        self._preview = ServiceProxy(f"{names.planner}/preview_plan", PreviewPlan, timeout=PLAN_LIMIT)

    @property
    def knowledge(self) -> KnowledgeClient:
        """The client of the knowledge base."""
        return knowledge_client(self.names.knowledge)

    def _latest(self, topic: str, kind: type) -> Any:
        """The last message of a latched topic; None: nothing was ever published.

        :raises MasterSilent: when the master does not answer.
        """
        with self._lock:
            known = self._topics.get(topic)
            watch = self._topics[topic] = known or TopicWatch(topic, kind)
        return watch.message if known else watch.wait_newer(0, LATCHED)

    def planned(self) -> Tuple[str, str]:
        """The problem of the last plan, and its text.

        :raises QuestionError: no plan was made.
        """
        problem = self._latest(f"{self.names.problem}/problem_instance", String)
        plan = self._latest(f"{self.names.planner}/planner_output", String)
        if problem is None or plan is None:
            raise QuestionError("no plan was made yet, so no step of one can be asked about")
        return problem.data, plan.data

    def doing(self) -> Doing:
        """What becomes of the plan."""
        status = self._latest(f"{self.names.dispatcher}/dispatch_status", DispatchStatus)
        executor = self._latest(f"{self.names.executor}/status", ExecutorStatus)
        queue = self._latest(f"{self.names.executor}/queue", GoalQueue)
        asked = [executor, *executor.together] if executor is not None and executor.request else []
        asked += queue.requests if queue is not None else []
        return Doing(
            status is not None and status.state != DispatchStatus.IDLE,
            [step_text(each) for each in (status.running if status else ())],
            [
                Request(each.request, each.goals, each.by or sender_of(each.request), each.priority)
                for each in asked
            ],
        )

    def goals(self) -> List[str]:
        """The goals of the knowledge base as PDDL text."""
        return [to_pddl(item) for item in self.knowledge.goals()]

    def domain_text(self) -> str:
        """The PDDL file of the planning system's domain.

        :raises PddlError: it is not on this machine.
        """
        return text_of(str(get_param(f"{rospy.resolve_name(self.names.knowledge)}/domain_path", "")))

    def domain(self) -> Domain:
        """The domain, with its operators.

        :raises PddlError: its file is not on this machine, or is not PDDL.
        """
        text = self.domain_text()
        with self._lock:
            if self._domain is None or self._domain[0] != text:
                self._domain = text, parse_domain(text)
            return self._domain[1]

    def words(self) -> Words:
        """What the application calls its steps and facts."""
        from merlin_explain.node.application_words import ApplicationWords  # with the page's texts
        from merlin_monitor.listeners.ros_system import RosSystem
        from merlin_monitor.panels.control import sentences_of_node

        domain = self.domain()
        with self._lock:
            if self._words is None or self._words[0] is not domain:
                sentences = sentences_of_node(RosSystem(), needed=False)
                self._words = domain, ApplicationWords(domain, sentences)
            return self._words[1]

    def preview(self, **request: Any) -> PreviewPlanResponse:
        """A plan that is not carried out.

        :param request: fields of ``merlin_msgs/PreviewPlan``.
        :raises ServiceError: when the planner interface does not answer.
        """
        return self._preview(**request)
