# SPDX-License-Identifier: Apache-2.0
"""An action server of any type that behaves as its parameters say.

``~hold`` (std_srvs/SetBool): whether the next goal lasts until it is cancelled. One that is held now ends.
"""

import os
import threading
from typing import Any, Callable, List, Mapping, Optional, Tuple

import rospy
from roslib.message import get_message_class
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from merlin_actions.testing.behaviour import Act, Behaviour
from merlin_actions.testing.result_script import ScriptedResults
from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_ros.node import run_node, spin
from merlin_ros.robot_values import of_robot, texts
from merlin_ros.ros_alarm import call_after

BUSY = "the robot does another action; cancel that first"


class SimulatedActionServer:
    """Serves an action; each goal's fate comes from a :class:`Behaviour`.

    :param name: of the action.
    :param action_spec: the generated ``...Action`` class.
    :param behaviour: of its goals.
    :param script: what it answers, see :class:`ScriptedResults`.
    :param on_goal: called with each goal's message before it begins.
    :param on_start: called when a goal begins.
    :param on_stop: called when it ends or is cancelled, at once, possibly twice.
    :param body: held while a goal runs: servers that share it refuse a goal while another one has it.
    """

    def __init__(
        self,
        name: str,
        action_spec: type,
        behaviour: Behaviour,
        on_start: Callable[[], None] = lambda: None,
        on_stop: Callable[[], None] = lambda: None,
        script: Optional[Mapping[str, Any]] = None,
        on_goal: Callable[[Any], None] = lambda goal: None,
        body: Optional[threading.Lock] = None,
    ) -> None:
        self._result_class = type(action_spec().action_result.result)
        self._on_goal = on_goal
        self.follow(behaviour, script)
        self._on_start = on_start
        self._on_stop = on_stop
        self._body = body or threading.Lock()
        self._over = threading.Event()
        self._hold = threading.Lock()  # guards the two fields below
        self._hold_next = False
        self.held = False
        """Whether the goal that runs lasts until it is cancelled or :meth:`hold` ends it."""
        self._server = SerialActionServer(name, action_spec, self._execute, self._cancel)

    def follow(self, behaviour: Behaviour, script: Optional[Mapping[str, Any]] = None) -> None:
        """Begins anew with a behaviour and a script, from the next goal on.

        :raises ValueError: when the script does not fit the action.
        """
        self._results = ScriptedResults(self._result_class, script or {})
        self._behaviour = behaviour
        self._succeeded = self.goals = 0

    def hold(self, held: bool) -> None:
        """Makes the next goal last until it is cancelled; False: none. Ends a goal that is held now.

        A test that acts on a goal while it runs needs that: any duration is too short on a busy machine.
        """
        with self._hold:
            self._hold_next = held
            if self.held:
                self._over.set()

    def start(self) -> None:
        """Begins to serve."""
        self._server.start()

    def shutdown(self) -> None:
        """Stops serving."""
        self._server.shutdown()

    def _cancel(self, goal: ServerGoal) -> None:
        self._on_stop()
        self._over.set()

    def _last(self, duration: float) -> None:
        if self.held:
            self._over.wait()
            return
        alarm = call_after(duration, self._over.set, "simulated goal")
        self._over.wait()
        alarm.shutdown()

    def _execute(self, goal: ServerGoal) -> None:
        if not self._body.acquire(blocking=False):
            goal.abort(text=BUSY)
            return
        try:
            act, cancelled = self._run(goal)
        finally:
            self._body.release()  # before the answer, after which the next goal comes
        if cancelled:
            goal.cancelled(text="stopped on request")
        elif act is Act.FAIL:
            goal.abort(text="failed as its parameters say")
        else:
            result = self._results.result(self._succeeded)
            self._succeeded += 1
            goal.succeed(result, text="done")

    def _run(self, goal: ServerGoal) -> Tuple[Act, bool]:
        """Runs a goal to its end: how it ends by itself, and whether it was cancelled."""
        self._on_goal(goal.goal)
        act, duration = self._behaviour.draw(self.goals)
        self.goals += 1
        with self._hold:
            self._over.clear()
            self.held, self._hold_next = self._hold_next, False
        if not goal.cancel_requested:
            self._on_start()
            self._last(duration)
        cancelled = goal.cancel_requested
        if act is Act.CRASH and not cancelled:
            os._exit(17)
        if act is Act.HANG:
            # Until the node ends: a hung server is one that does nothing any more.
            spin()
        self._on_stop()
        return act, cancelled


def behaviour_from_params(action: str = "") -> Behaviour:
    """A behaviour from the private parameters duration, spread, fail, hang, crash, seed.

    Robots with the same seed, each in its namespace, have streams of their own.

    :param action: of several that have a stream each.
    :raises ValueError: for values that make no sense.
    """
    values = {
        key: float(rospy.get_param(f"~{key}"))
        for key in ("duration", "spread", "fail", "hang", "crash")
        if rospy.has_param(f"~{key}")
    }
    seed, robot = int(rospy.get_param("~seed", 0)), rospy.get_namespace().strip("/")
    return Behaviour(seed="/".join(filter(None, (str(seed), robot, action))), **values)


def main() -> int:
    """Runs a node: `~action` (name) and `~type` (``move_base_msgs/MoveBase``), a behaviour and a script.

    Of several names of one type, a list, each is served, and one goal runs at a time.
    A script may be one for each of several robots; `~robot` is the name of its own, `~robots` has all names.
    """
    return run_node("simulated_action_server", _start, KeyError, ValueError)


def _start() -> None:
    given, type_name = rospy.get_param("~action"), rospy.get_param("~type")
    names, body = texts("~action", given) if isinstance(given, list) else [given], threading.Lock()
    if not type_name.endswith("Action"):
        type_name += "Action"
    action_spec: Optional[type] = get_message_class(type_name)
    if action_spec is None:
        raise ValueError(f"there is no message type {type_name!r}")
    robot, robots = rospy.get_param("~robot", ""), rospy.get_param("~robots", [])
    script = {
        key: of_robot(key, rospy.get_param(f"~{key}", None), robot, robots)
        for key in ("results", "answers", "sees")
    }
    servers: List[SimulatedActionServer] = []

    def hold(request: SetBoolRequest) -> SetBoolResponse:
        for server in servers:
            server.hold(request.data)
        return SetBoolResponse(success=True)

    for name in names:
        behaviour = behaviour_from_params(name if len(names) > 1 else "")
        server = SimulatedActionServer(name, action_spec, behaviour, script=script, body=body)
        rospy.on_shutdown(server.shutdown)
        servers.append(server)
        server.start()
    rospy.Service("~hold", SetBool, hold)
