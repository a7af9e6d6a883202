#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The cases of restaurant.test, over one start of its nodes."""

import unittest

from camera_test import Camera
from guests_test import Guests
from listen_test import Listen
from speech_test import Speech
from world_control_test import WorldControl

import rostest
from merlin_test.topic_links import init_node

CASES = (Camera, Guests, Listen, Speech, WorldControl)


def suite():
    return unittest.TestSuite(map(unittest.defaultTestLoader.loadTestsFromTestCase, CASES))


if __name__ == "__main__":
    init_node("restaurant_test")
    rostest.rosrun("merlin_test", "restaurant", "__main__.suite")
