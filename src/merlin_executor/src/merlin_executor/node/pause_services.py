# SPDX-License-Identifier: Apache-2.0
"""The services that pause the Executor; a pause outlives its process."""

import threading
from typing import Callable

import rospy
from std_srvs.srv import Trigger, TriggerResponse

from merlin_ros.master.master_link import ERRORS, bounded_master

PAUSED = "Paused: no further request begins; the running one continues."
PAUSED_PARAM = "~paused"


class PauseServices:
    """The services ``merlin/pause`` and ``merlin/resume``; a pause outlives its process.

    :param switch: called with whether no further request begins; at once when the last process was paused.
    """

    def __init__(self, switch: Callable[[bool], None]) -> None:
        self._switch = switch
        self._lock = threading.Lock()  # orders the changes
        if rospy.get_param(PAUSED_PARAM, False) is True:
            switch(True)
            rospy.logwarn("the executor is paused, as it was before; call merlin/resume")
        self._services = [
            rospy.Service("merlin/pause", Trigger, lambda _: self._set(True, PAUSED)),
            rospy.Service(
                "merlin/resume", Trigger, lambda _: self._set(False, "The next request may begin.")
            ),
        ]

    def _set(self, paused: bool, words: str) -> TriggerResponse:
        with self._lock:
            self._switch(paused)
            try:
                # It is in effect already; when the master hangs, only the parameter is missing.
                bounded_master().setParam(rospy.resolve_name(PAUSED_PARAM), paused)
            except ERRORS as error:
                rospy.logerr(f"executor: the master does not keep the pause for a restart: {error}")
        return TriggerResponse(True, words)
