# SPDX-License-Identifier: Apache-2.0
"""Sends requests that may run together, with times; cancels them, changes facts, kills the Executor."""

import contextlib
import os
import random
import signal
import time
from typing import Counter, Dict, List, Sequence, Set

import rosgraph
import rospy
from merlin_msgs.msg import ExecutorStatus, GoalQueue

from merlin_executor.executor_client import GO_ON, ExecutorRequest, outcome_name
from stress.cancel_stress import LIMIT, CancelStress
from stress.process_usage import pid_of
from stress.stress_cycles import CycleTimes, Violation, draw_joint, untrue

EXECUTOR = "/merlin_executor"


class JoinedStress(CancelStress):
    """One robot under stress by several requests. Needs an initialised node.

    Each has to end, for a reason of its own, and with what is true; then the robot is as after one request.

    :param kills: share of cycles in which the Executor dies; its launch starts it again.
    """

    def __init__(self, goals: Sequence[str], seed: int = 0, longest: float = 0.4, kills: float = 0.0) -> None:
        self._kills = kills
        self.killed = 0
        self._waiting = 0
        self._together: Set[str] = set()  # ids of all that have run with others
        self.outcomes: Counter[str] = Counter()
        super().__init__(goals, seed, longest=longest)
        self._chance = random.Random(f"joined {seed}")
        rospy.Subscriber("merlin/queue", GoalQueue, self._receive_queue, tcp_nodelay=True)

    @property
    def together(self) -> int:
        """How many requests have run with others."""
        with self._changed:
            return len(self._together)

    def _cycle(self) -> CycleTimes:
        self._knowledge.remove_facts(self._goals)
        drawn = draw_joint(self._chance, self._goals, self._longest, self._kills)
        sent: List[ExecutorRequest] = []
        cancelled: Set[int] = set()
        victim = 0
        for deed in drawn.deeds:
            self._let_pass(deed.pause)
            if deed.do == "send":
                # This client may lack a processor for as long as one that is dead is waited for.
                sent.append(self._client.send(**drawn.requests[deed.request], on_client_lost=GO_ON))
            elif deed.do == "cancel":
                cancelled.add(deed.request)
                sent[deed.request].cancel()
            elif deed.do == "kill":
                victim = pid_of(EXECUTOR)
                os.kill(victim, signal.SIGKILL)
                self.killed += 1
            else:
                self._knowledge.add_facts(drawn.requests[deed.request]["goals"])
        for request in sent:
            self._wait_for_end(request)
        if victim:
            self._wait_for_successor(victim)
        self._wait("an idle executor and an empty queue", lambda: self._idle() and not self._waiting)
        facts = self._knowledge.facts("checked")
        for number, request in enumerate(sent):
            if request.result is None:
                raise Violation(f"{request.id} has ended without a result")
            outcome = outcome_name(request.result.outcome)
            self.outcomes[outcome] += 1
            options: Dict[str, object] = dict(drawn.requests[number])
            reason, taken_back = request.result.reason, number in cancelled
            wrong = untrue(outcome, reason, options, taken_back, facts, bool(victim))
            if wrong:
                raise Violation(wrong)
        return CycleTimes(None, None, None, None, "")

    def _wait_for_successor(self, victim: int) -> None:
        end = time.monotonic() + LIMIT
        while time.monotonic() < end:
            with contextlib.suppress(OSError, rosgraph.MasterException):  # it is not back yet
                if pid_of(EXECUTOR) != victim and self._client.wait_for_executor(LIMIT):
                    return
            time.sleep(0.1)
        raise Violation(f"the Executor is not back {LIMIT:g} s after the end of all")

    def _receive_status(self, status: ExecutorStatus) -> None:
        super()._receive_status(status)
        with self._changed:
            if status.together:
                self._together |= {status.request, *(each.request for each in status.together)}

    def _receive_queue(self, queue: GoalQueue) -> None:
        with self._changed:
            self._waiting = len(queue.requests)
            self._changed.notify_all()
