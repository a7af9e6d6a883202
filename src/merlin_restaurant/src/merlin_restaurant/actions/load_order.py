"""The action (load_order ?t): have an order put on the robot's tray."""

from typing import Any, Optional

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.actions.order_to_barman import PICKUP
from merlin_restaurant.menu import HERE_YOU_ARE, MENU, listed
from merlin_restaurant.table_state import seen_near, spot


class LoadOrder(MerlinActionSM):
    """Asks the barman, and sees that nothing of the order stays on the bar."""

    parameters = ["t"]

    def build(self) -> None:
        """ASK → LOOK → NOTHING_LEFT; what is left leads back to ASK."""
        ask = self.state("ask", "Please put the order of {t} on my tray.", HERE_YOU_ARE, ["t"])
        self.add("ASK", ask, {"succeeded": "LOOK", "misunderstood": "aborted"})
        self.add("LOOK", self.state("recognize", MENU), {"succeeded": "NOTHING_LEFT"})
        left = self.state("function", self._left, ["detections"], outcomes=["left"])
        self.register_start_cb(self._begin)
        self.add("NOTHING_LEFT", left, {"left": "ASK"})

    def _begin(self, *_: Any) -> None:
        self._looks = 0

    def _left(self, userdata: Any) -> Optional[str]:
        left = seen_near(userdata.detections, spot("bar", 0.8), PICKUP)
        self._looks += 1
        if left and self._looks > 4:
            raise ValueError(f"the barman leaves it on the bar: {listed(left)}")
        return "left" if left else None
