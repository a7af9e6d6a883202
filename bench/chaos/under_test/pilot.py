# SPDX-License-Identifier: Apache-2.0
"""Process: the robot's client in a campaign. It sends requests, cancels them, and looks what the robot knows.

Commands are lines of JSON with `do`: ready (servers), send (label, goals, deadline), cancel (label), prepare
(add, remove), look (number, said), why (goal), write (facts), and those of :mod:`.stranger`. Each runs in a
thread of its own, so that one that gets no answer does not hold up the others.
"""

import os
import sys
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import rospy
from merlin_msgs.srv import Explain, ExplainRequest

from chaos.judging import events
from chaos.under_test.child import Reporter, commands
from chaos.under_test.stranger import Stranger
from merlin_executor.executor_client import ExecutorRequest, MerlinExecutorClient, outcome_name
from merlin_executor.mission.readiness import missing_interfaces, missing_servers
from merlin_planning.knowledge_client import KnowledgeError, knowledge_client
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

#: s for a system to be up.
READY_LIMIT = 60.0
#: s within which the knowledge base has to answer, a respawn included.
ANSWER_LIMIT = 10.0
#: s between two attempts to reach a knowledge base that is being started.
RETRY = 0.1
#: s for an answer to why a request failed.
WHY_LIMIT = 15.0


class Pilot(Stranger):
    """Carries out commands and reports events."""

    def __init__(self, report: Reporter) -> None:
        super().__init__(report)
        self._client = MerlinExecutorClient(knowledge_base=None)
        self._knowledge = MerlinROSPlanAssistant()
        self._explain = ServiceProxy("merlin/explain", Explain, timeout=ANSWER_LIMIT)
        self._lock = threading.Lock()  # guards _requests
        self._requests: Dict[str, ExecutorRequest] = {}

    def obey(self, do: str, **arguments: Any) -> None:
        """Runs a command in a thread of its own."""
        command: Callable[..., None] = getattr(self, f"_{do}")
        threading.Thread(target=self._run, args=(do, command, arguments), name=do, daemon=True).start()

    def _run(self, do: str, command: Callable[..., None], arguments: Dict[str, Any]) -> None:
        try:
            command(**arguments)
        except Exception as error:  # noqa: B902 - whatever it is, the campaign has to hear of it
            self._report("failed", do=do, error=f"{type(error).__name__}: {error}")

    def _ready(self, servers: List[str]) -> None:
        # This client polls at start-up only; ROS has no event for a new service.
        end = time.monotonic() + READY_LIMIT
        missing = ["the executor"] if not self._client.wait_for_executor(READY_LIMIT) else []
        if not missing:
            missing += missing_interfaces(knowledge_client(), max(1.0, end - time.monotonic()))
            missing += missing_servers(servers, max(1.0, end - time.monotonic()))
        self._report("ready", missing=missing)

    def _send(self, label: str, goals: List[str], deadline: Optional[float] = None) -> None:
        self._client.wait_for_executor(READY_LIMIT)
        request = self._client.send(goals, deadline=deadline, on_done=lambda ended: self._ended(label, ended))
        with self._lock:
            self._requests[label] = request
        self._report(events.SENT, label=label, goals=[goal[:60] for goal in goals], deadline=deadline)

    def _cancel(self, label: str) -> None:
        with self._lock:
            request = self._requests.get(label)
        if request is not None:
            self._report(events.CANCEL, label=label)
            request.cancel()

    def _ended(self, label: str, request: ExecutorRequest) -> None:
        result = request.result
        self._report(
            events.ENDED,
            label=label,
            outcome=outcome_name(result.outcome) if result else "no result",
            reason=result.reason if result else "",
            action=result.action if result else "",
            state=request.state,
        )

    def _prepare(self, add: List[str], remove: List[str]) -> None:
        self._knowledge.change_facts(add=add, remove=remove)
        self._report("prepared", add=add, remove=remove)

    def _look(self, number: int, said: bool) -> None:
        end = time.monotonic() + ANSWER_LIMIT
        while True:
            try:
                self._report(
                    events.FACTS,
                    look=number,
                    robot_at=self._knowledge.facts("robot_at"),
                    notes=self._knowledge.facts("noted"),
                    goals=self._knowledge.goals(),
                    **({"said": self._knowledge.facts("said")} if said else {}),
                )
                return
            except (ServiceError, KnowledgeError, rospy.ROSException) as error:
                if time.monotonic() > end:
                    self._report(events.FACTS, look=number, error=str(error))
                    return
            time.sleep(RETRY)

    def _why(self, goal: str) -> None:
        """Why a request failed; what explains it, and what it records, may be on its way back."""
        end = time.monotonic() + WHY_LIMIT
        while True:
            try:
                answer = self._explain(question=ExplainRequest.FAILED, about=goal)
                error = "" if answer.ok else answer.sentence
            except ServiceError as refused:
                error = str(refused)
            if not error or time.monotonic() > end:
                self._report(events.WHY, sentence="" if error else answer.sentence, error=error)
                return
            time.sleep(RETRY)

    def _write(self, facts: List[str]) -> None:
        """One fact after the other, until one is refused."""
        for fact in facts:
            error = ""
            try:
                self._knowledge.change_facts(add=[fact])
            except (ServiceError, KnowledgeError, rospy.ROSException) as refused:
                error = str(refused)
            self._report(events.WRITTEN, fact=fact, error=error)
            if error:
                return


def main() -> int:
    """Runs until the input is closed; returns the exit code."""
    report = Reporter()
    rospy.init_node(f"chaos_client_{os.getpid()}", disable_signals=True)
    pilot = Pilot(report)
    report("up")
    for command in commands(sys.stdin):
        pilot.obey(**command)
    os._exit(0)  # a shutdown would ask a master that may be dead


if __name__ == "__main__":
    main()
