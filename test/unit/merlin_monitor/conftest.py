"""Lets the tests of the monitor import `messages` and `served`, and serves the page."""

import sys
from pathlib import Path
from typing import Iterator

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from served import TOKEN, Served


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    served = Served(tmp_path, TOKEN)
    yield served
    served.stop()


@pytest.fixture
def open_stop(tmp_path: Path) -> Iterator[Served]:
    """Everybody may stop its robot."""
    served = Served(tmp_path, TOKEN, open_stop=True)
    yield served
    served.stop()


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Served]:
    served = Served(tmp_path, "")
    yield served
    served.stop()
