"""Control of the robot from the page: goals, cancels, pausing, stop. Each request is checked first."""

from typing import Any, Dict, Protocol

LONGEST_GOAL = 4000  # characters
HIGHEST_PRIORITY = 2**31 - 1
REQUESTS = ("check", "send", "cancel", "pause", "resume", "stop", "release")


class ControlError(Exception):
    """What was asked for cannot be done; the text is a sentence that says why."""


class ControlledRobot(Protocol):
    """What can be asked of the robot; each method raises ControlError when it cannot be done."""

    def check(self, goal: str) -> None:
        """Compares a goal in PDDL with the domain and the world."""

    def send(self, goal: str, priority: int) -> str:
        """Sends a goal; returns the id of the request."""

    def cancel(self, request: str) -> None:
        """Cancels a request."""

    def pause_mission(self, pause: bool) -> str:
        """Pauses the mission, or lets it go on; returns what it answered."""

    def stop(self) -> str:
        """Stops the base until it is released, and cancels all requests; returns what was done."""

    def release(self) -> str:
        """Lets the base drive again; returns what the guard answered."""


class Control:
    """Carries out what the page asks for.

    :param robot: the robot.
    """

    def __init__(self, robot: ControlledRobot) -> None:
        self._robot = robot

    def carry_out(self, what: str, fields: Dict[str, Any]) -> str:
        """Does something; returns a sentence.

        :param what: check, send, cancel, pause, resume, stop or release.
        :param fields: goal and priority, or request.
        :raises ControlError: it cannot be done.
        """
        if what == "check":
            self._robot.check(_goal(fields))
            return "The goal can be sent."
        if what == "send":
            goal, priority = _goal(fields), _priority(fields)
            self._robot.check(goal)
            return f"Sent as {self._robot.send(goal, priority)}."
        if what == "cancel":
            request = fields.get("request")
            if not isinstance(request, str) or not request:
                raise ControlError("Name the request that is to be cancelled.")
            self._robot.cancel(request)
            return "The cancel was sent."
        if what in ("pause", "resume"):
            return self._robot.pause_mission(what == "pause")
        if what == "stop":
            return self._robot.stop()
        if what == "release":
            return self._robot.release()
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
