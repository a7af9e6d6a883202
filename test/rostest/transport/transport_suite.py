#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The cases of transport.test, over one start of its nodes."""

import unittest

from knowledge_transport_test import KnowledgeTransportTest
from transport_flood_cases import Floods
from transport_service_cases import Services
from transport_test import Actions, Deadlines, Owners

import rostest
from merlin_test.topic_links import init_node

CASES = (Actions, Deadlines, Floods, KnowledgeTransportTest, Owners, Services)


def suite():
    return unittest.TestSuite(map(unittest.defaultTestLoader.loadTestsFromTestCase, CASES))


if __name__ == "__main__":
    init_node("transport_test")
    rostest.rosrun("merlin_test", "transport", "__main__.suite")
