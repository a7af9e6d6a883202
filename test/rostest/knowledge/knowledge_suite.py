#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The cases of knowledge.test, over one start of its nodes."""

import unittest

from knowledge_base_test import KnowledgeBaseTest
from knowledge_persistence_test import KnowledgePersistenceTest

import rostest
from merlin_test.topic_links import init_node

CASES = (KnowledgeBaseTest, KnowledgePersistenceTest)


def suite():
    return unittest.TestSuite(map(unittest.defaultTestLoader.loadTestsFromTestCase, CASES))


if __name__ == "__main__":
    init_node("knowledge_test")
    rostest.rosrun("merlin_test", "knowledge", "__main__.suite")
