# SPDX-License-Identifier: Apache-2.0
"""The services that pause the Executor; a pause outlives its process."""

import threading
from typing import Callable, List

import rospy
from std_srvs.srv import Trigger, TriggerResponse

from merlin_ros.master.master_link import MasterSilent, get_param, set_param

RESUMED = "The next request may begin."
PAUSED = "Paused: no further request begins; the running one continues."
PAUSED_PARAM = "~paused"


def offer_pause(switch: Callable[[bool], None]) -> List[rospy.Service]:
    """Offers the services ``merlin/pause`` and ``merlin/resume``; a pause outlives process and master.

    :param switch: called with whether no further request begins; at once when the last process was paused.
    """
    changing = threading.Lock()  # orders the changes

    def change(paused: bool, words: str) -> TriggerResponse:
        with changing:
            switch(paused)
            try:
                set_param(PAUSED_PARAM, paused)  # it is in effect already
            except MasterSilent as error:
                rospy.logerr(f"executor: the master does not keep the pause for a restart: {error}")
        return TriggerResponse(True, words)

    if get_param(PAUSED_PARAM, False) is True:
        switch(True)
        rospy.logwarn("the executor is paused, as it was before; call merlin/resume")
    return [
        rospy.Service("merlin/pause", Trigger, lambda _: change(True, PAUSED)),
        rospy.Service("merlin/resume", Trigger, lambda _: change(False, RESUMED)),
    ]
