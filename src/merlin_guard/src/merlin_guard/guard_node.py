# SPDX-License-Identifier: Apache-2.0
"""The node ``merlin_guard``: velocities pass to the base only while an owned motion goal is active."""

import math
import threading
import time
from typing import Any, Callable, Optional, Tuple

import rospy
from actionlib_msgs.msg import GoalID, GoalStatusArray
from geometry_msgs.msg import Twist
from merlin_msgs.msg import GuardStatus, Lease, SimStatus
from std_msgs.msg import Empty, String
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from merlin_guard.commands import Commands
from merlin_guard.goal_header import read_goal_header
from merlin_guard.guard_parameters import GuardParameters, read_parameters
from merlin_guard.motion_permit import GuardState, MotionPermit, PermitDecision, Send, View
from merlin_guard.motion_server import GoalReport
from merlin_guard.surroundings import Surroundings
from merlin_ros.actions.peers import connected_peers, sender_of
from merlin_ros.deadline import SIM_STATUS_TOPIC, SLOWEST, simulated
from merlin_ros.master.master_link import MasterSilent, get_param, set_param
from merlin_ros.node import run_node
from merlin_ros.parameters import ParameterError
from merlin_ros.processes.process_priority import raise_priority
from merlin_ros.publishing import OnSubscriber
from merlin_ros.work.passed_time import LAST
from merlin_ros.work.threads import CallQueue

NAME = "merlin_guard"
#: Nice value: about nine times the share of a process at 0, and a short way to the processor. What stops the
#: base must not queue behind what drives it.
PRIORITY = -10
TICK = 0.05  # s of wall time between two looks at the limits
STATUS_PERIOD = 0.5  # s of wall time between two statuses without a change
WARN_AFTER = 0.25  # s; an owner releases a goal some moments before the end of the goal is published
REMEMBER = 0.5  # s to wait for the master to keep a stop; one that hangs must not hold up its confirmation
STOPPED_PARAM, SINCE_PARAM = "~stopped", "~stopped_since"  # keep a stop over a restart of the node
LONGEST_TEXT = 100  # characters of the name of an operator, or of a reason


