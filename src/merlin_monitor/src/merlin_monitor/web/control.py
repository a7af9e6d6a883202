"""Control of the robot from the page: goals, cancels, pausing, stop. Each request is checked first."""

from typing import Any, Dict, Protocol

LONGEST_GOAL = 4000  # characters
HIGHEST_PRIORITY = 2**31 - 1
REQUESTS = ("who", "check", "send", "cancel", "cancel_all", "pause", "resume", "stop", "release")


class ControlError(Exception):
    """What was asked for cannot be done; the text is a sentence that says why."""


class ControlledRobot(Protocol):
    """What can be asked of the robot; each method raises ControlError when it cannot be done.

    `by` is the name of the operator, which the history shows.
    """

    def check(self, goal: str) -> None:
        """Compares a goal in PDDL with the domain and the world."""

    def send(self, goal: str, priority: int, by: str) -> str:
        """Sends a goal; returns the id of the request."""

    def cancel(self, request: str, by: str) -> str:
        """Cancels a request; returns what was done."""

    def cancel_all(self, by: str) -> str:
        """Cancels all requests; returns what was done."""

    def pause(self, pause: bool, by: str) -> str:
        """Lets no further request begin, or the next one; returns what the Executor answered."""

    def stop(self, by: str) -> str:
        """Stops the base until it is released, and cancels all requests; returns what was done."""

    def release(self, by: str) -> str:
        """Lets the base drive again; returns what was done."""


class Control:
    """Carries out what the page asks for.

    :param robot: the robot.
    """

    def __init__(self, robot: ControlledRobot) -> None:
        self._robot = robot

    def carry_out(self, what: str, fields: Dict[str, Any], by: str) -> str:
        """Does something; returns a sentence.

        :param what: one of `REQUESTS`.
        :param fields: goal and priority, or request.
        :param by: the operator.
        :raises ControlError: it cannot be done.
        """
        robot = self._robot
        if what == "who":
            return by
        if what == "check":
            robot.check(_goal(fields))
            return "The goal can be sent."
        if what == "send":
            goal, priority = _goal(fields), _priority(fields)
            robot.check(goal)
            return f"Sent as {robot.send(goal, priority, by)}."
        if what == "cancel":
            request = fields.get("request")
            if not isinstance(request, str) or not request:
                raise ControlError("Name the request that is to be cancelled.")
            return robot.cancel(request, by)
        if what == "cancel_all":
            return robot.cancel_all(by)
        if what in ("pause", "resume"):
            return robot.pause(what == "pause", by)
        if what == "stop":
            return robot.stop(by)
        if what == "release":
            return robot.release(by)
        raise ControlError(f"There is nothing called {what!r}; there is {', '.join(REQUESTS)}.")


def _goal(fields: Dict[str, Any]) -> str:
    goal = fields.get("goal")
    if not isinstance(goal, str) or not goal.strip():
        raise ControlError("Write a goal, like (checked kitchen).")
    if len(goal) > LONGEST_GOAL:
        raise ControlError(f"A goal has at most {LONGEST_GOAL} characters.")
    return goal.strip()


def _priority(fields: Dict[str, Any]) -> int:
    priority = fields.get("priority", 0)
    if not isinstance(priority, int) or isinstance(priority, bool) or abs(priority) > HIGHEST_PRIORITY:
        raise ControlError("A priority is a whole number.")
    return priority
