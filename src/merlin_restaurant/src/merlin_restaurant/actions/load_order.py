# SPDX-License-Identifier: Apache-2.0
"""The action (load_order ?t): have an order put on the robot's tray."""

from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.composites import Sequence
from py_trees.decorators import Retry

from merlin_actions.merlin_action_bt import MerlinActionBT
from merlin_restaurant.actions.order_to_barman import BAR, COUNTER, PICKUP, counter_keys
from merlin_restaurant.menu import HERE_YOU_ARE, MENU, listed
from merlin_restaurant.table_state import seen_near, spot

TRIES = 5


class LoadOrder(MerlinActionBT):
    """Asks the barman, and sees that nothing of the order stays on the bar; a behaviour tree."""

    parameters = ["t"]
    optional = [COUNTER]

    def tree(self) -> Behaviour:
        """ASK, LOOK, NOTHING_LEFT, and from the beginning as long as one of them fails."""
        text = "Please put the order of {t} on my tray."
        ask = self.behaviour("ASK", self.state("ask", text, HERE_YOU_ARE, ["t"], attempts=1))
        keys = [*counter_keys(self), "detections"]
        look = self.behaviour("LOOK", self.state("recognize", MENU))
        left = self.behaviour("NOTHING_LEFT", self.state("function", self._left, keys))
        return Retry("UNTIL_LOADED", Sequence("LOAD", memory=True, children=[ask, look, left]), TRIES)

    def _left(self, userdata: Any) -> None:
        counter = userdata[COUNTER] if counter_keys(self) else BAR
        left = seen_near(userdata.detections, spot(counter, 0.8), PICKUP)
        if left:
            raise ValueError(f"the barman leaves it on the bar: {listed(left)}")
