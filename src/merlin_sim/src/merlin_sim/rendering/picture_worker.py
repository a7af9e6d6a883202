# SPDX-License-Identifier: Apache-2.0
"""The simulator's end of the process that makes pictures (:mod:`merlin_sim.rendering.picture_process`)."""

import contextlib
import mmap
import os
import select
import socket
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from merlin_ros.processes.child_process import ChildProcess, receive, send
from merlin_sim.rendering.shot import PictureError, Shot

_MODULE = "merlin_sim.rendering.picture_process"
#: What the process is called in a list of processes.
NAME = "merlin_sim_pictures"
#: s of wall time without any progress while it starts, when it waits for a disk.
START_LIMIT = 30.0
#: Most processor time for a picture: s, and s per million pixels. Some thirty times as much as usual.
WORK_LIMIT, WORK_LIMIT_PER_MEGAPIXEL = 5.0, 10.0


class WorkerLost(PictureError):
    """The process has ended or does not answer."""


class _Activity(NamedTuple):
    """What a process has done so far; a hung one neither works nor waits for a processor."""

    worked: float
    """Processor time, s."""
    waited: int
    """Time for which its threads were ready to run and had no processor, ns."""


class PictureWorker:
    """A process that makes one picture at a time.

    To be made and closed in a thread that lives as long: the process ends with it.

    :raises WorkerLost: it cannot be started.
    """

    def __init__(self) -> None:
        try:
            with contextlib.ExitStack() as given_back:
                self._memory = os.memfd_create("pictures")
                given_back.callback(os.close, self._memory)
                words = (NAME, str(self._memory))
                self._process = ChildProcess(_MODULE, *words, descriptors=[self._memory])
                given_back.pop_all()  # it has begun: they are needed
        except OSError as error:
            raise WorkerLost(f"the process that makes pictures cannot be started: {error}") from error
        self._scene, self._known = -1, 0  # the scene that it has, and how many of its bodies
        self._ready = False

    @property
    def pid(self) -> int:
        """Process id of the worker."""
        return self._process.pid

    def expose(self, shot: Shot, limit: float) -> np.ndarray:
        """The picture of a shot: height x width x 3, RGB, 0..255.

        :param limit: s of wall time without an answer, any work or a wait for a processor, after which it
            counts as hung.
        :raises PictureError: the picture cannot be made.
        :raises WorkerLost: the process is no longer of use; close it.
        """
        known = self._known if shot.scene == self._scene else 0
        try:
            if not self._ready:
                problem = self._answer(START_LIMIT, WORK_LIMIT)
                if problem is not None:
                    raise WorkerLost(f"the process that makes pictures cannot start: {problem}")
                self._ready = True
            self._process.channel.settimeout(limit)
            send(self._process.channel, replace(shot, looks=shot.looks[known:]))
            pixels = shot.camera.model.width * shot.camera.model.height
            answer = self._answer(limit, WORK_LIMIT + WORK_LIMIT_PER_MEGAPIXEL * pixels / 1e6)
        except socket.timeout:
            raise WorkerLost("the process that makes pictures hangs") from None
        except (EOFError, OSError):
            raise WorkerLost("the process that makes pictures has ended") from None
        if isinstance(answer, str):
            self._scene = -1
            raise PictureError(f"the picture cannot be made: {answer}")
        self._scene, self._known = shot.scene, len(shot.looks)
        model = shot.camera.model
        with mmap.mmap(self._memory, answer, access=mmap.ACCESS_READ) as shared:
            return np.frombuffer(shared[:], dtype=np.uint8).reshape(model.height, model.width, 3)

    def _answer(self, limit: float, most: float) -> Any:
        """Waits for an answer as long as the process works for it: on a busy machine that may take its time.

        :param most: s of processor time.
        """
        poll = select.poll()
        poll.register(self._process.channel, select.POLLIN)
        began = before = self._activity()
        while not poll.poll(limit * 1000.0):
            now = self._activity()
            if now == before or now.worked - began.worked > most:
                raise socket.timeout
            before = now
        return receive(self._process.channel)

    def _activity(self) -> _Activity:
        process = Path(f"/proc/{self.pid}")
        waited = 0
        try:
            fields = (process / "stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
            for thread in (process / "task").iterdir():
                with contextlib.suppress(OSError):  # the thread has ended, or the kernel does not count it
                    waited += int((thread / "schedstat").read_text(encoding="ascii").split()[1])
        except OSError as error:
            raise EOFError from error
        return _Activity((int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"), waited)

    def interrupt(self) -> None:
        """Ends a wait for a picture, from another thread."""
        self._process.interrupt()

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        os.close(self._memory)
