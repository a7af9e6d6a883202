# SPDX-License-Identifier: Apache-2.0
"""The action (take_order ?t): ask the guests of a table what they would like."""

from typing import Any, Optional

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.menu import ORDER, YES_NO, items_in, listed
from merlin_restaurant.orders import remember_order

TRIES = 4  # orders that the guest may take back


class TakeOrder(MerlinActionSM):
    """Asks, repeats what was understood until the guest says yes, and remembers it."""

    parameters = ["t"]

    def build(self) -> None:
        """ASK → NOTE → CONFIRM → REMEMBER; a no leads back, silence and many a no to NOBODY."""
        self.register_start_cb(self._begin)
        ask = self.state("ask", "Good evening. What would you like?", ORDER, timeout=10.0)
        self.add("ASK", ask, {"succeeded": "NOTE", "misunderstood": "NOBODY"})
        self.add("NOTE", self.state("function", self._note, ["heard"], ["order"]), {"succeeded": "CONFIRM"})
        confirm = self.state("ask", "You would like {order}. Is that right?", YES_NO, ["order"])
        self.add("CONFIRM", confirm, {"succeeded": "REMEMBER", "misunderstood": "NOBODY"})
        remember = self.state("function", self._remember, ["t", "heard", "order"], outcomes=["no", "nobody"])
        self.add("REMEMBER", remember, {"no": "ASK", "nobody": "NOBODY"})
        self.add("NOBODY", self.state("function", self._nobody, ["t"]))

    def _begin(self, *_: Any) -> None:
        self._refused = 0

    def _note(self, userdata: Any) -> None:
        userdata.order = listed(items_in(userdata.heard))

    def _remember(self, userdata: Any) -> Optional[str]:
        if userdata.heard.startswith("no"):
            self._refused += 1
            return "no" if self._refused < TRIES else "nobody"
        remember_order(self, userdata.t, items_in(userdata.order))
        return None

    def _nobody(self, userdata: Any) -> None:
        self.remove_facts(f"(needs_serving {userdata.t})")
        raise ValueError(f"no answer at {userdata.t} was understood")
