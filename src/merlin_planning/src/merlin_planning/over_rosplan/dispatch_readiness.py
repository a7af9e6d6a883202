"""What has to be there before a dispatcher without status is called: its action interfaces, and the plan.

ROSPlan hands a plan over by a topic and starts it by a service, and nothing keeps the two in order: a plan of
before is carried out when the service is faster. The esterel dispatcher draws each plan that it receives, on
``plan_graph``; the drawing says that the plan has come. The simple dispatcher says nothing.
"""

import re
import threading
from typing import Callable, Dict, List, Optional, Sequence

import rospy
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_knowledge_msgs.msg import DomainFormula
from std_msgs.msg import String

from merlin_planning.dispatch_progress import Ground, ground
from merlin_ros.deadline import Deadline
from merlin_ros.late_topics import subscribe
from merlin_ros.master.master_link import ERRORS, bounded_master

INTERFACE_WAIT = 3.0  # s of running time for the action interfaces of a plan to announce themselves
DRAWING_WAIT = 2.0  # s of running time for a dispatcher that draws its plans to draw the new one
ANNOUNCED = 1000  # operators whose interfaces are remembered; any node may announce some
_START = re.compile(r'^\s*(\d+)\s*\[\s*label="([^"\\(]*)_start\\n\(([^"]*)\)"', re.MULTILINE)


def drawn_actions(drawing: str) -> List[Ground]:
    """The actions of a drawn plan graph, in the order of the plan.

    :param drawing: DOT text as on ROSPlan's ``plan_graph``.
    """
    starts = sorted((int(number), name, arguments) for number, name, arguments in _START.findall(drawing))
    return [ground(name, arguments.split(",") if arguments else []) for _, name, arguments in starts]


class DispatchReadiness:
    """What is known of the interfaces, and of the plan that a dispatcher has received last.

    :param dispatcher: its global name.
    :param knowledge_base: the global name of the knowledge base where action interfaces announce themselves.
    :param changed: guards what is known, and is notified when it changes.
    """

    def __init__(self, dispatcher: str, knowledge_base: str, changed: threading.Condition) -> None:
        self._drawings = f"{dispatcher}/plan_graph"
        self._changed = changed
        self._announced: Dict[str, None] = {}  # operators, the one that is silent for longest first
        self._drawn: Optional[List[Ground]] = None
        self._subscriber: Optional[rospy.Subscriber] = None
        rospy.Subscriber(f"{knowledge_base}/pddl_action_parameters", DomainFormula, self._receive_interface)

    def wait(self, plan: Sequence[ActionDispatch], interrupted: Callable[[], bool]) -> None:
        """Waits until a dispatcher without status is ready for a plan, with a limit for each part.

        :param interrupted: ends the wait; asked with `changed` held, which is notified when it becomes true.
        """
        operators = {action.name.lower() for action in plan}
        with self._changed:
            Deadline(INTERFACE_WAIT).wait(
                self._changed, lambda: interrupted() or operators <= self._announced.keys()
            )
        if not plan or not self._draws():
            return
        meant = [ground(action.name, [entry.value for entry in action.parameters]) for action in plan]
        with self._changed:
            Deadline(DRAWING_WAIT).wait(self._changed, lambda: interrupted() or self._drawn == meant)

    def _draws(self) -> bool:
        """Whether the dispatcher publishes drawings; they are subscribed as late as this.

        One with a status needs none, and draws large graphs only for subscribers.
        """
        try:
            if self._drawings not in dict(bounded_master().getPublishedTopics("")):
                return False
            if self._subscriber is None:
                self._subscriber = subscribe(self._drawings, String, self._receive_drawing)
        except ERRORS:
            return False
        return True

    def _receive_interface(self, formula: DomainFormula) -> None:
        name = formula.name.lower()
        with self._changed:
            others = [other for other in self._announced if other != name]
            self._announced = dict.fromkeys([*others, name][-ANNOUNCED:])
            self._changed.notify_all()

    def _receive_drawing(self, drawing: String) -> None:
        with self._changed:
            self._drawn = drawn_actions(drawing.data)
            self._changed.notify_all()
