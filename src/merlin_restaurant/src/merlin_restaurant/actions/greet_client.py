"""The action (greet_client ?c): welcome a new client."""

from typing import Any

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.menu import YES_NO


class GreetClient(MerlinActionSM):
    """Greets, and asks whether the client would like a table."""

    parameters = ["c"]

    def build(self) -> None:
        """GREET → WANTED; silence leads to NOBODY."""
        greet = self.state("ask", "Good evening, and welcome. Would you like a table?", YES_NO)
        self.add("GREET", greet, {"succeeded": "WANTED", "misunderstood": "NOBODY"})
        self.add("WANTED", self.state("function", self._wanted, ["c", "heard"]))
        self.add("NOBODY", self.state("function", self._nobody, ["c"]))

    def _wanted(self, userdata: Any) -> None:
        if userdata.heard.startswith("no"):
            self.remove_facts(f"(waiting {userdata.c})")
            raise ValueError(f"{userdata.c} does not want a table")

    def _nobody(self, userdata: Any) -> None:
        self.remove_facts(f"(waiting {userdata.c})")
        raise ValueError(f"{userdata.c} did not answer so that it could be understood")
