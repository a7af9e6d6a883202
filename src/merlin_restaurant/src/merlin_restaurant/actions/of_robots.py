"""The restaurant's actions for several robots (pddl/restaurant/robots.pddl).

Each is the action of the same name for one robot, with the robot ?r as its first parameter.
"""

from typing import Any

from merlin_actions.actions import navigate
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_restaurant.actions import (
    check_entrance,
    check_table,
    deliver_order,
    greet_client,
    guide_client,
    load_order,
    order_to_barman,
    return_order,
    take_order,
)
from merlin_restaurant.second_look import SecondLook
from merlin_restaurant.waiting_clients import note_clients
from smach import State

#: The robot stands beside the point: it has to drive the rest before another action.
STOPPED_AT = ["(not (robot_at ?r anywhere))", "(robot_at ?r ?here)", "(not (free ?here))"]


class Navigate(navigate.Navigate):
    """Drives. A robot that is stopped occupies only the place at which it stands."""

    parameters = ["r", "from", "to"]
    if_interrupted = ["(robot_at ?r anywhere)", "(free ?to)"]
    if_stopped_at = STOPPED_AT


class LineUp(MerlinActionSM):
    """The rest of a drive that was stopped beside its end."""

    parameters = ["r", "p"]

    def build(self) -> None:
        """One state: the drive."""
        self.add("DRIVE", self.state("navigation"), remapping={"target": "p"})


class CheckTable(check_table.CheckTable):
    """Looks at a table. Another robot may hide a guest for a moment."""

    parameters = ["r", "t"]

    def look(self) -> State:
        """Looks again where no guest is seen."""
        return SecondLook()


class TakeOrder(take_order.TakeOrder):
    """The robot becomes the guest's waiter."""

    parameters = ["r", "t"]


class TakeOver(MerlinActionSM):
    """Takes over a guest whose waiter has left."""

    parameters = ["r", "gone", "t"]
    robot_parameter = "r"

    def build(self) -> None:
        """TELL, where the robot stands."""
        self.add("TELL", self.state("speak", "I take over {t} from {gone}.", keys=("t", "gone")))


class OrderToBarman(order_to_barman.OrderToBarman):
    """Tells the barman an order."""

    parameters = ["r", "b", "t"]


class LoadOrder(load_order.LoadOrder):
    """Takes an order from the bar."""

    parameters = ["r", "b", "t"]


class DeliverOrder(deliver_order.DeliverOrder):
    """Delivers an order. Another robot may hide a guest for a moment."""

    parameters = ["r", "t"]

    def look(self) -> State:
        """Looks again where no guest is seen."""
        return SecondLook()


class ReturnOrder(return_order.ReturnOrder):
    """Takes an order back to the bar."""

    parameters = ["r", "b", "t"]


class CheckEntrance(check_entrance.CheckEntrance):
    """Looks at the entrance, and notes each client who waits."""

    parameters = ["r"]

    def _remember(self, userdata: Any) -> None:
        super()._remember(userdata)
        note_clients(self, check_entrance.people_waiting(userdata.detections))


class GreetClient(greet_client.GreetClient):
    """Greets a client, whom this robot then leads. Notes the other clients, for other robots."""

    parameters = ["r", "c"]

    def build(self) -> None:
        """LOOK → COUNT, then the states of the action for one robot."""
        look = self.state("recognize", ["person"])
        self.add("LOOK", look, {"succeeded": "COUNT", "aborted": "GREET"})
        self.add("COUNT", self.state("function", self._count, ["detections"]), {"succeeded": "GREET"})
        super().build()

    def _count(self, userdata: Any) -> None:
        note_clients(self, check_entrance.people_waiting(userdata.detections))


class GuideClient(guide_client.GuideClient):
    """Leads a client. A robot that is stopped occupies only the place at which it stands."""

    parameters = ["r", "c", "t"]
    if_interrupted = ["(robot_at ?r anywhere)", "(quiet ?r)", "(ready ?t)", "(free ?t)"]
    if_stopped_at = STOPPED_AT
    greeted = "(greeted {r} {c})"
