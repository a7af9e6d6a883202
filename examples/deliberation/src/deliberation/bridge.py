# SPDX-License-Identifier: Apache-2.0
"""The bridge: runs pyrobosim without a window, and serves its robot's actions as action servers.

Beside them it keeps what the robot senses in the knowledge base, and says on a topic what is true.
"""

import functools
import json
import threading
from pathlib import Path
from typing import Dict, FrozenSet, List, Optional

import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import RunActionAction, RunActionResult
from rosplan_knowledge_msgs.srv import SetNamedBool
from std_msgs.msg import String

from deliberation.belief import SENSED, Belief, Fact, Values, fixed_facts, fixed_values, objects
from deliberation.house import ACTIONS, as_data
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
from merlin_ros.node import run_node
from merlin_ros.parameters import number, whole
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_ros.work.threads import start_thread

KNOWLEDGE_WAIT = 60.0  # s of wall time
STOP_PERIOD = 0.05  # s of wall time


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
    """Serves `pyrobosim/<action>`, each a merlin_msgs/RunAction with the parameter `target`.

    :param simulation: what it serves; one action at a time.
    :param knowledge: where it keeps what is sensed.
    """

    def __init__(self, simulation: Simulation, knowledge: KnowledgeClient) -> None:
        self._simulation = simulation
        self._belief = Belief(simulation.house, simulation.state().things)
        self._senses = Senses(self._belief, simulation, knowledge)
        self._robot = threading.Lock()  # guards the robot, which does one action at a time, and the counts
        self._begun = self._failed = 0
        self._told = rospy.Publisher("pyrobosim/state", String, queue_size=10, latch=True)
        self._servers = [
            SerialActionServer(
                f"pyrobosim/{action}", RunActionAction, functools.partial(self._execute, action), self._cancel
            )
            for action in ACTIONS
        ]

    def start(self) -> None:
        """Writes the house into the knowledge base and begins to serve.

        :raises KnowledgeError: when it refuses that, or a :class:`ServiceError` when it does not answer.
        """
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
        parameters = values_of(goal.goal.parameters)
        if not self._robot.acquire(blocking=False):
            _fail(goal, "the robot is at another action; cancel that first")
            return
        try:
            if goal.cancel_requested:
                goal.cancelled(text="cancelled before it began")
                return
            self._begun += 1
            self._tell(action)
            reason, seen = self._simulation.act(action, parameters.get("target", ""))
            reason = self._learn(action, parameters, reason, seen)
            self._failed += bool(reason)
            self._tell("")
        finally:
            self._robot.release()
        if reason and goal.cancel_requested:
            goal.cancelled(text=reason)
        elif reason:
            _fail(goal, reason)
        else:
            goal.succeed(RunActionResult(outcome="succeeded"))

    def _learn(self, action: str, parameters: Dict[str, str], reason: str, seen: List[str]) -> str:
        """Keeps what was found out; returns why the action failed."""
        if action == "detect" and not reason:
            spot, thing = self._simulation.state().site, parameters.get("target", "")
            self._belief.looked(spot, seen)
            if thing and thing not in seen:
                reason = f"{thing} is not at {spot}"
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
        self._told.publish(String(json.dumps({**data, **counts})))


def values_of(parameters: List[KeyValue]) -> Dict[str, str]:
    """Parameters of a goal by their names."""
    return {each.key: each.value for each in parameters}


def _fail(goal: ServerGoal, reason: str) -> None:
    goal.abort(RunActionResult(outcome="aborted", reason=reason), reason)


def _start() -> None:
    world = str(rospy.get_param("~world", ""))
    if not world:
        raise WorldError("parameter ~world is missing; give a world file of pyrobosim, _world:=FILE")
    simulation = Simulation(Path(world), whole("~seed", 1, 0), number("~rtf", 1.0, 0.01))
    bridge = Bridge(simulation, knowledge_client())
    rospy.on_shutdown(bridge.shutdown)
    wait_for_knowledge_base("rosplan_knowledge_base", KNOWLEDGE_WAIT)
    bridge.start()
    rospy.loginfo("pyrobosim: the robot is ready")


def main() -> int:
    """Runs the node: `~world` (file), `~seed` (1), `~rtf` (1.0, simulated seconds per second)."""
    return run_node("pyrobosim", _start, WorldError, missing=(KnowledgeError, ServiceError))
