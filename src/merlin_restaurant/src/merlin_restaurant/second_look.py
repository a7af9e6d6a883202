# SPDX-License-Identifier: Apache-2.0
"""A look at a table that does not forget an order because a robot stood between camera and guest."""

from typing import Any, Optional

from merlin_restaurant.table_state import people_at
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED
from smach import State

LOOKS = 4  # at most
PAUSE = 2.5  # s between two of them, in which a robot drives on


def table_look(several: bool) -> State:
    """Makes the state that looks at a table.

    :param several: of several robots, another one may hide a guest for a moment.
    """
    return SecondLook() if several else MerlinStateFactory.create("recognize")


class SecondLook(MerlinSM):
    """Looks at ``userdata.t``; again where no guest is seen at a table that has ordered.

    A guest who has ordered does not call again: an order that is forgotten by mistake never arrives.
    ``userdata.detections`` is what was seen last.
    """

    def __init__(self) -> None:
        super().__init__([SUCCEEDED, ABORTED, PREEMPTED], ["t"], ["detections"])
        self.register_start_cb(self._begin)
        with self:
            self.add("LOOK", self.look(), {SUCCEEDED: "SEE"})
            see = FunctionState(self._see, ["t", "detections"], outcomes=["empty"])
            self.add("SEE", see, {"empty": "WAIT"})
            self.add("WAIT", MerlinStateFactory.create("wait", PAUSE), {SUCCEEDED: "LOOK"})

    def look(self) -> State:
        """Makes the state that takes a picture."""
        return MerlinStateFactory.create("recognize")

    def _begin(self, *_: Any) -> None:
        self._looks = 0

    def _see(self, userdata: Any) -> Optional[str]:
        table = userdata.t
        self._looks += 1
        if people_at(table, userdata.detections) or self._looks >= LOOKS:
            return None
        return "empty" if self.holds(f"(ordered {table})") else None
