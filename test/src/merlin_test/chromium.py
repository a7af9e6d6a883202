# SPDX-License-Identifier: Apache-2.0
"""The distribution's Chromium, driven by playwright, for tests and benchmarks of the monitor's page."""

import asyncio
import atexit
import contextlib
import re
import shutil
import threading
import time
from typing import Any, Dict, Iterator, List, Optional

from playwright.sync_api import Browser, BrowserContext, Error, Page, Playwright, sync_playwright

from merlin_test import LONG

# The shell has no window to draw for each page, which takes most of the time of the whole browser.
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser")
#: Looks at the page each 30 ms, in the page: from outside, each look costs four processes a message.
LOOK_AGAIN = """async ([argument, limit]) => {
  const end = performance.now() + limit;
  for (;;) {
    await new Promise((resolve) => setTimeout(resolve, 30));
    let shown = (%s);
    if (typeof shown === "function") shown = shown(argument);
    if (await shown) return true;
    if (performance.now() > end) return false;
  }
}"""
LEFT = "Execution context was destroyed"  # the page was loaded anew, or another one was
# That the monitor was gone for a moment, or refused something, is not a fault of the page.
EXPECTED = re.compile(
    r"ERR_(CONNECTION|EMPTY_RESPONSE|INCOMPLETE_CHUNKED_ENCODING)|responded with a status of (403|409)"
)


class NoBrowser(RuntimeError):
    """There is no Chromium."""


class _Shared(threading.local):
    """The browser of a thread, as playwright has it: its objects belong to one."""

    def __init__(self) -> None:
        self._playwright: Optional[Playwright] = None
        self._loop: Optional[asyncio.AbstractEventLoop] = None
        self._browser: Optional[Browser] = None

    def connected(self) -> Browser:
        """Starts it when there is none, or it has died; then playwright's loop counts as running."""
        if self._playwright is None:
            self._playwright = sync_playwright().start()
            self._loop = asyncio.get_running_loop()
            atexit.register(self._end)
        asyncio._set_running_loop(self._loop)
        if not self._answers():
            # Without a sandbox, because tests run as root in containers; it sees only pages of this machine.
            self._browser = self._playwright.chromium.launch(
                executable_path=_executable(), args=["--no-sandbox", "--disable-gpu"], timeout=1000 * LONG
            )
        assert self._browser is not None
        return self._browser

    def _answers(self) -> bool:
        """Playwright hears of a death only while it is used."""
        if self._browser is None:
            return False
        try:
            self._browser.new_context().close()
        except Error:
            return False
        return True

    def _end(self) -> None:
        asyncio._set_running_loop(self._loop)
        if self._playwright is not None:
            self._playwright.stop()


_shared = _Shared()


def _executable() -> str:
    found = (shutil.which(name) for name in BROWSERS)
    executable = next((path for path in found if path is not None), None)
    if executable is None:
        raise NoBrowser("there is no Chromium; install the package chromium-headless-shell of apt.txt")
    return executable


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """A browser without a window; its pages are closed at the end.

    All that a thread asks for is the same one, which ends with the process: each start would compute for a
    second. What comes in between may have an event loop of its own.

    :raises NoBrowser: it is not installed.
    """
    outer = asyncio._get_running_loop()
    try:
        browser = _shared.connected()
        try:
            yield browser
        finally:
            for context in browser.contexts:
                context.close()
    finally:
        asyncio._set_running_loop(outer)


class Visit:
    """A page that is open, with what it complained about.

    :param beside: another page of the same window.
    :param script: runs before those of the page.
    :param options: of the browser's context, such as viewport and color_scheme.
    """

    def __init__(
        self,
        browser: Browser,
        address: str,
        beside: Optional["Visit"] = None,
        script: str = "",
        **options: Any,
    ) -> None:
        # Each fact that changes would be drawn sixty times a second while its light fades.
        options = {"reduced_motion": "reduce", **options}
        self.context: BrowserContext = beside.context if beside else browser.new_context(**options)
        self.page: Page = self.context.new_page()
        if script:
            self.page.add_init_script(script)
        self.page.set_default_timeout(1000 * LONG)
        self.complaints: List[str] = []
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("console", self._console)
        self.page.goto(address)
        self.wait("() => document.documentElement.dataset.panels === 'shown'")

    def wait(self, expression: str, argument: Any = None, limit: float = LONG) -> None:
        """Waits until a JavaScript function, which may be async, returns something true.

        :param limit: s of wall time.

        :raises AssertionError: it does not.
        """
        # Chromium's own waiting takes an async function's promise for true.
        shown = self.page.evaluate(expression, argument)
        end = time.monotonic() + limit
        while not shown:
            left = end - time.monotonic()
            assert left > 0.0, f"after {limit:.0f} s not true: {expression} ({argument})"
            try:
                shown = self.page.evaluate(LOOK_AGAIN % expression, [argument, 1000 * left])
            except Error as error:
                if LEFT not in str(error):
                    raise

    def text(self, selector: str) -> str:
        """The text of an element."""
        return self.page.text_content(selector) or ""

    def texts(self, selector: str) -> List[str]:
        """The texts of all elements that fit."""
        return self.page.locator(selector).all_text_contents()

    def wait_text(self, selector: str, wanted: str, limit: float = LONG) -> None:
        """Waits until an element contains a text."""
        self.wait(
            "([selector, wanted]) => [...document.querySelectorAll(selector)]"
            ".some((element) => element.textContent.includes(wanted))",
            [selector, wanted],
            limit,
        )

    def now(self) -> Dict[str, str]:
        """What the robot does, as it is said at one moment: mission, goal, action, state, because → text.

        Of goal and action also the PDDL, as ``goal pddl`` and ``action pddl``.
        """
        chain, because = self.page.evaluate(
            "() => [[...document.querySelectorAll('#now-chain li')]"
            ".map((item) => [item.textContent, item.title]),"
            " document.getElementById('now-because').textContent]"
        )
        shown = {"because": because}
        for text, pddl in chain:
            what, words = text.split(": ", 1)
            shown.update({what: words, f"{what} pddl": pddl})
        return shown

    def choose_kinds(self, *kinds: str) -> None:
        """Shows these kinds of events in the history, and no others."""
        buttons = self.page.locator("#history-kinds button")
        for index in range(buttons.count()):
            button = buttons.nth(index)
            wanted = (button.text_content() or "").split()[-1] in kinds
            if wanted != (button.get_attribute("aria-pressed") == "true"):
                button.click()

    def close(self) -> None:
        """Closes it, and those beside it."""
        self.context.close()

    def _console(self, message: Any) -> None:
        if message.type == "error" and not EXPECTED.search(message.text):
            self.complaints.append(message.text)
