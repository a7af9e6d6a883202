"""Breakpoints of operators, step and continue; forced outcomes of states, and the autonomy level."""

from typing import Callable, Sequence

import rospy

from merlin_monitor.text.phrase import Phrase, say
from merlin_monitor.web.page_control import ControlError
from merlin_pddl.breakpoints import BreakpointError
from merlin_sm.breakpoint_client import BreakpointClient, Stepped
from merlin_sm.knowledge_client import KnowledgeClient


class RobotBreakpoints:
    """The breakpoints of one robot. They stay with it, whatever becomes of the page.

    :param knowledge: of the robot.
    :param report: takes an operator and what was done, for the history.
    """

    def __init__(self, knowledge: KnowledgeClient, report: Callable[[str, Phrase], None]) -> None:
        dispatcher = str(rospy.get_param("~plan_dispatcher", "rosplan_plan_dispatcher"))
        self._client = BreakpointClient(knowledge, dispatcher=dispatcher)
        self._report = report

    def hold_before(self, texts: Sequence[str], by: str) -> str:
        """Replaces the breakpoints."""
        try:
            self._client.set(texts)
        except BreakpointError as error:
            raise ControlError(f"Not all breakpoints are set: {error}.") from error
        shown = ", ".join(texts) or "nothing"
        kept = ", ".join(texts) or say("nothing")
        self._report(by, say("{client} holds the robot before {what}", client=by, what=kept))
        return f"It is held before {shown}."

    def go_on(self, step: bool, by: str) -> str:
        """Continues from a breakpoint; a step holds the next action or state."""
        try:
            stepped = self._client.step() if step else Stepped(self._client.go_on(), "")
        except BreakpointError as error:
            raise ControlError(f"Not continued: {error}.") from error
        if stepped.state:
            self._report(by, say("{client} lets the state {state} begin", client=by, state=stepped.state))
        else:
            begun = "{client} lets one action begin" if step else "{client} lets what is held go on"
            self._report(by, say(begun, client=by))
        return stepped.said

    def leave(self, state: str, outcome: str, within: str, by: str) -> str:
        """Makes a state end with an outcome; its node adds an event to the history when it has left.

        :param outcome: empty: the one that waits is confirmed.
        :param within: the namespace of the node that runs it, with a slash at its end; empty: any.
        """
        try:
            done = self._client.states.leave(state, outcome, by, within)
        except BreakpointError as error:
            raise ControlError(f"Not done: {error}.") from error
        if outcome:
            wished = say("{client} wishes {outcome} of {state}", client=by, outcome=outcome, state=state)
            self._report(by, wished)
        return done

    def set_autonomy(self, level: str, by: str) -> str:
        """Sets the autonomy level of all machines."""
        try:
            self._client.states.set_autonomy(level)
        except BreakpointError as error:
            raise ControlError(f"The autonomy level is not set everywhere: {error}.") from error
        self._report(by, say("{client} sets the autonomy level {level}", client=by, level=say(level)))
        return f"The autonomy level is {level}."
