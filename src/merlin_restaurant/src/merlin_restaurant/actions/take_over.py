# SPDX-License-Identifier: Apache-2.0
"""The action (take_over ?r ?gone ?t): a robot serves a guest whose waiter has left."""

from merlin_actions.merlin_action_sm import MerlinActionSM


class TakeOver(MerlinActionSM):
    """Says, where the robot stands, that it takes over."""

    parameters = ["gone", "t"]
    robot_parameter = "r"

    def build(self) -> None:
        """One state: the sentence."""
        self.add("TELL", self.state("speak", "I take over {t} from {gone}.", keys=("t", "gone")))
