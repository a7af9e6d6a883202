"""Other nodes that own a dispatch, by the leases they renew. Not thread-safe."""

from merlin_msgs.msg import Lease

from merlin_ros.actions.hang_watch import SETTLE, hangs
from merlin_ros.actions.lease import LOSE_AFTER
from merlin_ros.deadline import running_time
from merlin_ros.work.liveness import Limits, Liveness, Presence


class DispatchOwners:
    """The owners of one dispatcher's plans.

    :param node: of this process, whose own leases do not count.
    """

    def __init__(self, node: str) -> None:
        self._node = node
        self._looked = running_time()
        self._owners: Liveness[str] = Liveness(Limits(gone=LOSE_AFTER, settle=SETTLE))

    def heard(self, lease: Lease) -> None:
        """A lease of the dispatcher was renewed or released."""
        if lease.owner == self._node:
            return
        self._look()
        self._owners.heard(lease.owner)
        if not lease.held:
            self._owners.left(lease.owner)

    @property
    def living(self) -> str:
        """One that lives; empty when none does."""
        self._look()
        return next((each for each in self._owners if self._owners.presence(each) is Presence.ALIVE), "")

    def _look(self) -> None:
        now = running_time()
        passed, self._looked = now - self._looked, now
        self._owners.pass_time(passed, stalled=hangs.unsettled() > 0.0)