class GuardNode:
    """The guard of one base.

    :param parameters: of the node.
    :raises ParameterError: input and output are the same topic, or another guard has the output.
    """

    def __init__(self, parameters: GuardParameters) -> None:
        self._input = rospy.resolve_name("cmd_vel_in")
        self._output = rospy.resolve_name("cmd_vel")
        self._surroundings = Surroundings(self._input, self._output, parameters)
        self._surroundings.check_start()
        stopped = str(get_param(STOPPED_PARAM, ""))
        self._lock = threading.RLock()  # guards the fields below, and orders what is published
        self._log = CallQueue("guard log")  # a screen or disk that hangs keeps no velocity and no stop
        self._memory = threading.Lock()  # orders the writers of the parameter that keeps a stop
        self._permit = MotionPermit(parameters.servers, parameters.settings, stopped)
        self._commands = Commands(self._input, self._permit, parameters)
        self._state: Optional[GuardState] = None
        self._published: Optional[Tuple[View, str, Tuple[str, ...]]] = None
        self._keeping = 0  # stops that are being written; a published state outlives the guard
        since = get_param(SINCE_PARAM, 0.0) if stopped else 0.0
        known = isinstance(since, (int, float)) and 0.0 <= since <= LAST  # else it counts from now on
        self._since = rospy.Time.from_sec(since if known else 0.0)
        self._published_at = -math.inf
        self._born = rospy.Time.now()
        self._button_fault = ""
        self._closing = False
        self._over = threading.Event()
        # A base that connects may have kept the last velocity of a guard that died.
        stand = OnSubscriber(lambda publish: publish(Twist()))
        self._velocity = rospy.Publisher(
            "cmd_vel", Twist, subscriber_listener=stand, tcp_nodelay=True, queue_size=1
        )
        self._status = rospy.Publisher(
            "merlin/guard", GuardStatus, latch=True, tcp_nodelay=True, queue_size=10
        )
        self._cancels = {
            server: rospy.Publisher(f"{server}/cancel", GoalID, tcp_nodelay=True, queue_size=10)
            for server in parameters.servers
        }
        self._velocity.publish(Twist())
        self._apply(self._permit.tick(time.monotonic()))
        # A simulator that is not MERLIN's says nothing of its speed: its world is as fast as /clock.
        self._foreign = simulated()
        if self._foreign:
            self._permit.world_rate(SLOWEST, time.monotonic())
        rospy.on_shutdown(self._shutdown)
        self._services = [
            rospy.Service("merlin/stop", Trigger, self._serve_stop),
            rospy.Service("merlin/release", Trigger, self._serve_release),
            rospy.Service("merlin/halt", Trigger, self._serve_halt),
        ]
        self._subscribe(parameters)
        self._ticker = threading.Thread(target=self._tick, name="guard ticks", daemon=True)
        self._ticker.start()
        self._surroundings.start()
        unknown = parameters.unknown_of_base()
        if unknown:
            self._warn(unknown)
        if stopped:
            self._warn(f"{stopped}; it was so when the guard began. {_how_to_release()}")

    def _subscribe(self, parameters: GuardParameters) -> None:
        def listen(topic: str, message_class: Any, callback: Any, **options: Any) -> rospy.Subscriber:
            return rospy.Subscriber(topic, message_class, callback, tcp_nodelay=True, **options)

        # On a robot no node may slow the guard's time by a word of a simulator.
        self._simulator = (
            listen(SIM_STATUS_TOPIC, SimStatus, self._receive_simulation) if simulated() else None
        )
        self._subscribers = [
            listen("merlin/stop", Empty, lambda _: self._stop("stopped on the topic merlin/stop")),
            listen(
                "merlin/stop_by",
                String,
                lambda name: self._stop(f"stopped by {_line(name.data, 'an operator')}"),
            ),
            listen("merlin/brake", String, lambda reason: self._brake(_line(reason.data, "braked"))),
        ]
        self._leases = {
            server: listen(f"{server}/lease", Lease, self._receive_lease, callback_args=server)
            for server in parameters.servers
        }
        for server in parameters.servers:
            for suffix, message_class, callback in (
                ("cancel", GoalID, self._receive_cancel),
                ("goal", rospy.AnyMsg, self._receive_goal),
                ("status", GoalStatusArray, self._receive_status),
            ):
                self._subscribers.append(
                    listen(f"{server}/{suffix}", message_class, callback, callback_args=server)
                )
        if parameters.stop_button >= 0:
            self._subscribers.append(_stop_button(parameters.stop_button, self._stop, self._note_button))
        # Last, so that what permits a motion is known before the motion.
        self._subscribers.append(listen("cmd_vel_in", Twist, self._receive_velocity, queue_size=1))

    def _receive_velocity(self, velocity: Twist) -> None:
        with self._lock:
            self._apply(*self._commands.receive(velocity, time.monotonic()))

    def _receive_status(self, message: GoalStatusArray, server: str) -> None:
        with self._lock:
            self._look_at_clock()
            born = self._born
            reports = [
                GoalReport(
                    entry.goal_id.id,
                    entry.status,
                    entry.goal_id.stamp.to_nsec(),
                    # Goals that are older than the first tick of a clock are older than the guard.
                    not entry.goal_id.stamp.is_zero() and (born.is_zero() or entry.goal_id.stamp < born),
                )
                for entry in message.status_list
            ]
            self._apply(self._permit.status(server, reports, time.monotonic()))
        self._surroundings.heard(server)

    def _look_at_clock(self) -> None:
        """Notes what ROS time is: it may have begun, or been set back; called with the lock held."""
        now = rospy.Time.now()
        if self._born.is_zero() or now < self._born:
            self._born = now
        self._permit.ros_time(now.to_nsec(), time.monotonic())

    def _receive_goal(self, message: rospy.AnyMsg, server: str) -> None:
        try:
            identity, stamp = read_goal_header(message._buff)
        except ValueError as error:
            rospy.logerr_throttle(10.0, f"{server}/goal: {error}")
            return
        with self._lock:
            self._look_at_clock()
            self._apply(self._permit.goal_sent(server, identity, stamp, time.monotonic()))

    def _receive_cancel(self, message: GoalID, server: str) -> None:
        with self._lock:
            self._look_at_clock()
            self._apply(self._permit.cancel(server, message.id, message.stamp.to_nsec(), time.monotonic()))

    def _receive_lease(self, lease: Lease, server: str) -> None:
        with self._lock:
            now = time.monotonic()
            self._apply(self._permit.lease(server, lease.owner, lease.life, lease.held, lease.suspended, now))

    def _receive_simulation(self, status: SimStatus) -> None:
        rate = 0.0 if status.paused else max(SLOWEST, status.achieved_factor or 1.0)
        with self._lock:
            self._foreign = False
            self._apply(self._permit.world_rate(rate, time.monotonic()))

    def _stop(self, reason: str) -> None:
        with self._lock:
            fresh = self._permit.view.state is not GuardState.STOPPED
            self._keeping += fresh
            self._apply(self._permit.stop(reason, time.monotonic()))
        if fresh:
            self._warn(f"{reason}. {_how_to_release()}")
            self._remember_stop()
            with self._lock:
                self._keeping -= 1
                if not self._closing:
                    self._publish_status(self._permit.view)

    def _brake(self, reason: str) -> None:
        with self._lock:
            self._apply(self._permit.brake(reason, time.monotonic()))

    def _serve_stop(self, request: TriggerRequest) -> TriggerResponse:
        self._stop(f"stopped by {_caller(request)}")
        return TriggerResponse(True, f"stopped until {rospy.resolve_name('merlin/release')} is called")

    def _serve_release(self, request: TriggerRequest) -> TriggerResponse:
        with self._lock:
            stopped = self._permit.view.state is GuardState.STOPPED
            self._apply(self._permit.release(time.monotonic()))
        if not stopped:
            return TriggerResponse(True, "it was not stopped")
        self._remember_stop()
        self._log.put(rospy.loginfo, f"{rospy.get_name()}: released by {_caller(request)}")
        return TriggerResponse(True, "released")

    def _serve_halt(self, request: TriggerRequest) -> TriggerResponse:
        with self._lock:
            goals = self._permit.view.goals
            self._apply(self._permit.halt(f"halted by {_caller(request)}", time.monotonic()))
        return TriggerResponse(True, f"halted; active goals: {', '.join(goals) or 'none'}")

    def _remember_stop(self) -> None:
        """Stores whether the base is stopped, for a restarted guard."""
        keeper = threading.Thread(target=self._write_stop, name="guard memory", daemon=True)
        keeper.start()
        keeper.join(REMEMBER)

    def _write_stop(self) -> None:
        with self._memory:
            with self._lock:
                view, since = self._permit.view, self._since  # now, so that of two writers the later is right
            try:
                set_param(SINCE_PARAM, since.to_sec())
                set_param(STOPPED_PARAM, view.reason if view.state is GuardState.STOPPED else "")
            except MasterSilent as error:
                rospy.logerr(f"{rospy.get_name()}: the master does not keep the stop for a restart: {error}")

    def _apply(self, decision: PermitDecision, velocity: Optional[Twist] = None) -> None:
        """Carries out a decision; called with the lock held."""
        if self._closing:
            return
        if decision.send is Send.ZERO:
            self._commands.stood()
            self._velocity.publish(Twist())
        elif decision.send is Send.COMMAND:
            self._velocity.publish(velocity)
        for cancel in decision.cancels:
            self._cancels[cancel.server].publish(GoalID(id=cancel.goal_id))
            if cancel.first:
                self._warn(f"cancels {cancel.goal_id} of {cancel.server}: {cancel.reason}")
        self._publish_status(self._permit.view)

    def _publish_status(self, view: View) -> None:
        """Publishes the state when it changed or is due; called with the lock held."""
        stamp = rospy.Time.now()
        if self._since.is_zero() or (self._state is not None and view.state is not self._state):
            self._since = stamp
        self._state = view.state
        now = time.monotonic()
        warning = self._warning()
        said = view, warning, self._commands.watch.uncommanded
        if self._keeping or (said == self._published and now - self._published_at < STATUS_PERIOD):
            return
        self._published, self._published_at = said, now
        status = GuardStatus(
            state=int(view.state),
            reason=view.reason,
            since=self._since,
            moving=view.moving,
            goals=list(view.goals),
            cancelled=list(view.cancelled),
            servers=list(self._cancels),
            heard=list(view.heard),
            limited=self._commands.watch.faults,
            warning=warning,
            uncommanded=list(self._commands.watch.uncommanded),
        )
        status.header.stamp = stamp
        self._status.publish(status)

    def _tick(self) -> None:
        before, logged, since = "", "", time.monotonic()
        while not self._over.wait(TICK):
            with self._lock:
                clients = {server: connected_peers(topic) for server, topic in self._leases.items()}
                simulator = self._foreign or bool(self._simulator and connected_peers(self._simulator))
                self._look_at_clock()
                decision = self._permit.tick(time.monotonic(), clients, simulator)
                self._commands.look()
                self._apply(decision)
                view, warning = self._permit.view, self._warning()
            reason = view.reason if view.state is GuardState.HOLDING else warning
            if reason != before:
                before, since = reason, time.monotonic()
            elif reason != logged and time.monotonic() - since >= WARN_AFTER:
                logged = reason
                if reason:
                    self._warn(reason)

    def _warn(self, text: str) -> None:
        self._log.put(rospy.logwarn, f"{rospy.get_name()}: {text}")

    def _warning(self) -> str:
        """What is wrong, though the base may move; called with the lock held."""
        return "; ".join(filter(None, (self._button_fault, self._commands.warning)))

    def _note_button(self, fault: str) -> None:
        if fault:
            rospy.logerr_throttle(10.0, f"{rospy.get_name()}: {fault}")
        with self._lock:
            self._button_fault = fault  # the next tick publishes it

    def _shutdown(self) -> None:
        self._over.set()
        with self._lock:
            self._closing = True
            self._velocity.publish(Twist())  # a node that ends waits until it is read


