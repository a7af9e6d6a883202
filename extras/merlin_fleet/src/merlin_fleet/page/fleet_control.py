# SPDX-License-Identifier: Apache-2.0
"""What is asked of a fleet on its page: goals sent and cancelled, robots stopped."""

import math
import sys
from typing import Any, Dict, Optional, Tuple

from merlin_fleet.fleet_client import OVER, FleetClient, FleetError
from merlin_monitor.web.page_control import LONGEST_GOAL, ControlError

LONGEST_NAME = 200  # characters


class FleetControl:
    """Stands where a :class:`merlin_monitor.web.robot_control.RobotControl` stands otherwise.

    :param client: of the fleet.
    """

    def __init__(self, client: FleetClient) -> None:
        self._client = client

    def carry_out(self, what: str, fields: Dict[str, Any], by: str) -> Dict[str, Any]:
        """Carries out a request; returns a sentence, ``done``.

        :param what: who, send, cancel or stop.
        :param fields: of a goal: goal, robot, groups, needs, value, begin_by, finish; its id: request; robot.
        :param by: the operator.
        :raises ControlError: it cannot be done.
        """
        try:
            if what == "who":
                return {"done": by}
            if what == "send":
                return {"done": self._send(fields, by)}
            if what == "cancel":
                return {"done": self._cancel(fields, by)}
            if what == "stop":
                return {"done": self._stop(_text(fields, "robot"), by)}
        except FleetError as error:
            raise ControlError(str(error)) from error
        raise ControlError(f"There is nothing called {what!r}; there is who, send, cancel, stop.")

    def _send(self, fields: Dict[str, Any], by: str) -> str:
        goal = _text(fields, "goal", LONGEST_GOAL)
        if not goal:
            raise ControlError("Write a goal, like (checked kitchen).")
        if "deadline" in fields:
            raise ControlError("deadline is called begin_by: s from now within which the goal has to begin.")
        begin_by = _number(fields, "begin_by")
        if begin_by is not None and begin_by <= 0.0:
            raise ControlError("The time to begin by must lie in the future, in s from now.")
        request = self._client.send(
            goal,
            value=_number(fields, "value") or 0.0,
            begin_by=begin_by,
            sender=by,
            robot=_text(fields, "robot"),
            groups=_words(fields, "groups"),
            needs=_words(fields, "needs"),
            finish=fields.get("finish") is True,
        )
        print(f"fleet page: {by} sends {goal} as {request.id}", file=sys.stderr, flush=True)
        news = request.news
        prospect = self._client.prospect(news.goal) if news is not None else ""
        return f"Sent as {request.id}." + (f" But {prospect}." if prospect else "")

    def _cancel(self, fields: Dict[str, Any], by: str) -> str:
        goal = _text(fields, "request")
        news = self._client.request(goal).news
        if news is not None and news.state in OVER:
            raise ControlError("The goal has ended already.")
        self._client.cancel(goal, by)
        print(f"fleet page: {by} cancels {goal}", file=sys.stderr, flush=True)
        return "The cancel was sent."

    def _stop(self, robot: str, by: str) -> str:
        # A visitor without the right to look may stop, so a refusal names no robots.
        try:
            stands, words = self._client.stop(robot, by)
        except FleetError as error:
            stands, words = False, str(error)
        print(f"fleet page: {by} stops {robot}: {words}", file=sys.stderr, flush=True)
        if not stands:
            raise ControlError(f"{robot}: the stop is NOT confirmed: {words}. Use the button on the robot.")
        return f"{robot} stands: {words}."


def _text(fields: Dict[str, Any], name: str, longest: int = LONGEST_NAME) -> str:
    text = fields.get(name, "")
    if not isinstance(text, str):
        raise ControlError(f"{name} is a text.")
    if len(text) > longest:
        raise ControlError(f"{name} may have at most {longest} characters.")
    return text.strip()


def _words(fields: Dict[str, Any], name: str) -> Tuple[str, ...]:
    return tuple(word for part in _text(fields, name).split(",") if (word := part.strip()))


def _number(fields: Dict[str, Any], name: str) -> Optional[float]:
    value = fields.get(name)
    if value is None:
        return None
    try:
        if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
            return float(value)
    except OverflowError:  # JSON knows whole numbers of any length
        pass
    raise ControlError(f"{name} is a number.")
