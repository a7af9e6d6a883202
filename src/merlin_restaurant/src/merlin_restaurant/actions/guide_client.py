"""The action (guide_client ?c ?t): bring a client to a table, at the client's pace."""

from typing import Any

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.follower_watch import BEHIND, CLOSE, FollowerWatch, WatchState

PATIENCE = 20.0  # s that the robot waits for somebody who has fallen behind


class GuideClient(MerlinActionSM):
    """Drives ahead, waits when the client falls behind, and gives up when the client is gone."""

    parameters = ["c", "t"]
    if_interrupted = ["(robot_at anywhere)", "(ready ?t)"]

    def build(self) -> None:
        """INVITE → LEAD → OFFER_SEAT; who falls behind leads to CALL → WAIT, who is gone to GONE."""
        watch = FollowerWatch()
        self.register_start_cb(watch.begin)
        self.register_termination_cb(watch.end)
        self.add_auto("INVITE", self.state("speak", "Please follow me to {t}.", ["t"]), ["succeeded"])
        behind = WatchState(watch, lambda distance: distance > BEHIND)
        lead = self.state("while", self.state("navigation"), behind, "behind", {"target": "t"})
        self.add("LEAD", lead, {"succeeded": "OFFER_SEAT", "behind": "CALL", "lost": "GONE"})
        self.add("CALL", self.state("speak", "I wait for you."), {"succeeded": "WAIT"})
        wait = WatchState(watch, lambda distance: distance < CLOSE, PATIENCE)
        self.add("WAIT", wait, {"succeeded": "LEAD", "lost": "GONE"})
        self.add("GONE", self.state("function", self._gone, ["c"]))
        seat = self.state("speak", "This is {t}. Please take a seat.", ["t"])
        self.add("OFFER_SEAT", seat, {"succeeded": "succeeded"})

    def _gone(self, userdata: Any) -> None:
        self.remove_facts(f"(greeted {userdata.c})")
        raise ValueError(f"{userdata.c} does not follow any more")
