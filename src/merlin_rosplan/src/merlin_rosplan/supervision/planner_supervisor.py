# SPDX-License-Identifier: Apache-2.0
"""The supervising process: runs one planning at a time and ends whatever a planning has started.

It is a child of a node (:class:`.planner_host.PlannerHost`) and serves it until the socket closes, which it
does also when the node is killed. Lines of JSON come and go:

==============================  ==========================================================================
``{"job": 3, ...}``             plan; the keys are those of :class:`.planner_job.PlannerJob`
``{"cancel": 3}``               end it
``{"job": 3, "state": ...}``    how it ended, sent when all processes that it has started have ended
==============================  ==========================================================================

A planning runs in a forked child: reading, checking and validating never keep this process from a cancel. The
child of the next planning waits in advance, so that no request pays for the fork. A child that has called a
command waits for the next planning, unless something of the command is left.
"""

import contextlib
import gc
import json
import os
import resource
import select
import shutil
import signal
import socket
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

from merlin_ros.processes.child_process import parent
from merlin_ros.processes.process_priority import lower_priority
from merlin_ros.processes.process_tree import adopt_orphans, descendants, end_descendants, tree_size
from merlin_ros.work.threads import start_thread
from merlin_rosplan.planning.planner_files import MEGABYTE, too_much
from merlin_rosplan.planning.planning_outcome import PlannerState

#: s between two looks at memory and files of a planning; cancel and end are events and do not wait for it
WATCH = 0.25
#: s within which everything has ended after SIGKILL
ENDING = 5.0
#: s without a request after which the next child is made: not while the plan is being parsed and dispatched
IDLE = 0.1
#: plannings of one child, at the most
MOST = 50
#: Tries to remove a folder, at the most
REMOVALS = 1000
OUTCOME = "outcome.json"
DONE = b"!"

# The socket alone says when to end: a signal to the whole group of the node must not leave a planner behind.
_IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

Answer = Dict[str, Any]
Work = Callable[[Answer, Path], Answer]


class _Child(NamedTuple):
    """A child that waits for its job.

    :param folder: for that job.
    :param line: takes the job and says when it is done.
    :param life: closes with this process.
    :param used: its plannings so far.
    :param limits: of these; None: there were none.
    """

    pid: int
    folder: str
    line: socket.socket
    life: socket.socket
    used: int = 0
    limits: Optional[Tuple[float, float]] = None


