# SPDX-License-Identifier: Apache-2.0
"""The action (drive ?from ?to), or (drive ?r ?from ?to) of several robots: navigate by another name."""

from merlin_actions.actions.navigate import Navigate


class Drive(Navigate):
    """Drives to a point of interest through the robot's own move_base. Stopped on the way, it is anywhere."""
