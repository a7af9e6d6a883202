"""The Executor's view of the velocity guard: whether the base stands, and halting it."""

import threading
from typing import Optional

import rospy
from merlin_msgs.msg import GuardStatus
from std_srvs.srv import Trigger

from merlin_executor.core.standstill import Halt
from merlin_ros.deadline import Deadline
from merlin_ros.service_proxy import ServiceError, ServiceProxy

HALT_LIMIT = 1.0  # s of wall time for the guard to answer


class GuardClient:
    """Follows ``merlin/guard`` and calls ``merlin/halt``, where there is a guard."""

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards the field below
        self._status: Optional[GuardStatus] = None
        self._halt = ServiceProxy("merlin/halt", Trigger, timeout=HALT_LIMIT)
        self._subscriber = rospy.Subscriber("merlin/guard", GuardStatus, self._receive, tcp_nodelay=True)

    def wait_standing(self, timeout: float) -> bool:
        """Waits until the base stands, as far as a guard says.

        :param timeout: s of running time.
        :return: False when it still moves; True also without a guard.
        """
        with self._changed:
            return Deadline(timeout).wait(self._changed, lambda: not self._moves())

    def halt(self) -> Halt:
        """Has the guard hold the base until the motion goals of this moment have ended."""
        if not self._halt.available():
            with self._changed:
                known = self._status is not None
            return Halt(known, message="its node does not run" if known else "")
        try:
            answer = self._halt()
        except ServiceError as error:
            return Halt(True, message=str(error))
        return Halt(True, bool(answer.success), str(answer.message))

    def _moves(self) -> bool:
        return self._status is not None and bool(self._status.moving)

    def _receive(self, status: GuardStatus) -> None:
        with self._changed:
            self._status = status
            self._changed.notify_all()
