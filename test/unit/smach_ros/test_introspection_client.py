# SPDX-License-Identifier: Apache-2.0
"""A client that sets an initial state learns whether the container has taken it over."""

from typing import Any

import pytest

CLIENT = """
import sys
import rospy
from smach_msgs.msg import SmachContainerStatus
from smach_ros import IntrospectionClient

rospy.init_node("viewer")
told = rospy.Publisher("/robot/smach/container_status", SmachContainerStatus, latch=True, queue_size=1)
told.publish(SmachContainerStatus(path="/SM", initial_states=["A"], info=sys.argv[1]))
limit = float(sys.argv[2])
print("taken:", IntrospectionClient().set_initial_state("/robot", "/SM", ["A"], timeout=limit), flush=True)
"""


@pytest.mark.parametrize(
    ("info", "limit", "taken"), [("HEARTBEAT", "2.0", False), ("REMOTE_INIT", "60.0", True)]
)
def test_a_state_that_was_so_before_is_not_an_answer(master: Any, info: str, limit: str, taken: bool) -> None:
    assert master.node(CLIENT, info, limit).expect("taken:") == f"taken: {taken}"