class Supervisor:
    """Serves plannings on a socket.

    :param channel: to the node.
    :param work: does one planning in the forked child: the job and its folder → the outcome.
    :param warm_up: called in a child that waits for its job, with its folder and the last job.
    """

    def __init__(
        self, channel: socket.socket, work: Work, warm_up: Callable[[Path, Answer], None] = lambda *_: None
    ) -> None:
        self._channel = channel
        self._work = work
        self._warm_up = warm_up
        self._next: Optional[_Child] = None
        self._last: Answer = {}
        self._done = False  # whether the child that works has written its outcome
        self._received = b""
        self._lines: List[Answer] = []
        self._wake, wakes = os.pipe()
        os.set_blocking(wakes, False)
        os.set_blocking(self._wake, False)
        signal.set_wakeup_fd(wakes, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda *_: None)  # only to be woken
        self._poll = select.poll()
        self._poll.register(channel, select.POLLIN)
        self._poll.register(self._wake, select.POLLIN)

    def serve(self) -> None:
        """Runs jobs until the other end of the socket closes."""
        with contextlib.suppress(EOFError, OSError):
            while True:
                while not self._lines:
                    self._receive(IDLE if self._next is None else None)
                    if self._next is None and not self._lines:
                        self._next = self._fork(warm_up=True)
                line = self._lines.pop(0)
                if "job" in line:  # a cancel of what has just ended is left alone
                    if self._next is not None and self._next.limits not in (None, _limits(line)):
                        self.close()
                    # A job that is there already warms itself up.
                    child = self._next or self._fork(warm_up=False)
                    self._next, self._last = None, line
                    clean = False
                    try:
                        answer, clean = self._run(line, child)
                        self._channel.sendall(json.dumps({**answer, "job": line["job"]}).encode() + b"\n")
                    finally:  # behind the answer: a process and large files take their time to go
                        self._next = child
                        if clean and line["reusable"] and child.used < MOST - 1:
                            shutil.rmtree(child.folder, ignore_errors=True)
                            self._next = child._replace(
                                folder=tempfile.mkdtemp(prefix="planner-"),
                                used=child.used + 1,
                                limits=_limits(line),
                            )
                        else:
                            self.close()

    def _receive(self, seconds: Optional[float]) -> None:
        """Waits for a line, the end of a child, or the time.

        :raises EOFError: the node has gone.
        """
        for descriptor, _ in self._poll.poll(None if seconds is None else seconds * 1000.0):
            if descriptor == self._wake:
                with contextlib.suppress(BlockingIOError):
                    os.read(self._wake, 4096)
                continue
            if descriptor != self._channel.fileno():  # the child's
                self._poll.unregister(descriptor)
                self._done = os.read(descriptor, 1) == DONE
                continue
            received = self._channel.recv(65536)
            if not received:
                raise EOFError
            *lines, self._received = (self._received + received).split(b"\n")
            self._lines.extend(json.loads(line) for line in lines)

    def close(self) -> None:
        """Ends everything that was started, and the child that waits."""
        end_descendants(ENDING)
        if self._next is not None:
            self._next.line.close()
            self._next.life.close()
            shutil.rmtree(self._next.folder, ignore_errors=True)
            self._next = None

    def _fork(self, warm_up: bool) -> _Child:
        folder = tempfile.mkdtemp(prefix="planner-")
        (line, its_line), (life, its_life) = socket.socketpair(), socket.socketpair()
        pid = os.fork()
        if pid == 0:
            line.close()
            life.close()
            self._plan(its_line, its_life, Path(folder), warm_up)  # does not return
        its_line.close()
        its_life.close()
        return _Child(pid, folder, line, life)

    def _run(self, job: Answer, child: _Child) -> Tuple[Answer, bool]:
        """A planning: how it ended, and whether nothing of it is left but a child that can plan again."""
        folder = Path(child.folder)
        try:
            with contextlib.suppress(OSError):  # the planning itself says it
                folder.mkdir(mode=0o700, exist_ok=True)  # the folder of temporary files may have been emptied
            with contextlib.suppress(OSError):  # it has died; its status says how
                child.line.sendall(json.dumps({**job, "folder": child.folder}).encode() + b"\n")
            self._done = False
            self._poll.register(child.line, select.POLLIN)
            fault, status = self._watch(job, child.pid, folder)
            ended = status is None or end_descendants(ENDING)
            if not ended and fault is not None:
                fault["reason"] += f"; {tree_size(os.getpid()).processes} of its processes do not end"
            if fault is not None:
                return fault, False
            try:
                answer = dict(json.loads((folder / OUTCOME).read_text()))
                return answer, status is None and answer["state"] != PlannerState.CRASHED
            except (OSError, ValueError):
                reason = f"the planning ended without an outcome: {_end(status)}"
                return _answer(PlannerState.CRASHED, reason), False
        finally:
            with contextlib.suppress(KeyError):
                self._poll.unregister(child.line)

    def _watch(self, job: Answer, pid: int, folder: Path) -> Tuple[Optional[Answer], Optional[int]]:
        """Waits for the end of a planning.

        :return: what forced its end, if anything did, and its status; None: its outcome is there, and no
            process is left but its own, which waits.
        """
        began = time.monotonic()
        limit = float(job["time_limit"])
        look = began + WATCH
        while True:
            if self._done:
                return None, None if descendants(os.getpid()) == [pid] else 0
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                return None, status
            for line in self._lines:
                if line.get("cancel") == job["job"]:
                    seconds = time.monotonic() - began
                    return _answer(PlannerState.CANCELLED, f"cancelled after {seconds:.2f} s"), 0
            if time.monotonic() >= look:
                fault = _too_much(job, folder)
                if fault is not None:
                    return _answer(PlannerState.CRASHED, fault), 0
                if limit and time.monotonic() - began > limit:
                    reason = f"the planning did not end by itself within {limit:g} s"
                    return _answer(PlannerState.TIMEOUT, reason), 0
                look = time.monotonic() + WATCH
            self._receive(max(0.0, look - time.monotonic()))

    def _plan(self, line: socket.socket, life: socket.socket, folder: Path, warm_up: bool) -> None:
        """In the child: waits for jobs and does them, until this process ends it or ends itself."""
        try:
            signal.set_wakeup_fd(-1)
            for number in (signal.SIGCHLD, *_IGNORED):  # or every planner would ignore them too
                signal.signal(number, signal.SIG_DFL)
            self._channel.close()
            os.close(self._wake)
            gc.disable()  # it ends before anything could pile up
            folders = [folder]  # the last one is that of its job
            start_thread("end of the supervisor", _end_with_supervisor, life, folders)
            if warm_up:
                self._warm_up(folder, self._last)
            with line.makefile() as file:
                for text in file:
                    job = json.loads(text)
                    folders.append(Path(job["folder"]))
                    self._plan_one(job, folders[-1])
                    with contextlib.suppress(OSError):
                        line.sendall(DONE)
            _remove(folders[-1])  # the supervising process was killed
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
            os._exit(1)
        os._exit(0)

    def _plan_one(self, job: Answer, folder: Path) -> None:
        """In the child: plans within the limits and writes the outcome."""
        memory, output = _limits(job)
        _limit(resource.RLIMIT_AS, memory)
        _limit(resource.RLIMIT_FSIZE, output)
        try:
            answer = self._work(job, folder)
        except MemoryError:
            reason = f"the planning needs more than {memory:g} MB of memory (~memory_limit)"
            answer = _answer(PlannerState.CRASHED, reason)
        (folder / OUTCOME).write_text(json.dumps(answer))


