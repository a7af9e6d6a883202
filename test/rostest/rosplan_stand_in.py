#!/usr/bin/env python3
"""A plan dispatcher with the manners of ROSPlan's own, as the interface pages state them.

``~manner`` simple: one action after the other; nobody is told of a cancel; the flag of a stray cancel stays
and makes the next dispatch "succeed" at once; a plan is kept and runs again.
``~manner`` esterel: a failed action is never noticed; when a dispatch ends, ``cancel_action`` goes out for
every action of the plan, also after success.
Both: 10 Hz loops, everything latched, ``success`` true on cancel, ids from 0 in every plan, plan ids 0.
"""

import threading

import rospy
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback, CompletePlan
from rosplan_dispatch_msgs.srv import DispatchService, DispatchServiceResponse
from rosplan_knowledge_msgs.srv import (
    GetAttributeService,
    GetDomainOperatorDetailsService,
    KnowledgeQueryService,
)
from std_srvs.srv import Empty, EmptyResponse

from merlin_sm.knowledge_client import fact

SUCCEEDED = ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE
FAILED = ActionFeedback.ACTION_FAILED


class StandIn:
    def __init__(self):
        self.esterel = rospy.get_param("~manner") == "esterel"
        self.plan = []
        self.cancelled = False
        self.endings = {}
        self.dispatching = threading.Lock()
        self.dispatches = rospy.Publisher("~action_dispatch", ActionDispatch, latch=True, queue_size=1)
        self.feedbacks = rospy.Publisher("~action_feedback", ActionFeedback, latch=True, queue_size=1)
        rospy.Subscriber("rosplan_parsing_interface/complete_plan", CompletePlan, self.take_plan)
        rospy.Subscriber("~action_feedback", ActionFeedback, self.take_feedback, queue_size=1000)
        self.goals = rospy.ServiceProxy("rosplan_knowledge_base/state/goals", GetAttributeService)
        self.query = rospy.ServiceProxy("rosplan_knowledge_base/query_state", KnowledgeQueryService)
        self.operator = rospy.ServiceProxy(
            "rosplan_knowledge_base/domain/operator_details", GetDomainOperatorDetailsService
        )
        rospy.Service("~dispatch_plan", DispatchService, self.dispatch)
        rospy.Service("~cancel_dispatch", Empty, self.cancel)

    def take_plan(self, message):
        self.plan = message.plan
        for action in self.plan:
            action.plan_id = 0

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
            success = self.run()
            self.cancelled = False
        finally:
            self.dispatching.release()
        goals = self.goals("").attributes
        achieved = all(self.query([goal]).all_true for goal in goals)
        return DispatchServiceResponse(success=success, goal_achieved=achieved)

    def run(self):
        plan, rate = list(self.plan), rospy.Rate(10)
        sent = []
        success = True
        for action in plan:
            if self.cancelled:
                break
            if not self.applicable(action):
                self.feedbacks.publish(ActionFeedback(action_id=action.action_id, status=0))
                success = False
                break
            self.endings.pop(action.action_id, None)
            self.dispatches.publish(action)
            sent.append(action)
            if not self.esterel:
                self.feedbacks.publish(ActionFeedback(action_id=action.action_id, status=1))
            while not self.ended(action) and not rospy.is_shutdown():
                rate.sleep()
            if not self.esterel and self.endings.get(action.action_id) == FAILED:
                success = False
                break
        if self.esterel:
            for action in sent:
                self.dispatches.publish(self.cancel_of(action))
                rate.sleep()
        return success

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

    def ended(self, action):
        status = self.endings.get(action.action_id)
        if self.esterel:
            return self.cancelled or status == SUCCEEDED
        return status in (SUCCEEDED, FAILED)

    @staticmethod
    def cancel_of(action):
        return ActionDispatch(action_id=action.action_id, name="cancel_action", parameters=action.parameters)


rospy.init_node("rosplan_plan_dispatcher")
stand_in = StandIn()
rospy.spin()
