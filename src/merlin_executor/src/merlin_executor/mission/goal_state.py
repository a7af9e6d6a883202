# SPDX-License-Identifier: Apache-2.0
"""A state that sends goals to the Executor: what a mission's machine is made of (paper, Figure 3)."""

import inspect
import threading
from typing import Any, Callable, Optional, Sequence, Union

from merlin_msgs.msg import ExecuteResult

from merlin_executor.core.outcome import Outcome, outcome_name
from merlin_executor.executor_client import Goals, MerlinExecutorClient, as_list
from merlin_executor.executor_request import ExecutorRequest
from merlin_executor.mission.mission_pause import MissionPause
from merlin_executor.request_times import with_ros_times
from merlin_executor.resending import RESEND
from merlin_planning.knowledge_client import KnowledgeError
from merlin_planning.knowledge_text import PDDLSyntaxError
from merlin_ros.service_proxy import ServiceError
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.merlin_state import PREEMPTED, SUCCEEDED, MerlinState
from merlin_sm.states.text_keys import check_call, keys_of

EXECUTOR_WAIT = 30.0  # s of running time for an Executor that is still starting
NOTHING = "nothing"
ACHIEVED = tuple(int(outcome) for outcome in Outcome if outcome.achieved)


class GoalState(MerlinState):
    """Sends goals and waits until they hold; a preempt cancels them.

    Outcomes: succeeded, preempted, and aborted with the Executor's reason; a function has a further
    one: nothing, when it gives no goals. ``userdata.outcome`` becomes the name of the Executor's outcome.

    :param goals: PDDL text or knowledge items, one or many; ``{key}`` in text is replaced by userdata. Or a
        function from userdata to them, called when the state runs: goals that depend on what is known then.
    :param keys: the userdata keys that the goals may name; None: those that texts name.
    :param client: None: one of its own.
    :param pause: of the mission, None: of the one that runs: while it is paused, the goals are not sent; it
        also decides what becomes of goals that an operator has cancelled.
    :param options: priority, on_interrupt, deadline, alone, … of :meth:`MerlinExecutorClient.send`; times
        that are numbers are s from when the state begins.
    :raises TypeError: for an option that is none.
    :raises ValueError: for a function with other parameters.
    """

    def __init__(
        self,
        goals: Union[Goals, Callable[[Any], Goals]],
        keys: Optional[Sequence[str]] = None,
        client: Optional[MerlinExecutorClient] = None,
        pause: Optional[MissionPause] = None,
        **options: Any,
    ) -> None:
        inspect.signature(MerlinExecutorClient.send).bind(None, goals, **options)
        if callable(goals):
            check_call(goals, "userdata")
        listed = [] if callable(goals) else as_list(goals)
        self._keys = keys_of([goal for goal in listed if isinstance(goal, str)], keys)
        super().__init__([NOTHING] if callable(goals) else [], self._keys, ["outcome"])
        self._goals = goals
        self._options = options
        self._given_pause = pause
        self._pause = MissionPause(lambda paused: None)
        self._client = client or MerlinExecutorClient(on_lost=RESEND)

    def run(self, userdata: Any) -> str:
        """Sends the goals and waits for the end."""
        userdata.outcome = ""
        self._pause = self._given_pause or MissionPause.of_mission or self._pause
        values = {key: userdata[key] for key in self._keys}
        try:
            given = self._goals(userdata) if callable(self._goals) else self._goals
        except (ValueError, KnowledgeError, ServiceError) as error:
            return self.fail(str(error))
        goals = [goal.format(**values) if isinstance(goal, str) else goal for goal in as_list(given)]
        if not goals:
            return NOTHING
        if not self._client.wait_for_executor(EXECUTOR_WAIT, self.preempt_requested):
            missing = f"no executor within {EXECUTOR_WAIT:g} s"
            return PREEMPTED if self.preempt_requested() else self.fail(missing)
        try:
            options = with_ros_times(self._options)
        except ValueError as error:
            return self.fail(str(error))
        again = True
        while again:
            self.interruptible(self._pause.wake)
            self._pause.wait(self.preempt_requested)
            self.interruptible(None)
            if self.preempt_requested():
                return PREEMPTED
            given_up = threading.Event()
            self.interruptible(given_up.set)
            try:
                request = self._client.send(goals, given_up=given_up, **options)
            except (ValueError, PDDLSyntaxError, ServiceError) as error:
                self.interruptible(None)
                return PREEMPTED if self.preempt_requested() else self.fail(str(error))
            self.interruptible(request.leave)
            request.wait()
            self.interruptible(self._pause.wake)
            again = self._pause.again(request, self.preempt_requested)
            self.interruptible(None)
        return self._outcome(userdata, request)

    def _outcome(self, userdata: Any, request: ExecutorRequest) -> str:
        result = request.result
        if result is None:
            return self.fail("the mission's node shuts down")
        userdata.outcome = outcome_name(result.outcome)
        self.reason = result.reason
        if result.outcome in ACHIEVED or self._pause.skips(request):
            return SUCCEEDED
        if result.outcome == ExecuteResult.CANCELLED and self.preempt_requested():
            return PREEMPTED
        if result.outcome == ExecuteResult.CANCEL_TIMEOUT:
            self.unstopped = "what the Executor has cancelled"
        return self.fail(f"{outcome_text(result)}: {result.reason}")


def outcome_text(result: ExecuteResult) -> str:
    """An outcome in plain words."""
    return outcome_name(result.outcome).lower().replace("_", " ")


MerlinStateFactory.register("goals", GoalState)
