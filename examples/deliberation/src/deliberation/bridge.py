# SPDX-License-Identifier: Apache-2.0
"""The bridge: runs pyrobosim without a window, and serves what its robot does as a robot's action servers.

Beside them it keeps what the robot senses in the knowledge base, and says on a topic what is true.
"""

import functools
import json
import math
import threading
from pathlib import Path
from typing import Any, FrozenSet, List, Optional

import rospy
from merlin_msgs.msg import ManipulateAction, RecognizeAction, RecognizeResult
from move_base_msgs.msg import MoveBaseAction
from rosplan_knowledge_msgs.srv import SetNamedBool
from std_msgs.msg import String
from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose

from deliberation.belief import SENSED, Belief, Fact, Values, fixed_facts, fixed_values, objects
from deliberation.house import House, as_data
from deliberation.shown import Shown
from deliberation.simulation import Simulation
from deliberation.world_file import WorldError
from merlin_planning.knowledge_client import (
    ADD,
    REMOVE,
    KnowledgeClient,
    KnowledgeError,
    Update,
    fact,
    function_value,
    instance,
    knowledge_client,
    wait_for_knowledge_base,
)
from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_ros.master.master_link import set_param
from merlin_ros.node import run_node
from merlin_ros.parameters import flag, number, whole
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_ros.work.threads import start_thread
from merlin_sm.states.navigation import POINTS_PARAM

KNOWLEDGE_WAIT = 60.0  # s of wall time
STOP_PERIOD = 0.05  # s of wall time
NEAR = 0.01  # m between a goal of move_base and the site that it means
#: Action of pyrobosim → the server by which it is reached, and its type.
SERVERS = {
    "navigate": ("move_base", MoveBaseAction),
    "detect": ("recognize", RecognizeAction),
    **{each: (each, ManipulateAction) for each in ("pick", "place", "open", "close")},
}


class Senses:
    """Keeps what is sensed in the knowledge base.

    :param belief: what is known of things.
    :param simulation: whose state is sensed.
    :param knowledge: where it is kept.
    """

    def __init__(self, belief: Belief, simulation: Simulation, knowledge: KnowledgeClient) -> None:
        self._belief, self._simulation, self._knowledge = belief, simulation, knowledge
        self._facts: Optional[FrozenSet[Fact]] = None  # in the knowledge base; None: not known
        self._values: Values = {}

    def begin(self) -> None:
        """Writes the house, and tells the knowledge base what is sensed.

        :raises KnowledgeError: when it refuses that, or a :class:`ServiceError` when it does not answer.
        """
        house = self._simulation.house
        things = self._simulation.state().things
        named = [
            Update(ADD, instance(kind, name))
            for kind, names in objects(house, things).items()
            for name in names
        ]
        self._knowledge.update(named)
        self._knowledge.update([Update(ADD, fact(*each)) for each in fixed_facts(house)])
        values = fixed_values(house).items()
        self._knowledge.update([Update(ADD, function_value(key[0], key[1:], value)) for key, value in values])
        mark = ServiceProxy(f"{self._knowledge.name}/update_sensed_predicates", SetNamedBool, timeout=10.0)
        for name in SENSED:
            mark(name, True)
        mark.close()
        self._knowledge.update([Update(REMOVE, fact(*each)) for each in (("robot_at", ""),)])
        self.sense()

    def sense(self) -> None:
        """Writes what has changed, in one transaction.

        :raises KnowledgeError: when it is refused, or a :class:`ServiceError` when there is no answer.
        """
        state = self._simulation.state()
        facts, values = self._belief.facts(state), self._belief.values(state)
        known = self._facts if self._facts is not None else frozenset()
        steps = [Update(REMOVE, fact(*each)) for each in sorted(known - facts)]
        steps += [Update(ADD, fact(*each)) for each in sorted(facts - known)]
        steps += [
            Update(ADD, function_value(key[0], key[1:], value))
            for key, value in values.items()
            if self._values.get(key) != value
        ]
        self._knowledge.update(steps)
        self._facts, self._values = facts, values


