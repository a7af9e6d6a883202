# SPDX-License-Identifier: Apache-2.0
"""Plans the requests that wait before they begin, so that it is known when each ends and which one is late.

The planner does that beside what it plans for the request that runs, in a process of its own and with a lower
priority. One request after the other is planned, in the order in which they would begin, each from where
those before it end. Only what waits with or before a deadline is.
"""

import math
import threading
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

import rospy
from merlin_msgs.msg import GoalDeadline, PlannerStatus
from merlin_msgs.srv import PreviewPlanResponse

from merlin_executor.core.agenda import Agenda, Decision
from merlin_executor.core.engine import Engine
from merlin_executor.core.time_window import Forecast
from merlin_executor.errands.selection import Answer, Errand, select
from merlin_executor.node.request import Request
from merlin_planning.dispatch_client import DispatchClient
from merlin_planning.knowledge_text import step_text
from merlin_planning.planning_client import PlanningClient
from merlin_ros.service_proxy import ServiceError
from merlin_ros.work.passed_time import clock_text
from merlin_ros.work.threads import CallQueue

MOST = 8  # requests in a row that are planned ahead
NOT_KNOWN = -1.0  # s


class Start(NamedTuple):
    """From where and when a request is planned ahead."""

    begin: float
    """s of ROS time; as early as it may, where that is not known."""
    running: List[str]
    """The actions under way, as PDDL text."""
    coming: List[str]
    """Those that have not begun and come before."""


class _Changed(Exception):
    """What was planned ahead for is not so any more."""


