# SPDX-License-Identifier: Apache-2.0
"""The naive integration that the paper compares MERLIN with: ROSPlan's way of handling messages in sequence.

The state machine runs directly inside the action interface, in the thread that reads the dispatch topic. A
``cancel_action`` is therefore read only after the machine has ended; by then the action has succeeded, its
effects are true and are applied, and the dispatcher stops before the next action (paper, section 3.2.3).
"""

import functools
import threading
from typing import Any, Dict, List

import rospy

from merlin_actions.action_classes import read_machines
from merlin_actions.action_interface import ActionInterface
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_actions.core.names import DECLARED, ros_name
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_actions.shutdown_order import shut_down
from merlin_planning.knowledge_client import (
    DEFAULT_KNOWLEDGE_BASE,
    KnowledgeBaseMissing,
    KnowledgeError,
    wait_for_knowledge_base,
)
from merlin_ros.node import on_master_lost, run_node
from merlin_ros.parameters import graph_name, number
from merlin_sm.introspection import start_introspection
from merlin_sm.states.merlin_state import SUCCEEDED


class NaiveAction(ActionInterface):
    """Runs a machine inside the callback of the dispatch topic.

    :param machine: the state machine of the action.

    Further parameters are those of :class:`ActionInterface`.
    """

    def __init__(self, machine: MerlinActionSM, **options: Any) -> None:
        super().__init__(machine.operator_name(), **options)
        self.machine = machine
        self._turn = threading.RLock()  # held while an action, and those behind it, are carried out
        machine.check_signature([parameter.key for parameter in self.formula.typed_parameters])

    def run(self, execution: Execution) -> Ending:
        """Runs the machine to its natural end."""
        outcome = self.machine.run_once(execution.binding)
        if outcome == SUCCEEDED:
            return Ending(True)
        return Ending(False, self.machine.reason or f"the machine ended with {outcome}")

    def stop(self) -> None:
        """Preempts what runs, too."""
        self.machine.cancel()
        super().stop()

    def _spawn(self, execution: Execution) -> None:
        execution.left_queue.set()
        with self._turn:
            self._live(execution)

    def _declared(self, execution: Execution) -> Dict[str, Any]:
        return {key: list(getattr(self.machine, key)) for key in DECLARED}


def main() -> int:
    """Runs a node with the naive actions of an application; returns the exit code."""
    missing = (KnowledgeBaseMissing, rospy.ServiceException)
    return run_node("naive_actions", _start, KnowledgeError, ValueError, missing=missing)


def _start() -> None:
    knowledge_base = graph_name("~knowledge_base", DEFAULT_KNOWLEDGE_BASE)
    machines = read_machines()
    wait_for_knowledge_base(knowledge_base, number("~knowledge_base_wait", 30.0, 0.0))
    actions = [NaiveAction(machine, knowledge_base=knowledge_base) for machine in machines]
    started: List[NaiveAction] = []
    rospy.on_shutdown(functools.partial(shut_down, started))
    for action in actions:
        action.start()
        started.append(action)
        on_master_lost(action.machine.cancel)
        rospy.on_shutdown(start_introspection(ros_name(action.operator).upper(), action.machine).stop)
    rospy.loginfo(f"naive actions: {', '.join(action.operator for action in actions)}")
