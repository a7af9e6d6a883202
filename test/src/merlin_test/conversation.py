# SPDX-License-Identifier: Apache-2.0
"""Waits until a robot, a simulated person and a test hear each other: what is said before is lost."""

import time

import rospy

from merlin_test import LONG
from merlin_test.topic_links import sends

PERSON = "/person_voice"


def wait_for_conversation() -> None:
    """Waits until the person hears what this node has the robot say, and the robot hears the person.

    To be called when this node has a client of ``sound_play``.
    """
    links = [
        (rospy.get_name(), "/sound_play/goal", PERSON),
        ("/soundplay_node", "/sound_play/is_speaking", PERSON),
        ("/soundplay_node", "/audio/speaker", PERSON),
        (PERSON, "/audio/microphone", "/listen"),
    ]
    end = time.monotonic() + LONG
    for link in links:
        while not sends(*link):
            assert time.monotonic() < end, link
            rospy.rostime.wallsleep(0.01)
