# SPDX-License-Identifier: Apache-2.0
"""The service over which breakpoints are set, and over which what is held continues."""

from typing import Callable, List, Protocol, Sequence

import rospy
from merlin_msgs.srv import Breakpoints as BreakpointsSrv
from merlin_msgs.srv import BreakpointsRequest, BreakpointsResponse

from merlin_pddl.breakpoints import BreakpointError


class HasBreakpoints(Protocol):
    """What the service sets: :class:`merlin_pddl.breakpoints.Breakpoints`, or what looks like it."""

    @property
    def texts(self) -> List[str]:
        """The breakpoints."""

    @property
    def held(self) -> str:
        """What is held now; empty: nothing."""

    def set(self, texts: Sequence[str]) -> None:
        """Replaces the breakpoints."""

    def step(self) -> None:
        """What is held begins; the next one is held."""

    def go_on(self) -> None:
        """What is held begins."""


class BreakpointService:
    """Answers requests of ``merlin_msgs/Breakpoints``.

    :param breakpoints: which ones.
    :param on_change: called after each change.
    """

    def __init__(self, breakpoints: HasBreakpoints, on_change: Callable[[], None]) -> None:
        self._breakpoints = breakpoints
        self._on_change = on_change

    def offer(self, name: str) -> rospy.Service:
        """Offers it under a name."""
        return rospy.Service(name, BreakpointsSrv, self.answer)

    def answer(self, request: BreakpointsRequest) -> BreakpointsResponse:
        """Carries out a request of the service."""
        breakpoints = self._breakpoints
        held = breakpoints.held
        try:
            if request.what == BreakpointsRequest.SET:
                breakpoints.set(request.before)
                said = f"It is held before {', '.join(breakpoints.texts) or 'nothing'}."
            elif request.what == BreakpointsRequest.STEP:
                breakpoints.step()
                said = f"{held} begins, and the next one is held." if held else "The next one is held."
            elif request.what in (BreakpointsRequest.CONTINUE, BreakpointsRequest.CLEAR):
                if request.what == BreakpointsRequest.CLEAR:
                    breakpoints.set(())
                breakpoints.go_on()
                said = f"{held} begins." if held else "Nothing was held."
            elif request.what == BreakpointsRequest.LOOK:
                said = f"It is held before {held}." if held else "Nothing is held."
            else:
                raise BreakpointError(f"there is no request {request.what}")
        except BreakpointError as error:
            return BreakpointsResponse(False, str(error), breakpoints.texts, held)
        self._on_change()
        return BreakpointsResponse(True, said, breakpoints.texts, held)
