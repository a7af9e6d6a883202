# SPDX-License-Identifier: Apache-2.0
"""The browser that the tests of a worker share."""

import asyncio
import contextlib
from typing import Any

import pytest
from playwright.sync_api import Error

from merlin_test.chromium import chromium

pytestmark = pytest.mark.processes

PAGE = "data:text/html,<p>here"


def text(browser: Any) -> str:
    page = browser.new_context().new_page()
    page.goto(PAGE)
    return page.text_content("p")


async def answer() -> int:
    await asyncio.sleep(0.0)
    return 42


def test_the_next_one_gets_the_same_browser_without_pages_of_the_last() -> None:
    with chromium() as first:
        assert text(first) == "here"
    assert asyncio.run(answer()) == 42  # in between, an event loop of its own
    with chromium() as second:
        assert second is first and not second.contexts
        assert text(second) == "here"


def test_a_browser_that_has_died_is_replaced() -> None:
    with chromium() as dead:
        session = dead.new_browser_cdp_session()
        with contextlib.suppress(Error):  # it may die before it answers
            session.send("Browser.close")
        while dead.is_connected():  # playwright hears of it while it is used
            with contextlib.suppress(Error):
                dead.new_context().close()
    with chromium() as browser:
        assert browser is not dead and text(browser) == "here"
