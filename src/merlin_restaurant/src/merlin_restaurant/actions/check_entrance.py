"""The action (check_entrance): look whether a new client waits at the entrance."""

from typing import Any

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.table_state import seen_near, spot

WAITING = 1.3  # m from the entrance's point of interest, straight ahead, to where clients wait
AROUND = 1.0  # m around that place


class CheckEntrance(MerlinActionSM):
    """Takes a picture, and remembers whether a client waits."""

    def build(self) -> None:
        """LOOK → REMEMBER."""
        self.add("LOOK", self.state("recognize", ["person"]), {"succeeded": "REMEMBER"})
        self.add("REMEMBER", self.state("function", self._remember, ["detections"]))

    def _remember(self, userdata: Any) -> None:
        there = seen_near(userdata.detections, spot("entrance", WAITING), AROUND)
        waiting = self.facts("waiting")
        if there and not waiting:
            client = f"client_{len(self.objects('client')) + 1}"
            self.add_objects("client", client)
            self.add_facts(f"(waiting {client})")
        elif not there and waiting:
            self.remove_facts(waiting)
