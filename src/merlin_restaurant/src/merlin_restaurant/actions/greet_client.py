# SPDX-License-Identifier: Apache-2.0
"""The action (greet_client ?c): welcome a new client."""

from typing import Any

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.actions.check_entrance import people_waiting
from merlin_restaurant.menu import YES_NO
from merlin_restaurant.waiting_clients import note_clients


class GreetClient(MerlinActionSM):
    """Greets, and asks whether the client would like a table."""

    parameters = ["c"]

    def build(self) -> None:
        """GREET → WANTED; silence leads to NOBODY. Several robots LOOK and COUNT the other clients before."""
        if self.robot_parameter:
            look = self.state("recognize", ["person"])
            self.add("LOOK", look, {"succeeded": "COUNT", "aborted": "GREET"})
            self.add("COUNT", self.state("function", self._count, ["detections"]), {"succeeded": "GREET"})
        greet = self.state("ask", "Good evening, and welcome. Would you like a table?", YES_NO)
        self.add("GREET", greet, {"succeeded": "WANTED", "misunderstood": "NOBODY"})
        self.add("WANTED", self.state("function", self._wanted, ["c", "heard"]))
        self.add("NOBODY", self.state("function", self._nobody, ["c"]))

    def _count(self, userdata: Any) -> None:
        note_clients(self, people_waiting(userdata.detections))

    def _wanted(self, userdata: Any) -> None:
        if userdata.heard.startswith("no"):
            self.remove_facts(f"(waiting {userdata.c})")
            raise ValueError(f"{userdata.c} does not want a table")

    def _nobody(self, userdata: Any) -> None:
        self.remove_facts(f"(waiting {userdata.c})")
        raise ValueError(f"{userdata.c} did not answer so that it could be understood")
