#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""A plan dispatcher with the manners of ROSPlan's own, as the interface pages state them.

``~manner`` simple: one action after the other; no interface gets a cancel; the flag of a stray cancel stays
and makes the next dispatch "succeed" at once; a plan is kept and runs again.
``~manner`` esterel: what the edges of the plan graph allow runs at once; their time bounds are not kept;
unmet conditions are asked again while an action runs, where ROSPlan's asks for ever; a failed action is never
noticed; when a dispatch ends, ``cancel_action`` goes out for every action that was sent, also after success.
It draws a plan when it receives it, and again when something of it was dispatched (``plan_graph``).
Both: 10 Hz loops, everything latched, ``success`` true on cancel, ids from 0 in every plan, plan ids 0.
A plan is received ``~plan_delay`` s after it was sent, and a call before that carries out the old one.
"""

import threading

import rospy
from rosplan_dispatch_msgs.msg import (
    ActionDispatch,
    ActionFeedback,
    CompletePlan,
    EsterelPlan,
    EsterelPlanNode,
)
from rosplan_dispatch_msgs.srv import DispatchService, DispatchServiceResponse
from rosplan_knowledge_msgs.srv import (
    GetAttributeService,
    GetDomainOperatorDetailsService,
    KnowledgeQueryService,
)
from std_msgs.msg import String
from std_srvs.srv import Empty, EmptyResponse

from merlin_planning.knowledge_client import fact
from merlin_test.topic_links import init_node

SUCCEEDED = ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE
FAILED = ActionFeedback.ACTION_FAILED


class StandIn:
    def __init__(self):
        self.esterel = rospy.get_param("~manner") == "esterel"
        self.plan = None
        self.cancelled = False
        self.endings = {}
        self.dispatching = threading.Lock()
        # ROSPlan has queues of one; what they drop depends on the machine: test_plain_progress.py has it.
        self.dispatches = rospy.Publisher("~action_dispatch", ActionDispatch, latch=True, queue_size=1000)
        self.feedbacks = rospy.Publisher("~action_feedback", ActionFeedback, latch=True, queue_size=1000)
        if self.esterel:
            self.drawings = rospy.Publisher("~plan_graph", String, latch=True, queue_size=1000)
        plan_class = EsterelPlan if self.esterel else CompletePlan
        rospy.Subscriber("rosplan_parsing_interface/complete_plan", plan_class, self.take_plan)
        rospy.Subscriber("~action_feedback", ActionFeedback, self.take_feedback, queue_size=1000)
        self.goals = rospy.ServiceProxy("rosplan_knowledge_base/state/goals", GetAttributeService)
        self.query = rospy.ServiceProxy("rosplan_knowledge_base/query_state", KnowledgeQueryService)
        self.operator = rospy.ServiceProxy(
            "rosplan_knowledge_base/domain/operator_details", GetDomainOperatorDetailsService
        )
        rospy.Service("~dispatch_plan", DispatchService, self.dispatch)
        rospy.Service("~cancel_dispatch", Empty, self.cancel)

    def take_plan(self, message):
        rospy.sleep(rospy.get_param("~plan_delay", 0.0))
        for action in [node.action for node in message.nodes] if self.esterel else message.plan:
            action.plan_id = 0
        self.plan = message
        if self.esterel:
            self.draw(message.nodes)

    def draw(self, nodes):
        lines = []
        for node in nodes:
            values = ",".join(value.value for value in node.action.parameters)
            label = node.name if node.node_type == EsterelPlanNode.PLAN_START else f"{node.name}\\n({values})"
            lines.append(f'{node.node_id}[ label="{label}"];')
        self.drawings.publish(String("\n".join(["digraph plan {", *lines, "}", ""])))

    def take_feedback(self, message):
        # Our own feedback comes back over another connection, maybe behind the action's end.
        if message.status in (SUCCEEDED, FAILED):
            self.endings[message.action_id] = message.status

    def cancel(self, request):
        self.cancelled = True
        return EmptyResponse()

    def dispatch(self, request):
        if not self.dispatching.acquire(blocking=False):
            raise rospy.ServiceException("already dispatching")
        try:
            if self.esterel:
                self.cancelled = False
            success = self.run_graph() if self.esterel else self.run_list()
            self.cancelled = False
        finally:
            self.dispatching.release()
        goals = self.goals("").attributes
        achieved = all(self.query([goal]).all_true for goal in goals)
        return DispatchServiceResponse(success=success, goal_achieved=achieved)

    def run_list(self):
        rate = rospy.Rate(10)
        for action in list(self.plan.plan) if self.plan is not None else []:
            if self.cancelled:
                break
            if not self.applicable(action):
                self.feedbacks.publish(ActionFeedback(action_id=action.action_id, status=0))
                return False
            self.send(action)
            self.feedbacks.publish(ActionFeedback(action_id=action.action_id, status=1))
            while self.endings.get(action.action_id) is None and not rospy.is_shutdown():
                rate.sleep()
            if self.endings.get(action.action_id) == FAILED:
                return False
        return True

    def run_graph(self):
        nodes, rate = list(self.plan.nodes) if self.plan is not None else [], rospy.Rate(10)
        active = set()  # edges whose source has happened
        happened = set()  # nodes
        sent = []
        while len(happened) < len(nodes) and not self.cancelled and not rospy.is_shutdown():
            before = len(happened)
            for node in [each for each in nodes if each.node_id not in happened]:
                if active.issuperset(node.edges_in) and self.happens(node, sent):
                    happened.add(node.node_id)
                    active.update(node.edges_out)
            if len(happened) > before:
                self.draw(nodes)
            if len(happened) == before and all(
                self.endings.get(each.action_id) == SUCCEEDED for each in sent
            ):
                return False  # an old plan whose conditions never come true
            rate.sleep()
        for action in sent:
            self.dispatches.publish(self.cancel_of(action))
            rate.sleep()
        return True

    def happens(self, node, sent):
        action = node.action
        if node.node_type == EsterelPlanNode.ACTION_END:
            return self.endings.get(action.action_id) == SUCCEEDED
        if node.node_type == EsterelPlanNode.ACTION_START:
            if not self.applicable(action):
                return False
            self.send(action)
            sent.append(action)
        return True

    def send(self, action):
        self.endings.pop(action.action_id, None)
        self.dispatches.publish(action)

    def applicable(self, action):
        """At-start conditions only, by position, as ROSPlan checks them."""
        operator = self.operator(action.name).op
        names = [parameter.key for parameter in operator.formula.typed_parameters]
        binding = dict(zip(names, (parameter.value for parameter in action.parameters)))
        conditions = [
            fact(condition.name, *[binding.get(value.key, "") for value in condition.typed_parameters])
            for condition in operator.at_start_simple_condition
        ]
        return self.query(conditions).all_true

    @staticmethod
    def cancel_of(action):
        return ActionDispatch(action_id=action.action_id, name="cancel_action", parameters=action.parameters)


init_node("rosplan_plan_dispatcher")
stand_in = StandIn()
rospy.spin()
