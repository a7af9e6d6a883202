"""What the answer of a dispatcher means, by its action or its service."""

from actionlib_msgs.msg import GoalStatus
from rosplan_dispatch_msgs.srv import DispatchServiceResponse

from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.service_proxy import ServiceError, ServiceUnavailable
from merlin_sm.dispatching.progress import PART, Reply


def reply_of(answer: object, dispatcher: str, begun: bool) -> Reply:
    """Reads it.

    :param answer: the goal that has ended, the response of the service, or what the call has raised.
    :param dispatcher: its name.
    :param begun: whether an action of the dispatch was seen.
    """
    if isinstance(answer, ClientGoal):
        if answer.status == GoalStatus.REJECTED:
            return Reply(refused=answer.text)
        if answer.status != GoalStatus.LOST:
            return Reply(achieved=answer.result.goal_achieved)
        answer = ServiceUnavailable(answer.text)
    if isinstance(answer, DispatchServiceResponse):
        return Reply(achieved=answer.goal_achieved)
    if not isinstance(answer, ServiceError):
        return Reply(gone=f"the call of {PART} failed: {type(answer).__name__}: {answer}")
    if not isinstance(answer, ServiceUnavailable):
        return Reply(refused=str(answer))
    if begun:
        return Reply(gone=f"{PART} {dispatcher} ended while it carried out the plan")
    return Reply(gone=f"{PART} does not answer: {answer}")
