"""The action (guide_client ?c ?t): bring a client to a table, at the client's pace."""

from typing import Any

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.follower_watch import FollowerWatch, WatchState

PATIENCE = 20.0  # s that the robot waits for somebody who has fallen behind or is not seen


class GuideClient(MerlinActionSM):
    """Drives ahead, waits when the client falls behind, and gives up when the client is gone."""

    parameters = ["c", "t"]
    if_interrupted = ["(robot_at anywhere)", "(ready ?t)"]

    def build(self) -> None:
        """INVITE → LEAD → OFFER_SEAT; who falls behind leads to CALL → WAIT, and being lost to SAY_LOST."""
        watch = FollowerWatch()
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
        self.add("GONE", self.state("function", self._gone, ["c"]))
        seat = self.state("speak", "This is {t}. Please take a seat.", ["t"])
        self.add("OFFER_SEAT", seat, {"succeeded": "succeeded"})

    def _gone(self, userdata: Any) -> None:
        self.remove_facts(f"(greeted {userdata.c})")
        raise ValueError(f"{userdata.c} does not follow any more")
