# SPDX-License-Identifier: Apache-2.0
"""The action (ask ?p): ask whether a service is needed."""

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_home.question import QUESTION


class Ask(MerlinActionSM):
    """Asks the person at a point of interest, out loud."""

    parameters = ["p"]

    def build(self) -> None:
        """One state: the question."""
        self.add("SPEAK", self.state("speak", text=QUESTION))
