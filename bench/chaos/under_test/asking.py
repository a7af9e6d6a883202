# SPDX-License-Identifier: Apache-2.0
"""What the witness asks in a trial: does the stop answer, does every node."""

import contextlib
import threading
import time
from typing import Any, Callable, Dict, List

import rosgraph
import rospy
from std_srvs.srv import TriggerResponse

from chaos.judging import events
from chaos.under_test.child import Reporter
from chaos.under_test.tcpros import Service, Ticks, Unanswered, ask_api

#: s that an answer is waited for: longer than it may take, so that it is measured.
STOP_WATCH, ANSWER_WATCH = 5.0, 2.0
#: s for the master to say where something is.
MASTER_WATCH = 2.0
#: s in which the base is released again.
RELEASE_LIMIT = 10.0
#: s between two attempts.
RETRY = 0.2


class Asking:
    """Carries out the commands: locate (services), stop (service, release), probe (nodes, limit).

    Each runs in a thread of its own.
    """

    def __init__(self, report: Reporter) -> None:
        self._report = report
        self._places: Dict[str, str] = {}  # the last known ones; written by one command at a time
        self._master = rosgraph.get_master_uri()

    def obey(self, do: str, **arguments: Any) -> None:
        """Begins with a command."""
        command: Callable[..., None] = getattr(self, f"_{do}")
        threading.Thread(target=command, kwargs=arguments, name=do, daemon=True).start()

    def _locate(self, services: List[str]) -> None:
        """Learns where services are, while the master surely lives."""
        for name in services:
            self._place(rospy.resolve_name(name))

    def _stop(self, service: str, release: str) -> None:
        name = rospy.resolve_name(service)
        place = self._place(name)
        ticks, begin, error = Ticks(STOP_WATCH), time.monotonic(), ""
        try:
            answer = self._trigger(Service(name, place), ticks)
            error = "" if answer.success else answer.message
        except Unanswered as unanswered:
            error = str(unanswered)
        self._report(events.STOPPED, error=error, ticks=ticks.spent, asked=begin)
        self._until_released(rospy.resolve_name(release))

    def _until_released(self, name: str) -> None:
        end, error = time.monotonic() + RELEASE_LIMIT, "never asked"
        while error and time.monotonic() < end:
            try:
                answer = self._trigger(Service(name, self._place(name)), Ticks(ANSWER_WATCH))
                error = "" if answer.success else answer.message
            except Unanswered as unanswered:
                error = str(unanswered)
            time.sleep(RETRY if error else 0.0)
        self._report(events.RELEASED, error=error)

    def _probe(self, nodes: List[str], limit: float) -> None:
        """Whether each node answers at both of its ports, within a limit in s."""
        for node in nodes:
            threading.Thread(target=self._probe_one, args=(node, limit), name=node, daemon=True).start()

    def _probe_one(self, node: str, limit: float) -> None:
        end = time.monotonic() + limit
        while True:
            error = self._why_deaf(rospy.resolve_name(node))
            if not error or time.monotonic() > end:
                self._report(events.PROBED, node=node, error=error)
                return
            time.sleep(RETRY)  # it may be on its way back

    def _why_deaf(self, node: str) -> str:
        try:
            api = ask_api(self._master, MASTER_WATCH, "lookupNode", node)
            ask_api(api, ANSWER_WATCH, "getPid")
            name = f"{node}/get_loggers"
            place = ask_api(self._master, MASTER_WATCH, "lookupService", name)
            Service(name, place).ask(Ticks(ANSWER_WATCH))
        except Unanswered as unanswered:
            return str(unanswered)
        return ""

    def _place(self, name: str) -> str:
        """Where a service is now, or was when it was asked for last; empty: never known."""
        # A master that hangs does not keep a known service from answering.
        with contextlib.suppress(Unanswered):
            self._places[name] = ask_api(self._master, MASTER_WATCH, "lookupService", name)
        return self._places.get(name, "")

    @staticmethod
    def _trigger(service: Service, ticks: Ticks) -> TriggerResponse:
        answer = TriggerResponse()
        answer.deserialize(service.ask(ticks))
        return answer
