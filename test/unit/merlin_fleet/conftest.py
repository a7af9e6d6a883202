# SPDX-License-Identifier: Apache-2.0
"""Clients of these tests are patient: a hub on a busy machine may need long for an answer."""

import functools
import sys
from pathlib import Path

import pytest

from merlin_fleet import fleet_client
from merlin_fleet.commands import fleet_command
from merlin_fleet.hub import EtcdHub

sys.path.insert(0, str(Path(__file__).parent))  # the modules beside the tests

LIMIT = 60.0  # s for a hub to take something
TIMEOUT = 20.0  # s for a call


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gives clients more time than they have elsewhere; a test of a time limit sets its own."""
    monkeypatch.setattr(fleet_client, "LIMIT", LIMIT)
    monkeypatch.setattr(fleet_command, "LIMIT", LIMIT)
    monkeypatch.setattr(fleet_client, "EtcdHub", functools.partial(EtcdHub, timeout=TIMEOUT))
