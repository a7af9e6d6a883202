# SPDX-License-Identifier: Apache-2.0
"""The Executor's view of the velocity guards: whether bases stand, or are held; braking and halting them."""

import threading
import time
from typing import Callable, Dict, List, Set

import rospy
from merlin_msgs.msg import GuardStatus, RobotHost
from std_msgs.msg import String
from std_srvs.srv import Trigger

from merlin_executor.core.base_hold import hold_words
from merlin_executor.core.standstill import STAND_WAIT, Halt, together
from merlin_planning.robot_roster import KEEP, RobotRoster, is_node
from merlin_ros.actions.hang_watch import hangs
from merlin_ros.actions.peers import sender_of
from merlin_ros.deadline import Deadline
from merlin_ros.publishing import publish
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_ros.work.threads import start_thread

HALT_LIMIT = 1.0  # s of wall time for the guard to answer
#: s of wall time for which the word of another robot's guard counts, and a guard that hangs is awaited; it
#: sends one every 0.5 s.
FRESH = 1.5
#: s of running time for a motion goal whose state machine died to be cancelled: by its guard (0.9 s), or by
#: the next process of the machine.
GOAL_WAIT = 1.5
BRAKE_WAIT = 0.02  # s of wall time for several guards to say that their bases are braked


class GuardClient:
    """Follows ``merlin/guard``, where there is a guard, and has it hold the base; of each robot of the plan.

    :param knowledge_base: global name of the knowledge base, below which robots announce themselves.
    :param stand_wait: s of running time for the bases to come to rest.
    :param brakes: whether :meth:`brake` holds the bases; not, where a cancelled action runs to its end.
    """

    def __init__(self, knowledge_base: str, stand_wait: float = STAND_WAIT, brakes: bool = True) -> None:
        self._stand_wait = stand_wait
        self._brakes = brakes
        self._roster = RobotRoster()  # of namespaces: a guard is that of a base
        self._changed = threading.Condition()  # guards the fields below, and what the guards say
        self._guards: Dict[str, _Guard] = {}
        self._coming: Set[str] = set()  # namespaces whose guard is being made
        self.hold = ""
        """Who holds which bases until a release, as a sentence; empty: no base is held."""
        self._on_hold: Callable[[], None] = lambda: None
        self._add("")
        self._robots = rospy.Subscriber(f"{knowledge_base}/robots", RobotHost, self._meet, tcp_nodelay=True)

    def wait_standing(self) -> bool:
        """Waits until each guard reports that its base stands and that the goals which it held have ended.

        :return: False when one still moves; True also without a guard.
        """
        with self._changed:
            stands = self._wait_none(_Guard.moves)
            if stands:
                Deadline(GOAL_WAIT).wait(
                    self._changed, lambda: not any(guard.holds_goals() for guard in self._guards.values())
                )
            return stands

    def wait_left(self) -> bool:
        """Waits until no base moves for a goal that was cancelled; it may move for others.

        :return: False when one still does; True also without a guard.
        """
        with self._changed:
            return self._wait_none(_Guard.moves_on)

    def _wait_none(self, moves: Callable[["_Guard"], bool]) -> bool:
        """Waits, with the lock held, until no guard says so any more.

        The last word of a guard that hangs for a moment, as its whole computer may, is not the present.
        """

        def moving() -> List[_Guard]:
            return [guard for guard in self._guards.values() if moves(guard)]

        asked = time.monotonic()
        if Deadline(self._stand_wait).wait(self._changed, lambda: not moving()):
            return True
        late = [guard for guard in moving() if guard.heard < asked]
        if not late or not Deadline(FRESH).wait(
            self._changed, lambda: all(guard.heard >= asked for guard in late)
        ):
            return False
        return Deadline(self._stand_wait).wait(self._changed, lambda: not moving())

    def brake(self, reason: str) -> None:
        """Asks the guards to hold their bases until a cancel has reached the motion goals.

        With one guard it never blocks. Several guards share the processors with the work of the cancel: they
        come first, for at most ``BRAKE_WAIT``.
        """
        moving = [guard for guard in self._all() if guard.moves()] if self._brakes else []
        for guard in self._all() if self._brakes else ():
            guard.brake(reason)
        if len(moving) > 1:
            with self._changed:
                self._changed.wait_for(lambda: not any(guard.moves() for guard in moving), BRAKE_WAIT)

    def halt(self) -> Halt:
        """Asks the guards to hold their bases, and to cancel all present motion goals.

        All at once: the base of another robot does not move on while one guard hangs.
        """
        guards = self._all()
        halts = [Halt(True)] * len(guards)

        def ask(number: int) -> None:
            halts[number] = guards[number].halt()

        threads = []
        for number in range(1, len(guards)):
            try:
                threads.append(start_thread("halt of a guard", ask, number))
            except RuntimeError:  # no further thread
                ask(number)
        ask(0)
        for thread in threads:
            thread.join()
        return together(halts)

    def follow(self, on_hold: Callable[[], None]) -> None:
        """Calls a function from now on when :attr:`hold` has changed, without a lock."""
        self._on_hold = on_hold
        on_hold()

    def wait_released(self, stopped: Callable[[], bool]) -> None:
        """Waits until no base is held.

        :param stopped: ends the wait; call :meth:`wake` when it becomes true.
        """
        with self._changed:
            if self.hold and not stopped():
                rospy.logwarn(f"{self.hold}; the next plan waits for the release")
            Deadline(None).wait(self._changed, lambda: not self.hold or stopped())

    def wake(self) -> None:
        """Wakes those that wait, so that they look again whether they are stopped."""
        with self._changed:
            self._changed.notify_all()

    def _look(self) -> None:
        """Notices that a hold has begun or ended: a guard has said something, or a robot is gone."""
        with self._changed:
            hold = " and ".join(filter(None, (guard.hold() for guard in self._guards.values())))
            self._changed.notify_all()
            if hold == self.hold:
                return
            self.hold = hold
        self._on_hold()

    def _all(self) -> List["_Guard"]:
        with self._changed:
            return list(self._guards.values())

    def _meet(self, word: RobotHost) -> None:
        if not is_node(word.node):
            return
        self._look()  # what the guard of a robot that is gone said last counts no longer
        namespace = word.node.rpartition("/")[0] + "/"
        admission = self._roster.admit(namespace, sender_of(word), time.monotonic())
        if admission.refusal:
            rospy.logwarn(admission.refusal)
        if admission.forgotten:
            self._remove(admission.forgotten)
        with self._changed:
            if admission.counts and namespace in self._guards:
                self._guards[namespace].met = time.monotonic()
            if not admission.counts or namespace in self._guards or namespace in self._coming:
                return
            self._coming.add(namespace)
        try:
            self._add(namespace)
        finally:
            with self._changed:
                self._coming.discard(namespace)

    def _add(self, namespace: str) -> None:
        # Without the lock: it registers at the master, which may hang.
        guard = _Guard(namespace, self._changed, self._look)
        with self._changed:
            self._guards[namespace] = guard
        self._look()

    def _remove(self, namespace: str) -> None:
        with self._changed:
            guard = self._guards.pop(namespace, None)
        if guard is not None:
            guard.shutdown()
            self._look()


