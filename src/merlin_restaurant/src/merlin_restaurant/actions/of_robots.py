"""The restaurant's actions for several robots (pddl/restaurant/robots.pddl): those of one, for robot ?r."""

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


class Navigate(navigate.Navigate):
    """The drive; a robot that is stopped keeps no place."""

    parameters = ["r", "from", "to"]
    if_interrupted = ["(robot_at ?r anywhere)", "(free ?to)"]


class CheckTable(check_table.CheckTable):
    """See there."""

    parameters = ["r", "t"]


class TakeOrder(take_order.TakeOrder):
    """The robot becomes the guest's waiter."""

    parameters = ["r", "t"]


class TakeOver(MerlinActionSM):
    """A guest whose waiter is gone gets another one."""

    parameters = ["r", "gone", "t"]
    robot_parameter = "r"

    def build(self) -> None:
        """TELL, where the robot stands."""
        self.add("TELL", self.state("speak", "I take over {t} from {gone}.", keys=("t", "gone")))


class OrderToBarman(order_to_barman.OrderToBarman):
    """See there."""

    parameters = ["r", "t"]


class LoadOrder(load_order.LoadOrder):
    """See there."""

    parameters = ["r", "t"]


class DeliverOrder(deliver_order.DeliverOrder):
    """See there."""

    parameters = ["r", "t"]


class ReturnOrder(return_order.ReturnOrder):
    """See there."""

    parameters = ["r", "t"]


class CheckEntrance(check_entrance.CheckEntrance):
    """See there."""

    parameters = ["r"]


class GreetClient(greet_client.GreetClient):
    """The client is led by the robot that has greeted."""

    parameters = ["r", "c"]


class GuideClient(guide_client.GuideClient):
    """See there; a robot that is stopped keeps no place."""

    parameters = ["r", "c", "t"]
    if_interrupted = ["(robot_at ?r anywhere)", "(quiet ?r)", "(ready ?t)", "(free ?t)"]
    greeted = "(greeted {r} {c})"
