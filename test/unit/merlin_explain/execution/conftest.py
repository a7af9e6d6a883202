# SPDX-License-Identifier: Apache-2.0
from pathlib import Path
from typing import Iterator

import pytest
from robot_scenario import RobotScenario


@pytest.fixture
def scenario(tmp_path: Path) -> Iterator[RobotScenario]:
    reported = RobotScenario(tmp_path)
    yield reported
    reported.close()
