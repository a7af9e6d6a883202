# SPDX-License-Identifier: Apache-2.0
"""Control of the robot from the page: goals, cancels, pausing, stop. Each request is checked first."""

from typing import Any, Callable, Dict, List, Mapping, Protocol

from merlin_monitor.listeners.panel import Request

LONGEST_GOAL = 4000  # characters
LONGEST_NAME = 400  # characters of the name of a state, an outcome or a level
MOST_LISTED = 100  # actions in a list
HIGHEST_PRIORITY = 2**31 - 1


class ControlError(Exception):
    """What was asked for cannot be done; the text is a sentence that says why.

    :param confirm: what the operator has to see, and to send back as ``seen``; empty: it cannot be done.
    """

    def __init__(self, text: str, confirm: str = "") -> None:
        super().__init__(text)
        self.confirm = confirm


class Controls(Protocol):
    """Carries out what a page asks for: of a robot (`RobotRequests`), or of a fleet."""

    def carry_out(self, what: str, fields: Dict[str, Any], by: str) -> Dict[str, Any]:
        """Carries out a request; returns a sentence, ``done``, and what belongs to it.

        :raises ControlError: it cannot be done.
        """


class RobotRequests:
    """Checks what the page asks for, and has the methods of a subclass carry it out."""

    check: Callable[[str], None]
    planning: Any
    offered: Callable[[], Mapping[str, Request]] = dict
    """Gives what panels offer, by its name."""

    def carry_out(self, what: str, fields: Dict[str, Any], by: str) -> Dict[str, Any]:
        """Carries out a request; returns a sentence, ``done``, and what belongs to it.

        :param what: ``plan``, one of `_REQUESTS`, or what a panel offers.
        :param fields: goal and priority, request, goal and what to leave out, or facts.
        :param by: the operator.
        :raises ControlError: it cannot be done.
        """
        if what == "plan":
            goal = _text(fields, "goal")
            self.check(goal)
            return self.planning.plan(goal, _listed(fields, "without"), by)
        if what in _REQUESTS:
            return {"done": _REQUESTS[what](self, fields, by)}
        offered = self.offered()
        if what not in offered:
            known = ", ".join([*_REQUESTS, *offered])
            raise ControlError(f"There is nothing called {what!r}; there is plan, {known}.")
        try:
            return {"done": offered[what](fields, by)}
        except ControlError:
            raise
        except Exception as error:  # of a foreign panel
            raise ControlError(str(error) or type(error).__name__) from error


def _check(robot: Any, fields: Dict[str, Any], by: str) -> str:
    robot.check(_text(fields, "goal"))
    return "The goal can be sent."


def _send(robot: Any, fields: Dict[str, Any], by: str) -> str:
    goal, priority = _text(fields, "goal"), _priority(fields)
    robot.check(goal)
    return f"Sent as {robot.send(goal, priority, by)}."


def _cancel(robot: Any, fields: Dict[str, Any], by: str) -> str:
    request = fields.get("request")
    if not isinstance(request, str) or not request:
        raise ControlError("Name the request that is to be cancelled.")
    return robot.cancel(request, by)


#: What carries out each request; it gets the robot, the fields and the operator.
_REQUESTS: Dict[str, Callable[[Any, Dict[str, Any], str], str]] = {
    "check": _check,
    "send": _send,
    "cancel": _cancel,
    "cancel_all": lambda robot, fields, by: robot.cancel_all(by),
    "pause": lambda robot, fields, by: robot.pause(True, by),
    "resume": lambda robot, fields, by: robot.pause(False, by),
    "stop": lambda robot, fields, by: robot.stop(by, _name(fields, "press")),
    "release": lambda robot, fields, by: robot.release(by, str(fields.get("seen", ""))),
    "change": lambda robot, fields, by: robot.planning.change(
        _text(fields, "facts"), by, str(fields.get("seen", ""))
    ),
    "breakpoints": lambda robot, fields, by: robot.planning.hold_before(_listed(fields, "before"), by),
    "step": lambda robot, fields, by: robot.planning.go_on(True, by),
    "continue": lambda robot, fields, by: robot.planning.go_on(False, by),
    "leave": lambda robot, fields, by: robot.planning.leave(
        _name(fields, "state"), _name(fields, "outcome"), _name(fields, "within"), by
    ),
    "autonomy": lambda robot, fields, by: robot.planning.set_autonomy(_name(fields, "level"), by),
    "acknowledge": lambda robot, fields, by: robot.acknowledge(_name(fields, "problem"), by),
}


def _text(fields: Dict[str, Any], name: str) -> str:
    """The PDDL text of a field, ``goal`` or ``facts``."""
    text = fields.get(name)
    what = "a goal" if name == "goal" else "facts"
    if not isinstance(text, str) or not text.strip():
        raise ControlError(f"Write {what}, like (checked kitchen).")
    if len(text) > LONGEST_GOAL:
        raise ControlError(f"{what.capitalize()} may have at most {LONGEST_GOAL} characters.")
    return text.strip()


def _name(fields: Dict[str, Any], field: str) -> str:
    """The text of a field that names something; empty when it is missing."""
    name = fields.get(field, "")
    if not isinstance(name, str) or len(name) > LONGEST_NAME:
        raise ControlError(f"{field} is a text of {LONGEST_NAME} characters at most.")
    return name.strip()


def _listed(fields: Dict[str, Any], name: str) -> List[str]:
    """The actions of a field."""
    texts = fields.get(name, [])
    if not isinstance(texts, list) or not all(isinstance(each, str) for each in texts):
        raise ControlError(f"{name} is a list of actions.")
    if len(texts) > MOST_LISTED or any(len(each) > LONGEST_GOAL for each in texts):
        raise ControlError(f"{name} takes {MOST_LISTED} actions at most.")
    return texts


def _priority(fields: Dict[str, Any]) -> int:
    priority = fields.get("priority", 0)
    if not isinstance(priority, int) or isinstance(priority, bool) or abs(priority) > HIGHEST_PRIORITY:
        raise ControlError("A priority is a whole number.")
    return priority
