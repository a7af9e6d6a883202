"""The home's actions for several robots (pddl/home/robots.pddl): those of one, for robot ?r."""

from merlin_actions.actions import navigate
from merlin_home.actions import ask


class Navigate(navigate.Navigate):
    """The drive; a robot that is stopped keeps no place."""

    parameters = ["r", "from", "to"]
    if_interrupted = ["(robot_at ?r anywhere)", "(free ?to)"]


class Ask(ask.Ask):
    """See there."""

    parameters = ["r", "p"]
