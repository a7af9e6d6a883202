# SPDX-License-Identifier: Apache-2.0
"""The mission of the guide."""

from merlin_executor.mission import GoalDispatcher


class Guide(GoalDispatcher):
    """Shows all pictures."""

    servers = ("move_base", "sound_play")

    def run(self):
        """Shows one, then those that there are."""
        self.achieve("(shown sunset)")
        for picture in self.objects("picture"):
            self.achieve(f"(shown {picture})")
