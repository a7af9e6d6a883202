# SPDX-License-Identifier: Apache-2.0
"""The action (guide_client ?c ?t): bring a client to a table, at the client's pace."""

from typing import Any, Optional

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.actions.navigate import STOPPED_AT
from merlin_restaurant.follower_watch import FollowerWatch, WatchState
from merlin_restaurant.table_state import people_at
from merlin_ros.ros_alarm import RosStopwatch

PATIENCE = 20.0  # s that the robot waits for a client that has fallen behind or is not seen
SITS_DOWN = 40.0  # s that a client may take to sit down


class GuideClient(MerlinActionSM):
    """Drives ahead, waits for a client that falls behind, gives up a lost one, and sees the client sit down.

    A table that is looked at before its client sits there would be taken for a free one.
    """

    parameters = ["c", "t"]
    if_interrupted = ["(robot_at anywhere)", "(ready ?t)"]
    if_stopped_at = STOPPED_AT

    def build(self) -> None:
        """INVITE → LEAD → OFFER_SEAT → LOOK → SEATED; a client behind leads to CALL → WAIT (→ SAY_LOST)."""
        if self.robot_parameter:
            self.if_interrupted = [*self.if_interrupted, f"(quiet ?{self.robot_parameter})", "(free ?t)"]
        watch = FollowerWatch()
        self.register_start_cb(self._begin)
        self.register_start_cb(watch.begin)
        self.register_termination_cb(watch.end)
        self.add_auto("INVITE", self.state("speak", "Please follow me to {t}.", ["t"]), ["succeeded"])
        behind = WatchState(watch, lambda: watch.behind)
        lead = self.state("while", self.state("navigation"), behind, "behind", {"target": "t"})
        self.add("LEAD", lead, {"succeeded": "OFFER_SEAT", "behind": "CALL"})
        self.add("CALL", self.state("speak", "I wait for you."), {"succeeded": "WAIT"})
        wait = WatchState(watch, lambda: watch.close, PATIENCE)
        self.add("WAIT", wait, {"succeeded": "LEAD", "lost": "SAY_LOST"})
        say_lost = self.state("speak", "I am sorry, I have lost you. Please wait at the entrance.")
        self.add("SAY_LOST", say_lost, {"succeeded": "GONE", "aborted": "GONE"})
        self.add("GONE", self.state("function", self._gone, self.parameters))
        seat = self.state("speak", "This is {t}. Please take a seat.", ["t"])
        self.add("OFFER_SEAT", seat, {"succeeded": "LOOK"})
        self.add("LOOK", self.state("recognize", ["person"]), {"succeeded": "SEATED"})
        seated = self.state("function", self._seated, ["t", "detections"], outcomes=["not_yet"])
        self.add("SEATED", seated, {"not_yet": "LOOK"})

    def _begin(self, *_: Any) -> None:
        self._offered: Optional[RosStopwatch] = None  # from the first look at the table on

    def _seated(self, userdata: Any) -> Optional[str]:
        self._offered = self._offered or RosStopwatch()
        if people_at(userdata.t, userdata.detections):
            return None
        if self._offered.look() > SITS_DOWN:
            raise ValueError(f"the client does not sit down at {userdata.t}")
        return "not_yet"

    def _gone(self, userdata: Any) -> None:
        who = [userdata[name] for name in self.parameters if name != "t"]
        self.remove_facts(f"(greeted {' '.join(who)})")
        raise ValueError(f"{userdata.c} no longer follows")
