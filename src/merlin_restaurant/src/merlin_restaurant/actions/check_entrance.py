# SPDX-License-Identifier: Apache-2.0
"""The action (check_entrance): look whether a new client waits at the entrance."""

from typing import Any, Sequence

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.table_state import seen_near, spot
from merlin_restaurant.waiting_clients import add_client, note_clients
from merlin_sm.states.recognition import Recognized

WAITING = 1.3  # m from the entrance's point of interest, straight ahead, to where clients wait
AROUND = 1.0  # m around that place


class CheckEntrance(MerlinActionSM):
    """Takes a picture, and remembers whether a client waits; several robots remember each one."""

    def build(self) -> None:
        """LOOK → REMEMBER."""
        self.add("LOOK", self.state("recognize", ["person"]), {"succeeded": "REMEMBER"})
        self.add("REMEMBER", self.state("function", self._remember, ["detections"]))

    def _remember(self, userdata: Any) -> None:
        there = people_waiting(userdata.detections)
        waiting = self.facts("waiting")
        if there and not waiting:
            add_client(self)
        elif not there and waiting:
            self.remove_facts(waiting)
        if self.robot_parameter:
            note_clients(self, there)


def people_waiting(detections: Sequence[Recognized]) -> int:
    """How many people wait at the entrance, of what was seen."""
    return len(seen_near(detections, spot("entrance", WAITING), AROUND))
