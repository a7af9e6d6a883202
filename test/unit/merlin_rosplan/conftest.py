# SPDX-License-Identifier: Apache-2.0
"""A knowledge store with a clock of the test's own, and the way to the modules beside the tests."""

import sys
from pathlib import Path

import pytest

from merlin_pddl.knowledge import Instance
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore

sys.path.insert(0, str(Path(__file__).parent))

from knowledge_world import DOMAIN, Clock, add


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def store(clock):
    found = KnowledgeStore(DOMAIN, clock=clock)
    add(found, Instance("poi", "kitchen"), Instance("poi", "hall"), Instance("robot", "r1"))
    return found
