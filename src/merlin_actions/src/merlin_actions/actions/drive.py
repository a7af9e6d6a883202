"""The action (drive ?r ?from ?to): one of several robots drives from one place to another."""

from merlin_actions.merlin_action_sm import MerlinActionSM


class Drive(MerlinActionSM):
    """Drives to a point of interest through the robot's own move_base. Stopped on the way, it is anywhere."""

    parameters = ["r", "from", "to"]
    if_interrupted = ["(robot_at ?r anywhere)"]

    def build(self) -> None:
        """One state: the drive."""
        self.add("DRIVE", self.state("navigation"), remapping={"target": "to"})
