# SPDX-License-Identifier: Apache-2.0
"""The action (navigate ?from ?to): drive from one place to another."""

from merlin_actions.merlin_action_sm import MerlinActionSM


class Navigate(MerlinActionSM):
    """Drives to a point of interest through move_base. Stopped on the way, the robot is anywhere."""

    parameters = ["from", "to"]
    if_interrupted = ["(robot_at anywhere)"]

    def build(self) -> None:
        """One state: the drive."""
        self.add("DRIVE", self.state("navigation"), remapping={"target": "to"})
