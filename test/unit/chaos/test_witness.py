# SPDX-License-Identifier: Apache-2.0
"""The witness's time goes on where the robot's is set back."""

import pytest
from chaos.under_test.witness import WorldTime


def test_the_worlds_time_never_goes_back() -> None:
    world = WorldTime()
    reported = [world.at(stamp) for stamp in (1000.0, 1000.5, 970.5, 971.0, 941.0, 941.25)]
    assert reported == pytest.approx([1000.0, 1000.5, 1000.5, 1001.0, 1001.0, 1001.25])
