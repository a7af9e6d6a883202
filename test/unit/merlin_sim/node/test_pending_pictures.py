# SPDX-License-Identifier: Apache-2.0
"""How far simulated time goes on while pictures are made."""

import threading
from concurrent.futures import Future

import pytest
import rospy

from merlin_ros.health import OK, WARN
from merlin_sim.node.pending_pictures import PendingPictures
from merlin_sim.rendering.shot import PictureError
from merlin_test import LONG


class Later:
    """Makes no picture by itself."""

    def take(self, _):
        return Future()


@pytest.fixture
def pictures():
    return PendingPictures(Later(), 0.2)


def at(milliseconds):
    return rospy.Time(5, milliseconds * 1_000_000)


def held(pictures, time):
    """A thread that waits until the clock may reach a time, and what tells that it may."""
    free = threading.Event()
    threading.Thread(target=lambda: (pictures.hold(time), free.set()), daemon=True).start()
    return free


def test_without_pictures_time_goes_on(pictures):
    assert held(pictures, at(0)).wait(LONG)
    picture = pictures.take(None, at(0))
    free = held(pictures, at(900))
    assert not free.is_set()
    picture.set_result(None)
    assert free.wait(LONG)
    assert held(pictures, at(999)).wait(LONG)


def test_time_waits_at_the_latency_behind_the_oldest_picture(pictures):
    first, second = pictures.take(None, at(100)), pictures.take(None, at(150))
    pictures.hold(at(300))
    later, latest = held(pictures, at(310)), held(pictures, at(360))
    assert not later.is_set() and not latest.is_set()
    first.set_result(None)
    assert later.wait(LONG) and not latest.is_set()
    second.set_exception(PictureError("lost"))
    assert latest.wait(LONG)


def test_health_tells_why_there_is_no_picture(pictures):
    assert pictures.health().level == OK
    pictures.take(None, at(0)).set_exception(PictureError("the process that makes pictures has ended"))
    assert (pictures.health().level, pictures.health().message) == (
        WARN,
        "the process that makes pictures has ended",
    )
    pictures.take(None, at(10)).set_result(None)
    assert pictures.health().level == OK
