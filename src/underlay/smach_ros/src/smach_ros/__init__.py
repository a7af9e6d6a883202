# SPDX-License-Identifier: Apache-2.0
"""SMACH for ROS: states that call actions and services and watch topics, and the introspection of containers.

Importing this package makes smach log through rospy and end at the shutdown of ROS.
"""

import rospy

import smach
import smach.log
from smach_ros.action_server_wrapper import ActionServerWrapper
from smach_ros.condition_state import ConditionState
from smach_ros.introspection import IntrospectionClient, IntrospectionServer
from smach_ros.monitor_state import MonitorState
from smach_ros.service_state import ServiceState
from smach_ros.simple_action_state import SimpleActionState
from smach_ros.util import set_preempt_handler

__all__ = [
    "ActionServerWrapper",
    "ConditionState",
    "IntrospectionClient",
    "IntrospectionServer",
    "MonitorState",
    "ServiceState",
    "SimpleActionState",
    "set_preempt_handler",
]

smach.set_loggers(rospy.loginfo, rospy.logwarn, rospy.logdebug, rospy.logerr)
smach.set_shutdown_check(rospy.is_shutdown)
# Only these hooks run when rospy.is_shutdown() already says so.
rospy.core.add_shutdown_hook(lambda reason: smach.log.notify_shutdown())
