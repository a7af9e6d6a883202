# SPDX-License-Identifier: Apache-2.0
"""Brings changes of the state to every open page: at once when it is quiet, in frames when much happens.

One frame is encoded once for all pages. A page that reads slowly has at most one text on its way and one set
of changes behind it, which grows into the whole state and no further.
"""

import asyncio
import json
from typing import Any, Callable, Dict, List, Optional, Set, Tuple

from aiohttp import web

from merlin_monitor.state.state_tree import ChangeSet, Feed, StateTree

FRAME = 0.035  # s between two frames
BEAT = 0.5  # s without a frame after which an empty one is sent: a page greys without news for 2 s
NOTHING_NEW = '{"changes":[]}'
GATHER = 0.004  # s that a first change waits for those that belong to it
SEND_LIMIT = 20.0  # s for one text, after which a page counts as gone


class LiveFeed:
    """Serves the state to pages. Everything but the constructor runs in the server's loop.

    :param tree: the state.
    :param alive: whether the state is kept; when it is not, nothing shows the pages that it is.
    :param for_visitors: the state for pages that may not look.
    """

    def __init__(
        self, tree: StateTree, alive: Callable[[], bool], for_visitors: Callable[[], Dict[str, Any]]
    ) -> None:
        self._tree = tree
        self._alive = alive
        self._for_visitors = for_visitors
        self._pages: Set[_Page] = set()
        self._feed: Optional[Feed] = None
        self._task: Optional[asyncio.Task[None]] = None
        self._changed: Optional[asyncio.Event] = None
        self._whole: Tuple[int, str] = (-1, "")

    async def serve(
        self, socket: web.WebSocketResponse, abort: Callable[[], None], may_look: Callable[[], bool]
    ) -> None:
        """Feeds one page until it is closed.

        :param abort: ends its connection, whatever it has not read.
        :param may_look: whether it gets the state; a connection ends when that changes.
        """
        self._watch()
        if may_look():
            page: _Page = _Page(socket, abort, self._whole_text, may_look)
        else:
            page = _Visitor(socket, abort, self._visitor_text, lambda: not may_look())
        page.changes.become_whole()
        self._pages.add(page)
        sender = asyncio.ensure_future(page.send())
        try:
            # What a page sends is ignored; reading notices its end.
            async for _ in socket:
                pass
        finally:
            self._pages.discard(page)
            sender.cancel()
            if not self._pages:
                self._rest()

    async def close(self) -> None:
        """Closes all pages."""
        sockets = [page.socket for page in self._pages]
        await asyncio.gather(*(socket.close(code=1001, message=b"the monitor ends") for socket in sockets))
        self._rest()

    def _watch(self) -> None:
        if self._feed is None:
            loop = asyncio.get_event_loop()
            changed = self._changed = asyncio.Event()
            self._feed = self._tree.subscribe(lambda: loop.call_soon_threadsafe(changed.set))
            self._task = asyncio.ensure_future(self._frames(self._feed, changed))

    def _rest(self) -> None:
        if self._feed is not None:
            self._feed.close()
            self._feed = None
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _frames(self, feed: Feed, changed: asyncio.Event) -> None:
        loop = asyncio.get_event_loop()
        last = 0.0
        while True:
            try:
                await asyncio.wait_for(changed.wait(), BEAT)
            except asyncio.TimeoutError:
                if self._alive():
                    for page in self._pages:
                        page.beat()
                continue
            await asyncio.sleep(max(GATHER, last + FRAME - loop.time()))
            changed.clear()
            last = loop.time()
            version, changes = feed.take()
            text = None if changes.whole else _frame(version, changes.as_list())
            for page in self._pages:
                page.offer(version, changes, text)

    def _whole_text(self) -> str:
        if self._whole[0] != self._tree.version:
            version, state = self._tree.as_json()
            self._whole = version, f'{{"version":{version},"state":{state}}}'
        return self._whole[1]

    def _visitor_text(self) -> str:
        return json.dumps({"version": 1, "state": self._for_visitors()}, separators=(",", ":"))


class _Page:
    def __init__(
        self,
        socket: web.WebSocketResponse,
        abort: Callable[[], None],
        whole: Callable[[], str],
        holds: Callable[[], bool],
    ) -> None:
        self.socket = socket
        self._abort = abort
        self._holds = holds
        self.changes = ChangeSet()
        self._version = 0
        self._whole = whole
        self._text: Optional[str] = None
        self._beat = False
        self._ready = asyncio.Event()
        self._ready.set()

    def offer(self, version: int, changes: ChangeSet, text: Optional[str]) -> None:
        self._version = version
        # The common text serves a page that has all before it; another one gets what it missed.
        self._text = text if not self.changes else None
        self.changes.merge(changes)
        self._ready.set()

    def beat(self) -> None:
        """Tells a page that the connection works although nothing has changed."""
        self._beat = True
        self._ready.set()

    async def send(self) -> None:
        while not self.socket.closed:
            await self._ready.wait()
            self._ready.clear()
            changes, text = self.changes, self._text
            beat, self._beat = self._beat, False
            self.changes, self._text = ChangeSet(), None
            if not self._holds():
                self._abort()
                return
            if not changes and not beat:
                continue
            if not changes:
                text = NOTHING_NEW
            elif changes.whole:
                text = self._whole()
            elif text is None:
                text = _frame(self._version, changes.as_list())
            # A goodbye would wait behind all that the page does not read.
            limit = asyncio.get_running_loop().call_later(SEND_LIMIT, self._abort)
            try:
                await self.socket.send_str(text)
            except (ConnectionError, RuntimeError):
                self._abort()
                return
            finally:
                limit.cancel()


class _Visitor(_Page):
    """A page that may not look: it hears that the monitor lives, and what it takes to sign in."""

    _said = ""

    def offer(self, version: int, changes: ChangeSet, text: Optional[str]) -> None:
        said = self._whole()
        if said != self._said:
            self._said = said
            self.changes.become_whole()
        self.beat()


def _frame(version: int, changes: List[List[Any]]) -> str:
    return json.dumps({"version": version, "changes": changes}, separators=(",", ":"))
