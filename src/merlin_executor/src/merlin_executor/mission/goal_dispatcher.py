# SPDX-License-Identifier: Apache-2.0
"""The Goal Dispatcher, the mission layer's component: as a plain node or as a state machine (paper, 3.2.2).

.. code-block:: python

    class Round(GoalDispatcher):                       # a plain node
        servers = ("move_base", "sound_play")          # what the actions use

        def run(self):
            for poi in ("kitchen", "bathroom"):
                self.achieve(f"(checked {poi})")

    class Evening(MissionSM):                          # a state machine: each state sends its goals
        def build(self):
            self.add_goal_state("KITCHEN", "(checked kitchen)", {"succeeded": "DOOR"})
            self.add_goal_state("DOOR", ["(checked main_door)"])

``rosrun merlin_executor mission mission:=package.module:Round`` runs one as a node.
"""

import threading
from abc import abstractmethod
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Union

import rospy
from merlin_msgs.msg import ExecuteResult, MissionStatus
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_executor.executor_client import Goals, MerlinExecutorClient, as_list
from merlin_executor.executor_request import ExecutorRequest
from merlin_executor.mission.goal_state import ACHIEVED, EXECUTOR_WAIT, GoalState, outcome_text
from merlin_executor.mission.mission_node import MissionNode
from merlin_executor.mission.mission_pause import WAIT, MissionPause
from merlin_executor.mission.mission_reporter import MissionReporter
from merlin_executor.request_times import check_timeout, with_ros_times
from merlin_executor.resending import RESEND
from merlin_planning.knowledge_client import KnowledgeError
from merlin_planning.knowledge_text import to_pddl
from merlin_ros.ros_alarm import call_after
from merlin_ros.work.threads import failure_text
from merlin_sm.holding.node_holds import node_holds
from merlin_sm.holding.state_hook import hook_states
from merlin_sm.introspection import start_introspection
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED

_FINAL = {SUCCEEDED: MissionStatus.SUCCEEDED, PREEMPTED: MissionStatus.CANCELLED}


class MissionFailed(RuntimeError):
    """A goal of a mission was not achieved; the text says why, `result` is the Executor's."""

    def __init__(self, text: str, result: Optional[ExecuteResult] = None) -> None:
        super().__init__(text)
        self.result = result

    @property
    def was_cancelled(self) -> bool:
        """True when the goal was cancelled: after its timeout, or with the mission."""
        return self.result is not None and self.result.outcome == ExecuteResult.CANCELLED


class GoalDispatcher(MissionNode):
    """A mission as a plain node. A subclass implements :meth:`run`; :meth:`execute` runs it.

    :param name: of the mission; the class name when empty.
    :param tasks: number of goals, for the status; 0: not known.
    :param on_lost: RESEND: a goal during which the Executor is lost, or this process was silent, is sent
        again, a knowledge base that is away is waited for; END: the mission ends with the reason.
    :param on_cancel: what :meth:`achieve` does when an operator stops the robot or cancels its goals: WAIT
        until he releases the base or resumes the mission, and send them again; SKIP them; END the mission.
    :raises ValueError: for another word.
    """

    def __init__(self, name: str = "", tasks: int = 0, on_lost: str = RESEND, on_cancel: str = WAIT) -> None:
        self.name = name or type(self).__name__
        self.client = MerlinExecutorClient(on_lost=on_lost, on_send=self._report)
        self.reporter = MissionReporter(self.name, tasks)
        self._pause = MissionPause(self.reporter.paused, on_cancel)
        self._cancelled = threading.Event()

    @property
    def cancelled(self) -> bool:
        """True after :meth:`cancel`."""
        return self._cancelled.is_set()

    @abstractmethod
    def run(self) -> None:
        """Sends the goals.

        :raises MissionFailed: when the mission has failed.
        """

    def carry_out(self) -> bool:
        """Runs the mission; True when it succeeded."""
        return self.execute()

    def execute(self) -> bool:
        """Runs the mission and reports its end; True when it succeeded.

        A goal that was not achieved, goals that are wrong and a knowledge base that refuses a change or does
        not answer are a failure of the mission. Any other error of :meth:`run` is reported and raised.
        """
        rospy.on_shutdown(self.cancel)
        try:
            if not self.client.wait_for_executor(EXECUTOR_WAIT, self._cancelled.is_set):
                missing = f"no executor within {EXECUTOR_WAIT:g} s"
                raise MissionFailed("cancelled before it began" if self.cancelled else missing)
            with self._pause:
                self.run()
        except (
            MissionFailed,
            ValueError,
            KnowledgeError,
            rospy.ServiceException,
            rospy.ROSInterruptException,
        ) as error:
            state = MissionStatus.CANCELLED if self.cancelled else MissionStatus.FAILED
            self.reporter.report(state, str(error))
            rospy.logerr(f"mission {self.name}: {error}")
            return False
        except Exception as error:  # of the mission's own code: published before the node ends
            self.reporter.report(MissionStatus.FAILED, failure_text(error))
            raise
        if self.cancelled:
            self.reporter.report(MissionStatus.CANCELLED, "cancelled")
            return False
        self.reporter.report(MissionStatus.SUCCEEDED, "done")
        return True

    def achieve(self, goals: Goals, timeout: Optional[float] = None, **options: Any) -> ExecuteResult:
        """Sends goals and waits until they hold.

        :param timeout: s of ROS time, after which they are cancelled; None: as long as it takes.
        :param options: priority, on_interrupt, deadline, alone, … of :meth:`MerlinExecutorClient.send`.
        :return: the Executor's result; CANCELLED for goals that an operator has cancelled, with SKIP.
        :raises MissionFailed: when they do not.
        :raises ValueError: for a `timeout` that is not a number above 0, and as :meth:`send`.
        """
        check_timeout(timeout)
        options = with_ros_times(options)
        again = True
        while again:
            self._pause.wait(self._cancelled.is_set)
            request = self.send(goals, **options)
            text = _text(goals)
            patience = None if timeout is None else call_after(timeout, request.cancel, f"timeout of {text}")
            request.wait()
            if patience is not None:
                patience.shutdown()
            again = self._pause.again(request, self._cancelled.is_set)
        result = request.result
        if result is not None and self._pause.skips(request):
            return result
        if result is None or result.outcome not in ACHIEVED:
            reason = f"{outcome_text(result)}: {result.reason}" if result else "the node shuts down"
            raise MissionFailed(f"{text}: {reason}", result)
        return result

    def send(self, goals: Goals, **options: Any) -> ExecutorRequest:
        """Sends goals and returns at once; a cancel of the mission takes them back.

        Parameters and errors as of :meth:`MerlinExecutorClient.send`.

        :raises MissionFailed: after a cancel of the mission.
        """
        self._refuse_cancelled(goals)
        request = self.client.send(goals, given_up=self._cancelled, **options)
        if self.cancelled:  # meanwhile: cancel() may not have seen the request
            request.leave()
        return request

    def _refuse_cancelled(self, goals: Goals) -> None:
        if self.cancelled:
            raise MissionFailed(f"{_text(goals)}: not sent, the mission was cancelled")

    def _report(self, goals: Sequence[str]) -> None:
        self._refuse_cancelled(goals)  # also those that a mission sends by the client itself
        self.reporter.task(" ".join(goals))

    def cancel(self) -> None:
        """Cancels the mission: all goals that it has sent stop, but those that survive go on without it.

        :meth:`send` sends no further ones.
        """
        self._cancelled.set()
        self._pause.wake()
        self.client.cancel_all()


