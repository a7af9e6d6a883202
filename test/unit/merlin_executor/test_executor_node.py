# SPDX-License-Identifier: Apache-2.0
"""The node of the Executor: a pause outlives what it is kept in, and a wrong parameter is named at once."""

from typing import Any

import pytest

pytestmark = pytest.mark.processes

PAUSED = """
import sys
from merlin_executor.node.pause_services import offer_pause
from merlin_ros.node import on_master_replaced, run_node

def start():
    start.services = offer_pause(lambda paused: print("PAUSED", paused, flush=True))
    on_master_replaced(lambda: print("REPLACED", flush=True))

sys.exit(run_node("executor", start))
"""

EXECUTOR = """
import sys
from merlin_executor.node.executor_node import main
sys.exit(main())
"""

OPERATOR = """
import rospy
from std_srvs.srv import Trigger

rospy.init_node("operator")
rospy.wait_for_service("merlin/pause")
print(rospy.ServiceProxy("merlin/pause", Trigger)().message, flush=True)
"""


def test_a_pause_is_kept_at_a_master_that_is_started_anew_just_then(master: Any) -> None:
    master.api.setParam("/test", "/use_sim_time", False)
    executor = master.node(PAUSED)
    master.node(OPERATOR).expect("Paused")
    master.kill()
    master.start()
    executor.expect("REPLACED")
    executor.end()
    master.node(PAUSED).expect("PAUSED True")


@pytest.mark.parametrize("parameter", ["max_replans:=2.5", "together:=0", "stand_wait:=soon"])
def test_a_wrong_parameter_is_named_before_the_wait_for_the_planning_system(
    master: Any, parameter: str
) -> None:
    master.api.setParam("/test", "/use_sim_time", False)
    executor = master.node(EXECUTOR, f"_{parameter}", "_planning_system_wait:=3600")
    assert executor.ended() == 2
    assert parameter.partition(":=")[0] in executor.output and "Traceback" not in executor.output
