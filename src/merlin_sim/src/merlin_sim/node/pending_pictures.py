# SPDX-License-Identifier: Apache-2.0
"""Pictures that are being made while simulated time continues, and how far it may continue meanwhile."""

import threading
from concurrent.futures import Future
from typing import Dict

import numpy as np
import rospy

from merlin_ros.health import OK, WARN, Health
from merlin_sim.rendering.renderer import Renderer
from merlin_sim.rendering.shot import Shot


class PendingPictures:
    """Holds simulated time at most a stated latency behind the oldest picture that is not ready yet.

    :param latency: s of simulated time; at least one physics step.
    """

    def __init__(self, renderer: Renderer, latency: float) -> None:
        self._renderer = renderer
        self._latency = rospy.Duration(latency)
        self._news = threading.Condition()  # guards what follows
        self._taken_at: Dict[Future[np.ndarray], rospy.Time] = {}
        self._made = 0
        self._problem = ""

    def take(self, shot: Shot, stamp: rospy.Time) -> "Future[np.ndarray]":
        """Has a picture made; see :meth:`Renderer.take`.

        :param stamp: the time on the clock, now.
        """
        future = self._renderer.take(shot)
        with self._news:
            self._taken_at[future] = stamp
        future.add_done_callback(self._done)
        return future

    def hold(self, next_time: rospy.Time) -> None:
        """Waits until the clock may reach a time. Whatever becomes of a picture, this ends."""
        with self._news:
            self._news.wait_for(
                lambda: not self._taken_at or next_time <= min(self._taken_at.values()) + self._latency
            )

    def health(self) -> Health:
        """How the latest picture went."""
        with self._news:
            values = {"pictures": self._made, "being made": len(self._taken_at)}
            if self._problem:
                return Health(WARN, self._problem, values)
        return Health(OK, "ready", values)

    def _done(self, future: "Future[np.ndarray]") -> None:
        error = future.exception()
        with self._news:
            del self._taken_at[future]
            self._made += error is None
            self._problem = str(error) if error is not None else ""
            self._news.notify_all()