class Forecasts:
    """Keeps :attr:`Ticket.forecast` of the requests that wait, and decides for which there is no time.

    :param engine: has the requests.
    :param planning: the planning system.
    :param dispatcher: carries out the plan of those that run.
    """

    def __init__(self, engine: Engine[Request], planning: PlanningClient, dispatcher: DispatchClient) -> None:
        self._engine = engine
        self._planning = planning
        self._dispatcher = dispatcher
        self._calls = CallQueue("forecasts")
        self._lock = threading.Lock()  # guards the two fields below
        self._asked = False
        self._forgotten = 0  # how often
        self._chosen: Tuple[int, ...] = ()  # of what was chosen last; in the thread of the calls only

    def look(self) -> None:
        """What waits or runs has changed: plans what is not planned yet. Never blocks."""
        if self._next() is None and not self._competing():
            return
        with self._lock:
            if self._asked:
                return
            self._asked = True
        self._calls.put(self._work)

    def forget(self, as_planned: bool) -> None:
        """A request has ended.

        :param as_planned: what follows still begins from where it was expected, but may begin earlier, and
            what begins at once from another state. Otherwise all begins from elsewhere.
        """
        with self._lock:
            self._forgotten += not as_planned
        for request in self._engine.waiting:
            forecast = request.forecast
            if forecast is not None and not (as_planned and forecast.ahead and not forecast.late):
                request.forecast = None

    def _work(self) -> None:
        with self._lock:
            self._asked = False
        request = self._next()
        try:
            if request is not None:
                self._plan(request)
            else:
                self._choose(self._competing())
        except ServiceError as error:  # the next change asks again
            rospy.logwarn_throttle_identical(60.0, f"no request is planned ahead: {error}")
        except _Changed:
            self.look()

    # --- one after the other ------------------------------------------------------------------------------

    def _next(self) -> Optional[Request]:
        """The first request that has to be planned; none while another plan is made for those that run."""
        if self._engine.revision():
            return None
        lines = self._engine.lines()[:MOST]
        timed = [number for number, (request, _) in enumerate(lines) if request.window.is_limited]
        running = self._engine.agenda.running
        if not timed or (running is not None and not running.plan):
            return None
        for request, ahead in lines[: timed[-1] + 1]:
            forecast = request.forecast
            if forecast is None or not forecast.fits(ahead):
                return request
            if forecast.seconds < 0.0 and not forecast.late:  # what begins behind it cannot be known
                return request if forecast.ended != len(self._dispatcher.succeeded) else None
        return None

    def _plan(self, request: Request) -> None:
        ahead = dict(self._engine.lines()).get(request)
        if ahead is None:
            return
        with self._lock:
            forgotten = self._forgotten
        ended = len(self._dispatcher.succeeded)
        start = self._start(request, ahead)
        within = request.window.deadline - start.begin
        answer = self._ask(request, start.running, start.coming, within)
        if answer.status.state == PlannerStatus.CANCELLED:
            return  # another client looks ahead now; the next change asks again
        found = _forecast(answer, ahead, start.begin, request.window.deadline)
        equal = {other.order for other in self._engine.waiting if other.priority == request.priority}
        found = found._replace(alone=not equal & set(ahead), ended=ended)

        with self._lock:
            outdated = forgotten != self._forgotten
        if outdated:
            raise _Changed

        def take(_: Agenda[Request]) -> List[Decision]:
            request.forecast = found
            return []

        self._engine.decide(take)

    def _ask(
        self, request: Request, running: Sequence[str], coming: Sequence[str], within: float
    ) -> PreviewPlanResponse:
        """A plan; where that is not in time, another one that is, or the proof that there is none.

        Only the proof needs the deadline, and where there is none the planner searches long.
        """

        def planned(limit: float) -> PreviewPlanResponse:
            deadlines = [GoalDeadline(request.texts, limit)]
            return self._planning.preview(after=list(running), then=list(coming), deadlines=deadlines)

        first = planned(math.inf)
        if first.status.state != PlannerStatus.SOLVED or first.reached[0] <= within:
            return first
        second = planned(within)
        return second if second.reached else first

    def _start(self, request: Request, ahead: Sequence[int]) -> Start:
        free: Optional[float] = None
        for other, outlook in self._engine.outlooks():
            if other is request:
                free = outlook.begin if outlook.begin is not None else free
                break
            free = free if other.forecast is not None and other.forecast.late else outlook.end
        begin = max(rospy.get_time(), request.window.not_before, free or 0.0)
        running = self._engine.agenda.running
        actions = self._dispatcher.running if running is not None else []
        begun = self._dispatcher.succeeded | {action.action_id for action in actions}
        plan = running.plan if running is not None else []
        coming = [step_text(s) for s in plan if s.action_id not in begun]
        for other in self._engine.waiting:
            if other.order in ahead and other.forecast is not None:
                coming += other.forecast.steps
        return Start(begin, list(map(step_text, actions)), coming)

    # --- which ones, where not all can be in time --------------------------------------------------------

    def _competing(self) -> List[Request]:
        """Requests of one priority of which one is late because of the others; none: there are none."""
        if self._engine.revision():
            return []
        known = [
            (request, outlook.late)
            for request, outlook in self._engine.outlooks()[:MOST]
            if request.window.is_limited and not _hopeless(request)
        ]
        late = [request for request, late in known if late and not request.left_out]
        competing = [request for request, _ in known if late and request.priority == late[0].priority]
        return competing if len(competing) > 1 and self._key(competing) != self._chosen else []

    def _key(self, requests: Sequence[Request]) -> Tuple[int, ...]:
        running = self._engine.agenda.running
        return (-1 if running is None else running.order, *sorted(request.order for request in requests))

    def _choose(self, competing: List[Request]) -> None:
        if not competing:
            return
        key = self._key(competing)
        first = competing[0]
        start = self._start(first, dict(self._engine.lines()).get(first, ()))
        requests = {f"{request.text} ({request.order})": request for request in competing}
        plans: Dict[Optional[str], Sequence[str]] = {None: ()}

        def planned(name: str, before: Optional[str]) -> Answer:
            if self._key([request for request in self._engine.waiting if request in competing]) != key:
                raise _Changed
            request = requests[name]
            within = request.window.deadline - start.begin if before is None else math.inf
            answer = self._ask(request, start.running, [*start.coming, *plans[before]], within)
            if before is None:
                plans[name] = answer.actions
            if answer.status.state == PlannerStatus.UNSOLVABLE:
                return Answer(impossible=answer.status.reason)
            seconds = _seconds(answer)
            return Answer(seconds if seconds >= 0.0 else None)

        errands = [
            Errand(
                name,
                request.window.deadline - start.begin,
                value=request.value,
                ready=max(0.0, request.window.not_before - start.begin),
            )
            for name, request in requests.items()
        ]
        selection = select(errands, planned)
        preferred = ", ".join(requests[name].text for name in selection.taken)
        ranks = {requests[name].order: (rank, "") for rank, name in enumerate(selection.taken)}
        for name, why in selection.left_out.items():
            why = why or f"there is no time for it (preferred: {preferred})"
            ranks[requests[name].order] = len(ranks), why
        self._chosen = key
        self._engine.decide(lambda agenda: agenda.arrange(ranks))


def _hopeless(request: Request) -> bool:
    """Whether a request is late by itself, or was not planned ahead."""
    forecast = request.forecast
    return forecast is None or bool(forecast.late and forecast.alone)


def _seconds(answer: PreviewPlanResponse) -> float:
    """After how many seconds the goals hold; NOT_KNOWN without a plan, and without durations in it."""
    timed = any(answer.durations) or not answer.actions
    solved = answer.status.state == PlannerStatus.SOLVED and answer.reached
    return float(answer.reached[0]) if timed and solved else NOT_KNOWN


def _forecast(answer: PreviewPlanResponse, ahead: Tuple[int, ...], begin: float, deadline: float) -> Forecast:
    """What an answer of the planner says of a request."""
    if answer.status.state == PlannerStatus.SOLVED:
        return Forecast(ahead, _seconds(answer), steps=tuple(answer.actions))
    if answer.status.state != PlannerStatus.UNSOLVABLE or not answer.reached:
        return Forecast(ahead, NOT_KNOWN)
    seconds, by, at = answer.reached[0], clock_text(deadline), clock_text(begin)
    needs = f"needs {seconds:.0f} s" if seconds >= 0.0 else "needs longer"
    return Forecast(ahead, seconds, f"cannot be done before its deadline {by}: {needs} from {at} on")