class MissionSM(MissionNode, MerlinSM):
    """A mission as a state machine, ``/MISSION_<NAME>`` in smach_viewer; a subclass adds states in build().

    Outcomes: succeeded, aborted, preempted.

    :param name: of the mission; the class name when empty.
    :param on_lost, on_cancel: as of :class:`GoalDispatcher`, of its goal states.
    """

    def __init__(self, name: str = "", on_lost: str = RESEND, on_cancel: str = WAIT) -> None:
        super().__init__([SUCCEEDED, ABORTED, PREEMPTED])
        self.name = name or type(self).__name__
        self.client = MerlinExecutorClient(on_lost=on_lost)
        self._pause = MissionPause(lambda paused: self.reporter.paused(paused), on_cancel)
        with self:
            self.build()
        self.reporter = MissionReporter(self.name, len(self.get_children()))
        self.register_start_cb(self._report)
        self.register_transition_cb(self._report)
        self._label = f"MISSION_{self.name.upper()}"
        hook_states(self, self._label, node_holds.outcomes)

    @abstractmethod
    def build(self) -> None:
        """Adds the states; the machine is open for construction."""

    def add_goal_state(
        self,
        label: str,
        goals: Union[Goals, Callable[[Any], Goals]],
        transitions: Optional[Dict[str, str]] = None,
        autonomy: Optional[Mapping[str, str]] = None,
        **options: Any,
    ) -> GoalState:
        """Adds a state that sends goals, unless the mission is paused.

        :param autonomy: as of :meth:`merlin_sm.merlin_sm.MerlinSM.add`.
        :param options: of :class:`GoalState`.
        """
        state = GoalState(goals, client=self.client, pause=self._pause, **options)
        self.add(label, state, transitions=transitions, autonomy=autonomy)
        return state

    def carry_out(self) -> bool:
        """Runs the machine and logs why it failed; True when it succeeded."""
        outcome = self.run()
        if outcome != SUCCEEDED:
            rospy.logerr(f"mission {self.name}: {self.reason or outcome}")
        return outcome == SUCCEEDED

    def run(self) -> str:
        """Shows the machine to smach_viewer, runs it and reports its end; returns its outcome."""
        server = start_introspection(self._label, self)
        rospy.on_shutdown(self.cancel)  # also before the run has begun
        try:
            node_holds.offer()
            with self._pause:
                outcome = str(self.execute())
        except Exception as error:  # of a state's own code
            self.reporter.report(MissionStatus.FAILED, failure_text(error))
            raise
        finally:
            server.stop()
        self.reporter.report(_FINAL.get(outcome, MissionStatus.FAILED), self.reason or outcome)
        return outcome

    def _report(self, userdata: Any, states: List[str]) -> None:
        self.reporter.task(", ".join(states))


def _text(goals: Goals) -> str:
    return " ".join(
        to_pddl(goal) if isinstance(goal, KnowledgeItem) else str(goal) for goal in as_list(goals)
    )
