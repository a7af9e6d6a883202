# SPDX-License-Identifier: Apache-2.0
"""The action (order_to_barman ?t): have an order prepared, and see that it is right (paper, Figure 7)."""

from typing import Any, List, Optional

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.menu import ALL_RIGHT, MENU, READY, difference, listed
from merlin_restaurant.orders import order_of
from merlin_restaurant.table_state import seen_near, spot
from merlin_sm.merlin_sm import MerlinSM

PICKUP = 0.55  # m around the place ahead of the bar's point of interest where orders are put
PREPARING = 45.0  # s that the barman may take
BAR = "bar"  # where the only robot stands
COUNTER = "b"  # the parameter that names the place at the bar, where there are several


class OrderToBarman(MerlinActionSM):
    """Orders from the barman, waits for his call, checks what stands on the bar, and names what is wrong."""

    parameters = ["t"]
    optional = [COUNTER]

    def build(self) -> None:
        """RECALL → TELL → CHECK, a machine of its own that ends when the order is right."""
        recall = self.state("function", self._recall, [*counter_keys(self), "t"], ["order"])
        self.add_auto("RECALL", recall, ["succeeded"])
        tell = self.state("ask", "{t} ordered {order}.", ALL_RIGHT, ["t", "order"])
        self.add("TELL", tell, {"succeeded": "CHECK", "misunderstood": "aborted"})
        self.add("CHECK", self._check())

    def _check(self) -> MerlinSM:
        check = MerlinSM(["succeeded", "aborted", "preempted"], ["order"])
        with check:
            ready = self.state("listen", READY, timeout=PREPARING)
            check.add("WAIT", ready, {"succeeded": "LOOK", "misunderstood": "LOOK"})
            check.add("LOOK", self.state("recognize", MENU), {"succeeded": "COMPARE"})
            ends = ["wrong", "nothing"]
            compare = self.state("function", self._compare, ["order", "detections"], ["wrong"], ends)
            check.add("COMPARE", compare, {"wrong": "COMPLAIN", "nothing": "WAIT"})
            complain = self.state("ask", "I am sorry, {wrong}.", ALL_RIGHT, ["wrong"])
            check.add("COMPLAIN", complain, {"succeeded": "WAIT", "misunderstood": "LOOK"})
        return check

    def _recall(self, userdata: Any) -> None:
        self._looks = 0
        self._counter = userdata[COUNTER] if counter_keys(self) else BAR
        userdata.order = listed(order_of(self, userdata.t))

    def _compare(self, userdata: Any) -> Optional[str]:
        seen = seen_near(userdata.detections, spot(self._counter, 0.8), PICKUP)
        wrong = userdata.wrong = difference(userdata.order.split(" and "), seen)
        if not wrong:
            return None
        self._looks += 1
        if self._looks > 4:
            raise ValueError(f"the barman does not get it right: {wrong}")
        return "wrong" if seen else "nothing"


def counter_keys(action: MerlinActionSM) -> List[str]:
    """The userdata key that names the place at the bar; none where there is one place."""
    return [COUNTER] if COUNTER in action.parameters else []
