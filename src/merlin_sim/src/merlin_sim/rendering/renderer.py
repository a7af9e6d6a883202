# SPDX-License-Identifier: Apache-2.0
"""Pictures that are made while the simulation continues, in the order in which they are asked for."""

import threading
from collections import deque
from concurrent.futures import Future
from typing import Callable, Deque, Optional, Tuple

import numpy as np

from merlin_ros.work.threads import start_thread
from merlin_sim.rendering.picture_worker import PictureWorker, WorkerLost
from merlin_sim.rendering.shot import PictureError, Shot

#: s of wall time without a picture or any processor time for it, after which a process counts as hung.
LIMIT = 5.0
#: Attempts at a picture, each in another process.
ATTEMPTS = 2


class Renderer:
    """One process for all cameras, started with the first picture. It ends with this one, however that ends.

    A process that has died or hangs is replaced, and the picture made by the next one.

    :param report: called with a sentence when a process was lost.
    :param limit: s of wall time without a picture or processor time, after which a process counts as hung.
    """

    def __init__(self, report: Callable[[str], None] = lambda _: None, limit: float = LIMIT) -> None:
        self._report = report
        self._limit = limit
        self._news = threading.Condition()  # guards what follows
        self._shots: Deque[Tuple[Shot, Future[np.ndarray]]] = deque()
        self._thread: Optional[threading.Thread] = None
        self._worker: Optional[PictureWorker] = None
        self._closed = False

    @property
    def pid(self) -> Optional[int]:
        """The process that makes the pictures; None: there is none at the moment."""
        with self._news:
            return self._worker.pid if self._worker else None

    def take(self, shot: Shot) -> "Future[np.ndarray]":
        """Has a picture made; the future gets height x width x 3, RGB, 0..255, or a PictureError."""
        future: Future[np.ndarray] = Future()
        with self._news:
            if not self._closed:
                if self._thread is None:
                    self._thread = start_thread("renderer", self._run)
                self._shots.append((shot, future))
                self._news.notify_all()
                return future
        future.set_exception(PictureError("the simulator ends"))
        return future

    def close(self) -> None:
        """Ends the process; pictures that are not made yet fail."""
        with self._news:
            self._closed = True
            self._news.notify_all()
            if self._worker is not None:
                self._worker.interrupt()
            thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join()

    def _run(self) -> None:
        # The process ends with the thread that has started it, so this one thread does all of it.
        while True:
            with self._news:
                self._news.wait_for(lambda: bool(self._shots) or self._closed)
                if self._closed:
                    break
                shot, future = self._shots.popleft()
            try:
                future.set_result(self._expose(shot))
            except PictureError as error:
                future.set_exception(error)
            except Exception as error:  # without this thread no picture would end, and simulated time waits
                future.set_exception(
                    PictureError(f"the picture cannot be made: {type(error).__name__}: {error}")
                )
                self._drop()
        self._drop()
        while self._shots:  # no further one comes
            self._shots.popleft()[1].set_exception(PictureError("the simulator ends"))

    def _expose(self, shot: Shot) -> np.ndarray:
        for attempt in range(ATTEMPTS):
            try:
                return self._present().expose(shot, self._limit)
            except WorkerLost as lost:
                self._drop()
                if self._closed:
                    raise PictureError("the simulator ends") from None
                if attempt + 1 == ATTEMPTS:
                    self._report(f"{lost}; the picture is given up")
                    raise
                self._report(f"{lost}; another one makes the picture")
        raise AssertionError("not reached")

    def _present(self) -> PictureWorker:
        if self._worker is None:
            worker = PictureWorker()
            with self._news:
                self._worker = worker
                if self._closed:
                    worker.interrupt()
        return self._worker

    def _drop(self) -> None:
        with self._news:
            worker, self._worker = self._worker, None
        if worker is not None:
            worker.close()
