# SPDX-License-Identifier: Apache-2.0
"""The action (navigate ?r ?from ?to) of several robots, each of which has its place to itself."""

from merlin_actions.actions import navigate

#: The robot stands beside the point: it has to drive the rest before another action.
STOPPED_AT = ["(not (robot_at anywhere))", "(robot_at ?here)", "(not (free ?here))"]


class Navigate(navigate.Navigate):
    """Drives. A robot that is stopped occupies only the place at which it stands."""

    if_interrupted = ["(robot_at anywhere)", "(free ?to)"]
    if_stopped_at = STOPPED_AT
