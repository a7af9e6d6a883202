"""The home's actions for several robots (pddl/home/robots.pddl): with the robot ?r as first parameter."""

from merlin_actions.actions import navigate
from merlin_home.actions import ask


class Navigate(navigate.Navigate):
    """Drives. A robot that is stopped occupies no place."""

    parameters = ["r", "from", "to"]
    if_interrupted = ["(robot_at ?r anywhere)", "(free ?to)"]


class Ask(ask.Ask):
    """Asks at a point of interest whether a service is needed."""

    parameters = ["r", "p"]
