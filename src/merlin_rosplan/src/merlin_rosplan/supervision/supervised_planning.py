# SPDX-License-Identifier: Apache-2.0
"""A planning as a node sees it: started, cancelled from any thread, and with a result."""

import dataclasses
import os
import threading
import time
from typing import Callable, Optional

from merlin_rosplan.planning.planner_command import PlannerCommandError
from merlin_rosplan.planning.planner_engines import engines
from merlin_rosplan.planning.planner_kairos import KAIROS
from merlin_rosplan.planning.planner_settings import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState, PlanningOutcome
from merlin_rosplan.supervision.planner_host import HOSTS, HostError, PlannerHost, PlannerHosts
from merlin_rosplan.supervision.planner_job import PlannerJob

#: s of running time, beyond the planner's, for reading and validating what it left
READING = 5.0
#: s of running time, beyond both, after which the supervising process counts as hung; it ends what it has
#: started within some seconds
HANGS = 10.0


class Planning:
    """One planning of one problem. :meth:`cancel` ends it from any thread.

    :param settings: how.
    :param domain_path, problem_path: PDDL files.
    :param data_path: folder for the planner's output and the plan (``plan.pddl``); None keeps nothing.
    :param hosts: the supervising processes that may be used.
    """

    def __init__(
        self,
        settings: PlannerSettings,
        domain_path: str,
        problem_path: str,
        data_path: Optional[str] = None,
        hosts: Optional[PlannerHosts] = None,
    ) -> None:
        self._settings = settings
        # Texts and no pathlib: that enters each part of a path into Python's table of names, which grows by
        # half a megabyte in a node that plans often.
        self._domain = _absolute(domain_path)
        self._problem = _absolute(problem_path)
        self._data = _absolute(data_path) if data_path else ""
        self._hosts = hosts or HOSTS
        self._lock = threading.Lock()  # guards the two fields below
        self._cancelled = False
        self._host: Optional[PlannerHost] = None
        self.warning: Optional[str] = None

    def cancel(self) -> None:
        """Ends the planner and everything it has started; :meth:`run` then returns CANCELLED."""
        with self._lock:
            self._cancelled = True
            if self._host is not None:
                self._host.cancel()

    def run(self, on_begin: Callable[[], None] = lambda: None) -> PlanningOutcome:
        """Plans and says how it ended; raises nothing.

        :param on_begin: called once the planner works; not when it cannot begin.
        """
        began = time.monotonic()
        try:
            outcome = self._run(on_begin)
        except PlannerCommandError as error:
            outcome = PlanningOutcome(PlannerState.CRASHED, str(error))
        except HostError as error:
            state = PlannerState.CANCELLED if self._cancelled else PlannerState.CRASHED
            outcome = PlanningOutcome(state, str(error))
        return dataclasses.replace(outcome, seconds=time.monotonic() - began)

    def _run(self, on_begin: Callable[[], None]) -> PlanningOutcome:
        for path in (self._domain, self._problem):
            if "\0" in path:
                return PlanningOutcome(
                    PlannerState.INVALID, f"cannot read {path!r}: the path has a null byte"
                )
        settings = self._settings
        chosen = engines(settings.command, settings.fallback)
        self.warning = chosen.warning
        limit = settings.time_limit
        if chosen.limit is not None:
            limit = chosen.limit if len(chosen.commands) == 1 else max(limit, chosen.limit)
        job = PlannerJob(
            self._domain,
            self._problem,
            chosen.commands,
            chosen.name,
            self._data,
            dataclasses.replace(settings, time_limit=limit),
            limit + READING if limit else 0.0,
            KAIROS not in chosen.commands,
        )
        host = self._hosts.take()
        try:
            with self._lock:
                if self._cancelled:
                    return PlanningOutcome(PlannerState.CANCELLED, "cancelled before it began")
                host.begin(job.message())
                self._host = host
            on_begin()
            answer = host.wait(job.time_limit + HANGS if job.time_limit else None)
        finally:
            with self._lock:
                self._host = None
            self._hosts.give_back(host)
        if self._cancelled:
            reason = answer["reason"] if answer["state"] == PlannerState.CANCELLED else "cancelled at the end"
            return PlanningOutcome(PlannerState.CANCELLED, reason, "", chosen.name)
        self.warning = answer.get("warning") or self.warning
        return PlanningOutcome(
            PlannerState(answer["state"]),
            answer["reason"],
            answer.get("plan", ""),
            answer.get("planner") or chosen.name,
            reached=tuple(answer.get("reached", ())),
        )


def _absolute(path: str) -> str:
    """An absolute path as it is: the folder in which the node was started may have been removed."""
    return path if os.path.isabs(path) else os.path.join(os.getcwd(), path)