def _limits(job: Answer) -> Tuple[float, float]:
    """Limits that a child keeps: none can be raised again."""
    settings = job["settings"]
    return settings["memory_limit"], settings["output_limit"]


def _end_with_supervisor(life: socket.socket, folders: List[Path]) -> None:
    """In the child: ends it and what it has started when the supervising process is killed."""
    with contextlib.suppress(OSError):
        life.recv(1)  # nothing is sent: it returns when the other end closes
    end_descendants(ENDING)
    _remove(folders[-1])
    os._exit(1)


def _remove(folder: Path) -> None:
    """Removes a folder into which the other thread may write meanwhile."""
    for _ in range(REMOVALS):
        shutil.rmtree(str(folder), ignore_errors=True)
        if not folder.exists():
            return


def _answer(state: PlannerState, reason: str) -> Answer:
    return {"state": int(state), "reason": reason}


def _too_much(job: Answer, folder: Path) -> Optional[str]:
    memory, output = _limits(job)
    if memory and tree_size(os.getpid()).memory > memory * MEGABYTE:
        return f"{job['name']} and its processes use more than {memory:g} MB of memory (~memory_limit)"
    excess = too_much(folder, output)
    return f"{job['name']} was ended: {excess}" if excess is not None else None


def _limit(kind: int, megabytes: float) -> None:
    if megabytes:
        size = int(megabytes * MEGABYTE)
        hard = resource.getrlimit(kind)[1]
        if hard == resource.RLIM_INFINITY or size < hard:
            resource.setrlimit(kind, (size, size))


def _end(status: Optional[int]) -> str:
    if status is None:
        return "its outcome cannot be read"
    if os.WIFSIGNALED(status):
        return f"killed by signal {os.WTERMSIG(status)}"
    return f"code {os.WEXITSTATUS(status)}"


def main() -> None:
    """Entry point of the process; its argument is its nice value."""
    lower_priority(int(sys.argv[1]))
    adopt_orphans()
    for number in _IGNORED:
        signal.signal(number, signal.SIG_IGN)
    from merlin_pddl.checks import kairos_check
    from merlin_rosplan.supervision.planner_job import warm_up, work

    kairos_check.load()  # once for all plannings: they are forked from here
    gc.freeze()
    with parent() as channel:
        supervisor = Supervisor(channel, work, warm_up)
        try:
            supervisor.serve()
        finally:
            supervisor.close()
            os._exit(0)  # kairos' bindings print much at the end of an interpreter
