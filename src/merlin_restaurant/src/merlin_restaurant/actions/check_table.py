# SPDX-License-Identifier: Apache-2.0
"""The action (check_table ?t): look at a table and say in which state it is."""

from typing import Any

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.second_look import table_look
from merlin_restaurant.table_state import decide, dishes_on, people_at, remember_state


class CheckTable(MerlinActionSM):
    """Takes a picture, remembers the table's state, and says it aloud."""

    parameters = ["t"]

    def build(self) -> None:
        """LOOK → JUDGE → TELL."""
        self.add_auto("LOOK", table_look(bool(self.robot_parameter)), ["succeeded"])
        judge = self.state("function", self._judge, ["t", "detections"], ["state"])
        self.add_auto("JUDGE", judge, ["succeeded"])
        self.add("TELL", self.state("speak", "{t}: {state}.", keys=("t", "state")))

    def _judge(self, userdata: Any) -> None:
        table, seen = userdata.t, userdata.detections
        state = userdata.state = decide(people_at(table, seen), dishes_on(table, seen))
        remember_state(self, table, state)  # before it speaks: an interruption loses nothing
