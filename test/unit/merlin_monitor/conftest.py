# SPDX-License-Identifier: Apache-2.0
"""Lets the tests of the monitor import `messages` and `served`, and serves the page."""

import sys
from pathlib import Path
from typing import Any, Iterator, List

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


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from merlin_test.chromium import chromium  # the other tests do without

    with chromium() as found:
        yield found


@pytest.fixture
def visits(browser: Any, served: Served) -> Iterator[Any]:
    """Opens pages of the filled model; nothing of them may complain."""
    from shown_page import Visit, fill

    fill(served)
    opened: List[Visit] = []

    def visit(query: str = "", **options: Any) -> Visit:
        # Axe is put in by the browser's own means, past the policy of the page.
        opened.append(Visit(browser, served.url + query, **options))
        opened[-1].wait_text("#glance-state", "")
        return opened[-1]

    yield visit
    complaints = [complaint for each in opened for complaint in each.complaints]
    for each in opened:
        each.close()
    assert complaints == []
