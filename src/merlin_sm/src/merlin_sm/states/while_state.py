# SPDX-License-Identifier: Apache-2.0
"""Two states at once: one acts, the other watches and may end it."""

from typing import Any, Dict, Mapping, Optional, Sequence

from merlin_sm.merlin_sm import gives_up_with, only_cancelled
from merlin_sm.states.merlin_state import PREEMPTED, SUCCEEDED
from smach import Concurrence, State


class WhileSM(Concurrence):
    """Runs a state as long as another one watches; whichever ends first ends both.

    Outcomes: those of the state that runs; those of the one that watches, whose ``succeeded`` (it saw what it
    waits for) is called `seen` here.

    :param run: the state that acts.
    :param watch: the state that watches.
    :param seen: outcome of this machine when the watch succeeds first.
    :param remapping: userdata key of `run` → userdata key of this machine.
    """

    keeps_userdata = False  # as in every machine of MERLIN

    def __init__(
        self, run: State, watch: State, seen: str = "seen", remapping: Optional[Mapping[str, str]] = None
    ) -> None:
        self._seen = seen
        renamed = [seen if outcome == SUCCEEDED else outcome for outcome in watch.get_registered_outcomes()]
        names = dict(remapping or {})
        inputs = [names.get(key, key) for key in run.get_registered_input_keys()]
        outputs = [names.get(key, key) for key in run.get_registered_output_keys()]
        inputs += watch.get_registered_input_keys()
        outputs += watch.get_registered_output_keys()
        super().__init__(
            list(dict.fromkeys([*run.get_registered_outcomes(), *renamed])),
            PREEMPTED,
            list(dict.fromkeys(inputs)),
            list(dict.fromkeys(outputs)),
            outcome_cb=self._which,
            child_termination_cb=lambda ended: True,
        )
        self.reason = ""
        self.register_termination_cb(self._take_reason)
        with self:
            Concurrence.add("RUN", run, names)
            Concurrence.add("WATCH", watch)

    def _which(self, ended: Dict[str, str]) -> str:
        if ended["RUN"] != PREEMPTED:
            return ended["RUN"]
        return self._seen if ended["WATCH"] == SUCCEEDED else ended["WATCH"]

    def _take_reason(self, userdata: Any, terminal_states: Sequence[str], outcome: str) -> None:
        both = [self.get_children()[label] for label in ("RUN", "WATCH")]
        gives_up_with(self, both)
        reasons = [getattr(state, "reason", "") for state in both]
        self.reason = next((text for text in reasons if text and not only_cancelled(text)), "")
