# SPDX-License-Identifier: Apache-2.0
"""What a foreign node does to the robot: clocks, stamps and messages that are not its own."""

import threading
import time
from typing import List

import rospy
from actionlib_msgs.msg import GoalID
from merlin_msgs.msg import SimStatus
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

from chaos.under_test.child import Reporter

#: s by which a second clock is late, and how many messages it sends.
OLD_CLOCK = (5.0, 10)
#: s of wall time for which the second clock is there.
CLOCK_LASTS = 1.0
#: s between two forged messages: more often than the simulator says the truth.
FORGE_PERIOD = 0.05
#: s until what is published has its subscribers, and for which it is there.
CONNECTED = 5.0


class Stranger:
    """Commands of a node that is not the robot's; each runs in a thread of its own.

    :param report: takes what was done.
    """

    def __init__(self, report: Reporter) -> None:
        self._report = report
        self._true_again = threading.Event()

    def _clock_back(self) -> None:
        answer = rospy.ServiceProxy("merlin_sim/clock_back", Trigger)()
        self._report("clock_back" if answer.success else "failed", do="clock_back", error=answer.message)

    def _second_clock(self) -> None:
        # Made only now: the simulator refuses to start beside another clock.
        clock = rospy.Publisher("/clock", Clock, queue_size=20, latch=True)
        back, messages = OLD_CLOCK
        past = rospy.Time.from_sec(max(1.0, rospy.get_time() - back))
        for number in range(messages):
            clock.publish(Clock(past + rospy.Duration(0.02 * number)))
        time.sleep(CLOCK_LASTS)  # subscribers connect, and get the last one at least
        clock.unregister()
        self._report("second_clock", seconds=back)

    def _forge(self) -> None:
        """Says that the simulator is paused, until :meth:`_forge_no_more`."""
        self._true_again.clear()
        status = rospy.Publisher("/merlin_sim/status", SimStatus, queue_size=20, latch=True)
        status.publish(SimStatus(paused=True))
        time.sleep(CLOCK_LASTS)  # subscribers connect, if there are any
        self._report("forged", subscribers=status.get_num_connections())
        while not self._true_again.wait(FORGE_PERIOD):
            status.publish(SimStatus(paused=True))
        status.unregister()

    def _forge_no_more(self) -> None:
        self._true_again.set()

    def _cancel_ahead(self, action: str, ahead: float) -> None:
        """Cancels all goals of an action up to a time that is s ahead."""
        cancels = rospy.Publisher(f"{action}/cancel", GoalID, queue_size=1, latch=True)
        cancels.publish(GoalID(stamp=rospy.Time.now() + rospy.Duration(ahead)))
        time.sleep(CLOCK_LASTS)
        self._report("cancelled_ahead", action=action, subscribers=_connections(cancels))
        cancels.unregister()

    def _mute(self, topic: str, muted: bool) -> None:
        rospy.wait_for_service(f"merlin_sim/mute/{topic}", CONNECTED)
        rospy.ServiceProxy(f"merlin_sim/mute/{topic}", SetBool)(muted)
        self._report("muted", topic=topic, muted=muted)


def _connections(publisher: rospy.Publisher) -> List[str]:
    return sorted(str(each.endpoint_id) for each in publisher.impl.connections)
