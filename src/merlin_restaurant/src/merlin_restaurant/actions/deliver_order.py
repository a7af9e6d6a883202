# SPDX-License-Identifier: Apache-2.0
"""The action (deliver_order ?t): hand over an order and hear that it is right."""

from typing import Any

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.menu import YES_NO, listed
from merlin_restaurant.orders import order_of
from merlin_restaurant.second_look import table_look
from merlin_restaurant.table_state import decide, dishes_on, people_at, remember_state


class DeliverOrder(MerlinActionSM):
    """Looks whether the guests are still there, offers what is on the tray, and has it confirmed."""

    parameters = ["t"]

    def build(self) -> None:
        """LOOK → SEE → OFFER → ACCEPTED."""
        self.add_auto("LOOK", table_look(bool(self.robot_parameter)), ["succeeded"])
        see = self.state("function", self._see, ["t", "detections"], ["order"])
        self.add_auto("SEE", see, ["succeeded"])
        offer = self.state("ask", "Here is your {order}. Is everything right?", YES_NO, ["order"])
        self.add("OFFER", offer, {"succeeded": "ACCEPTED", "misunderstood": "aborted"})
        self.add("ACCEPTED", self.state("function", self._accepted, ["t", "heard"]))

    def _see(self, userdata: Any) -> None:
        table, seen = userdata.t, userdata.detections
        if not people_at(table, seen):
            remember_state(self, table, decide(0, dishes_on(table, seen)))
            raise ValueError(f"the guests have left {table}")
        userdata.order = listed(order_of(self, table))

    def _accepted(self, userdata: Any) -> None:
        if userdata.heard.startswith("no"):
            raise ValueError(f"the guest at {userdata.t} says that it is not what was ordered")