class Bridge:
    """Serves move_base, recognize, pick, place, open and close, and sets the points of interest.

    :param simulation: what it serves; one action at a time.
    :param knowledge: where it keeps what is sensed.
    :param known: whether the robot knows at first where the things are.
    """

    def __init__(self, simulation: Simulation, knowledge: KnowledgeClient, known: bool = False) -> None:
        self._simulation = simulation
        things = simulation.state().things
        self._belief = Belief(simulation.house, things, things if known else None)
        self._senses = Senses(self._belief, simulation, knowledge)
        self._robot = threading.Lock()  # guards the robot, which does one action at a time, and the counts
        self._begun = self._failed = 0
        self._states = rospy.Publisher("pyrobosim/state", String, queue_size=10, latch=True)
        self._servers = [
            SerialActionServer(name, kind, functools.partial(self._execute, action), self._cancel)
            for action, (name, kind) in SERVERS.items()
        ]

    def start(self) -> None:
        """Writes the house into the knowledge base and begins to serve.

        :raises KnowledgeError: when it refuses that, or a :class:`ServiceError` when it does not answer.
        """
        sites = self._simulation.house.sites.items()
        set_param(POINTS_PARAM, {name: {"x": site.x, "y": site.y, "yaw": 0.0} for name, site in sites})
        self._senses.begin()
        self._tell("")
        for server in self._servers:
            server.start()

    def shutdown(self) -> None:
        """Stops what runs, and serves no more."""
        for server in self._servers:
            server.shutdown()
        self._simulation.end()

    def _execute(self, action: str, goal: ServerGoal) -> None:
        if not self._robot.acquire(blocking=False):
            goal.abort(text="the robot is at another action; cancel that first")
            return
        try:
            if goal.cancel_requested:
                goal.cancelled(text="cancelled before it began")
                return
            self._begun += 1
            self._tell(action)
            try:
                reason, seen = self._simulation.act(action, target_of(self._simulation.house, goal.goal))
            except ValueError as error:
                reason, seen = str(error), []
            reason = self._learn(action, reason, seen)
            wanted = goal.goal.classes if action == "detect" else ()
            self._failed += bool(reason) or not set(wanted) <= set(seen)
            self._tell("")
        finally:
            self._robot.release()
        if reason and goal.cancel_requested:
            goal.cancelled(text=reason)
        elif reason:
            goal.abort(text=reason)
        else:
            goal.succeed(looked(seen) if action == "detect" else None)

    def _learn(self, action: str, reason: str, seen: List[str]) -> str:
        """Keeps what was found out; returns why the action failed."""
        if action == "detect" and not reason:
            self._belief.looked(self._simulation.state().site, seen)
        self._belief.felt(self._simulation.state())
        try:
            self._senses.sense()
        except (KnowledgeError, ServiceError) as error:
            return f"what was sensed could not be kept: {error}"
        return reason

    def _cancel(self, goal: ServerGoal) -> None:
        start_thread("cancel", self._stop, goal)

    def _stop(self, goal: ServerGoal) -> None:
        # pyrobosim forgets a stop that comes while it still plans the path, and does not say when the drive
        # begins: so it is asked again. All other actions end by themselves, within their delay.
        ended = threading.Event()
        while not goal.done:
            self._simulation.stop()
            ended.wait(STOP_PERIOD)

    def _tell(self, running: str) -> None:
        """Publishes what is true. Called by :meth:`start` or with the robot's lock held."""
        data = as_data(self._simulation.house, self._simulation.state())
        counts = {"running": running, "begun": self._begun, "failed": self._failed}
        self._states.publish(String(json.dumps({**data, **counts})))


def target_of(house: House, goal: Any) -> str:
    """The site to which a goal of move_base drives, or the object of one of the arm; of recognize none.

    :raises ValueError: when the pose is no site's.
    """
    if not hasattr(goal, "target_pose"):
        return str(getattr(goal, "object", ""))
    at = goal.target_pose.pose.position
    for name, site in house.sites.items():
        if math.hypot(site.x - at.x, site.y - at.y) < NEAR:
            return name
    raise ValueError(f"there is no site at ({at.x:.2f}, {at.y:.2f}) m; drive to a point of interest")


def looked(seen: List[str]) -> RecognizeResult:
    """What a look has seen; pyrobosim tells names only."""
    found = [Detection3D(results=[ObjectHypothesisWithPose(id=each, score=1.0)]) for each in range(len(seen))]
    return RecognizeResult(Detection3DArray(detections=found), seen)


def _start() -> None:
    world = str(rospy.get_param("~world", ""))
    if not world:
        raise WorldError("parameter ~world is missing; give a world file of pyrobosim, _world:=FILE")
    simulation = Simulation(Path(world), whole("~seed", 1, 0), number("~rtf", 1.0, 0.01))
    bridge = Bridge(simulation, knowledge_client(), flag("~known", False))
    shown = Shown(simulation)
    rospy.on_shutdown(shown.shutdown)
    rospy.on_shutdown(bridge.shutdown)
    wait_for_knowledge_base("rosplan_knowledge_base", KNOWLEDGE_WAIT)
    bridge.start()
    shown.start()
    rospy.loginfo("pyrobosim: the robot is ready")


def main() -> int:
    """Runs the node: `~world` (file), `~seed` (1), `~rtf` (1.0, simulated s per s), `~known` (false)."""
    return run_node("pyrobosim", _start, WorldError, missing=(KnowledgeError, ServiceError))
