# SPDX-License-Identifier: Apache-2.0
from pathlib import Path
from typing import Iterator

import pytest
from robot_story import RobotStory


@pytest.fixture
def story(tmp_path: Path) -> Iterator[RobotStory]:
    told = RobotStory(tmp_path)
    yield told
    told.close()