def _stop_button(index: int, stop: Callable[[str], None], note: Callable[[str], None]) -> rospy.Subscriber:
    """Stops the base by a button of `joy`.

    :param note: called with what is wrong with the last message; empty: nothing.
    :raises ParameterError: the package sensor_msgs is missing.
    """
    try:
        from sensor_msgs.msg import Joy
    except ImportError as error:
        raise ParameterError(f"parameter ~stop_button needs the package sensor_msgs: {error}") from error

    def receive(joy: Joy) -> None:
        name, number = rospy.resolve_name("joy"), len(joy.buttons)
        missing = index >= number
        note(f"{name} has {number} buttons: it has no button {index}, the ~stop_button" if missing else "")
        if not missing and joy.buttons[index]:
            stop(f"stopped by button {index} of {name}")

    return rospy.Subscriber("joy", Joy, receive, tcp_nodelay=True, queue_size=10)


def _line(text: str, default: str) -> str:
    """A name or a reason as one line of a status shows it."""
    return "".join(letter if letter.isprintable() else " " for letter in text[:LONGEST_TEXT]) or default


def _caller(request: TriggerRequest) -> str:
    return sender_of(request) or "an unknown node"


def _how_to_release() -> str:
    return f"Call {rospy.resolve_name('merlin/release')} to let it drive again."


def _start() -> None:
    GuardNode(read_parameters())


def main() -> int:
    """The executable ``guard``; returns its exit code."""
    raise_priority(PRIORITY)
    return run_node(NAME, _start, ParameterError)
