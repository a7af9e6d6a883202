# SPDX-License-Identifier: Apache-2.0
"""The action (navigate ?r ?from ?to) of several robots, each of which has its place to itself."""

from merlin_actions.actions import navigate


class Navigate(navigate.Navigate):
    """Drives. A robot that is stopped occupies no place."""

    if_interrupted = ["(robot_at anywhere)", "(free ?to)"]
