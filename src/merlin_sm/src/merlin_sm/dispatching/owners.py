"""Other nodes that own a dispatch, by the leases they renew. Not thread-safe."""

from typing import Dict

from merlin_msgs.msg import Lease

from merlin_ros.actions.hang_watch import hangs
from merlin_ros.actions.lease import LOSE_AFTER
from merlin_ros.deadline import running_time


class DispatchOwners:
    """The owners of one dispatcher's plans.

    :param node: of this process, whose own leases do not count.
    """

    def __init__(self, node: str) -> None:
        self._node = node
        self._renewed: Dict[str, float] = {}  # owner -> running time of its last renewal

    def heard(self, lease: Lease) -> None:
        """A lease of the dispatcher was renewed or released."""
        if lease.owner == self._node:
            return
        now = running_time()
        self._renewed = {
            owner: last for owner, last in self._renewed.items() if not hangs.silent(now - last, LOSE_AFTER)
        }
        if lease.held:
            self._renewed[lease.owner] = now
        else:
            self._renewed.pop(lease.owner, None)

    @property
    def living(self) -> str:
        """One that lives; empty when none does."""
        now = running_time()
        living = (owner for owner, last in self._renewed.items() if not hangs.silent(now - last, LOSE_AFTER))
        return next(living, "")