class _Guard:
    """The guard of one base.

    :param namespace: of its robot, with a slash at the end; empty: that of this node.
    :param changed: owns what it says.
    :param heard: called when it has said something.
    :ivar heard: when it has said something last, s on the monotonic clock; 0.0: it never has.
    :ivar met: likewise the host of its robot.
    """

    def __init__(self, namespace: str, changed: threading.Condition, heard: Callable[[], None]) -> None:
        self._robot = namespace.strip("/")
        self._changed = changed
        self._tell = heard
        self._status = GuardStatus()
        self.heard = self.met = 0.0
        self._braked: Set[str] = set()  # ids of the goals that ran at the last brake
        self._brake = rospy.Publisher(f"{namespace}merlin/brake", String, tcp_nodelay=True, queue_size=1)
        self._halt = ServiceProxy(f"{namespace}merlin/halt", Trigger, timeout=HALT_LIMIT)
        self._subscriber = rospy.Subscriber(
            f"{namespace}merlin/guard", GuardStatus, self._receive, tcp_nodelay=True
        )

    def moves(self) -> bool:
        """Whether the base moves. The last status of a robot that is gone counts for a limited time.

        That of a guard that hangs counts as long as its robot is there.
        """
        return bool(self._status.moving) and not self._gone(FRESH)

    def moves_on(self) -> bool:
        """Whether the base moves while a goal that was cancelled has not ended."""
        return self.moves() and bool(self._status.cancelled)

    def hold(self) -> str:
        """Who holds the base, as a sentence; empty: it is free, or the robot is gone."""
        if self._status.state != GuardStatus.STOPPED or self._gone(KEEP):
            return ""
        return hold_words(self._robot, self._status.reason, self._status.since.to_sec())

    def holds_goals(self) -> bool:
        """Whether goals that ran at the last brake still run and may not move the base."""
        silent = hangs.silent(time.monotonic() - self.heard, FRESH)
        holds = self._status.state == GuardStatus.HOLDING and not silent
        return holds and not self._braked.isdisjoint(self._status.goals)

    def _gone(self, limit: float) -> bool:
        """Whether another robot has been silent for so long, with its guard."""
        last = max(self.heard, self.met)
        return bool(self._robot) and hangs.silent(time.monotonic() - last, limit)

    def brake(self, reason: str) -> None:
        """Asks the guard to hold its base for now."""
        with self._changed:
            self._braked = set(self._status.goals)
        publish(self._brake, String(reason))

    def halt(self) -> Halt:
        """Asks the guard to hold its base, and to cancel its motion goals."""
        if not self._halt.available():
            known = self.heard > 0.0
            return Halt(known, message="its node does not run" if known else "")
        try:
            answer = self._halt()
        except ServiceError as error:
            return Halt(True, message=str(error))
        return Halt(True, bool(answer.success), str(answer.message))

    def shutdown(self) -> None:
        """Ends its topics."""
        self._brake.unregister()
        self._subscriber.unregister()
        self._halt.close()

    def _receive(self, status: GuardStatus) -> None:
        with self._changed:
            self._status, self.heard = status, time.monotonic()
        self._tell()
