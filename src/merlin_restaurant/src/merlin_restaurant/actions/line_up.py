# SPDX-License-Identifier: Apache-2.0
"""The action (line_up ?r ?p): the rest of a drive that was stopped beside its end."""

from merlin_actions.merlin_action_sm import MerlinActionSM


class LineUp(MerlinActionSM):
    """Drives to the place beside which the robot stands."""

    parameters = ["p"]

    def build(self) -> None:
        """One state: the drive."""
        self.add("DRIVE", self.state("navigation"), remapping={"target": "p"})
