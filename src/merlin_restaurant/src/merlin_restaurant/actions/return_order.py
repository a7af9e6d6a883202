# SPDX-License-Identifier: Apache-2.0
"""The action (return_order ?t): bring back an order whose guests have left."""

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.actions.order_to_barman import COUNTER
from merlin_restaurant.menu import ALL_RIGHT


class ReturnOrder(MerlinActionSM):
    """Asks the barman to take an order from the tray."""

    parameters = ["t"]
    optional = [COUNTER]

    def build(self) -> None:
        """ASK, which the barman has to confirm."""
        text = "The guests of {t} have left. Please take the order from my tray."
        self.add("ASK", self.state("ask", text, ALL_RIGHT, ["t"]), {"misunderstood": "aborted"})
