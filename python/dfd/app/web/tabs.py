"""The tabs that are open, each with its session, which outlives a lost connection, a reload and a crash."""

from __future__ import annotations

import asyncio
import contextlib
import re
import secrets
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from starlette.websockets import WebSocket, WebSocketState

from dfd.app.options import SessionOptions
from dfd.app.protocol.answers import FailureMessage
from dfd.app.web.link import Link, ProcessLink

OPENED_ELSEWHERE, SESSION_ENDED = 4001, 4002  # close codes of a WebSocket
NAME = re.compile(r"[0-9a-f]{32}")
IDLE_SECONDS = 5 * 60.0  # after which a session that no page looks at ends; it resumes from what it saved
KEEP_SECONDS = 7 * 24 * 3600.0  # after which that goes as well
MOST_TABS = 64
CRASH_SECONDS = 60.0  # after two crashes within it the session restarts empty
SWEEP_SECONDS = 15.0

CRASHED = "The session ended unexpectedly, perhaps for lack of memory. It goes on from what was saved"
CRASHED_AGAIN = "The session ended unexpectedly once more. It restarts without what it had open"


class Tab:
    """One session with its folder, and the page that looks at it, if one does."""

    def __init__(self, folder: Path, options: SessionOptions, make_link: Callable[[], Link]) -> None:
        self.folder = folder
        self._options, self._make_link = options, make_link
        self.link: Link | None = None
        self._pump: asyncio.Task[None] | None = None
        self._page: WebSocket | None = None
        self._sending = asyncio.Lock()
        self._crashed = -CRASH_SECONDS
        self._silent = False  # whether the newest process ended before it said anything
        self.left = time.monotonic()  # when the last page went

    @property
    def name(self) -> str:
        """The session's number, which the page knows it by."""
        return self.folder.name

    @property
    def attended(self) -> bool:
        """Whether a page looks at it."""
        return self._page is not None

    async def attach(self, page: WebSocket) -> None:
        """Let `page` look at the session, and no other any more."""
        before, self._page = self._page, page
        if before is not None:
            await _close(before, OPENED_ELSEWHERE)
        if self.link is None:
            await self._begin()  # and tell all there is as it comes
        else:
            await self.link.order("attach")

    def detach(self, page: WebSocket) -> None:
        """The page has gone."""
        if self._page is page:
            self._page, self.left = None, time.monotonic()

    async def order(self, name: str, **arguments: Any) -> None:
        """Have the session call its method of that name."""
        await (self.link or await self._begin()).order(name, **arguments)

    async def end(self) -> None:
        """End the session; what it saved stays."""
        pump, self._pump = self._pump, None
        link, self.link = self.link, None
        if pump is not None:
            pump.cancel()
        if link is not None:
            await link.close()

    async def close(self, code: int) -> None:
        """End the session and the page's connection."""
        page, self._page = self._page, None
        if page is not None:
            await _close(page, code)
        await self.end()

    async def _begin(self) -> Link:
        self.folder.mkdir(parents=True, exist_ok=True)
        self.link = self._make_link()
        await self.link.start(self.folder, self._options, self.folder.parent)
        self._pump = asyncio.create_task(self._carry(self.link))
        return self.link

    async def _carry(self, link: Link) -> None:
        """Bring the session's messages to whichever page looks at it, until the session ends."""
        heard = False
        while (message := await link.receive()) is not None:
            heard = True
            await self.tell(message)
        if self.link is not link:
            return
        self.link = None
        # One that was begun ahead may have ended before its turn: that was no fault of this session.
        first, self._silent = not self._silent, not heard
        if not heard and first:
            await self._begin()
            return
        now = time.monotonic()
        again = now - self._crashed < CRASH_SECONDS
        self._crashed = now
        if again:
            await asyncio.to_thread(_empty, self.folder)
            self._options = self._options.model_copy(update={"mesh": None, "field": None, "edit": None})
        if self._page is not None:
            await self._begin()
            await self.tell(FailureMessage(message=CRASHED_AGAIN if again else CRASHED).model_dump_json())

    async def tell(self, message: str | bytes) -> None:
        """Send to the page, if one is there."""
        page = self._page
        if page is None or page.application_state != WebSocketState.CONNECTED:
            return
        async with self._sending:
            with contextlib.suppress(RuntimeError, ConnectionError, OSError):  # it has gone at this moment
                if isinstance(message, str):
                    await page.send_text(message)
                else:
                    await page.send_bytes(message)


class Tabs:
    """All tabs of one server, whose sessions have their folders in `root`.

    With `make_link` sessions are not processes of their own, and one serves all tabs.
    """

    def __init__(self, root: Path, options: SessionOptions, make_link: Callable[[], Link] | None = None) -> None:
        self.root = root
        self.options = options
        self._make_link = make_link
        self._tabs: dict[str, Tab] = {}
        self._spare: ProcessLink | None = None
        self._sweeping: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Get ready: have one process that waits for the first tab, and look after those that nobody looks at."""
        if self._make_link is None:
            self._spare = ProcessLink()
            await self._spare.prepare()
        self._sweeping = asyncio.create_task(self._sweep())

    async def stop(self) -> None:
        """End all sessions."""
        if self._sweeping is not None:
            self._sweeping.cancel()
        await asyncio.gather(*(tab.close(SESSION_ENDED) for tab in self._tabs.values()))
        if self._spare is not None:
            await self._spare.close()

    def all(self) -> list[Tab]:
        """All tabs, attended or not."""
        return list(self._tabs.values())

    def find(self, name: str) -> Tab | None:
        """The tab of that name, if it has one or had one that can go on."""
        if not NAME.fullmatch(name):
            return None
        known = self._tabs.get(name)
        if known is None and self._make_link is None and (self.root / name).is_dir():
            known = self._tabs[name] = self._tab(name)
        return known

    async def open(self, name: str | None) -> tuple[Tab, bool]:
        """The tab of that name, or a new one; and whether it is the one asked for.

        Raises ValueError if there are as many as there can be, and a page looks at each of them.
        """
        found = None if name is None else self.find(name)
        if found is not None:
            return found, True
        if self._make_link is not None and self._tabs:
            return next(iter(self._tabs.values())), False
        running = [tab for tab in self._tabs.values() if tab.link is not None]
        if len(running) >= MOST_TABS:
            alone = [tab for tab in running if not tab.attended]
            if not alone:
                raise ValueError(f"This server has {MOST_TABS} tabs open, as many as it can: close one")
            await min(alone, key=lambda tab: tab.left).end()
        name = secrets.token_hex(16)
        self._tabs[name] = self._tab(name)
        return self._tabs[name], False

    def _tab(self, name: str) -> Tab:
        return Tab(self.root / name, self.options, self._make_link or self._process)

    def _process(self) -> Link:
        link, self._spare = self._spare or ProcessLink(), None
        return link

    async def _sweep(self) -> None:
        while True:
            await asyncio.sleep(SWEEP_SECONDS)
            if self._spare is None and self._make_link is None:
                self._spare = ProcessLink()
                await self._spare.prepare()
            await self.sweep(time.monotonic())

    async def sweep(self, now: float) -> None:
        """End sessions that nobody has looked at for long, and forget those that ended long ago."""
        for name, tab in list(self._tabs.items()):
            if tab.attended or self._make_link is not None:
                continue
            if now - tab.left > IDLE_SECONDS:
                await tab.end()
            if now - tab.left > KEEP_SECONDS:
                del self._tabs[name]
                await asyncio.to_thread(shutil.rmtree, tab.folder, True)


async def _close(page: WebSocket, code: int) -> None:
    with contextlib.suppress(RuntimeError, ConnectionError, OSError):
        await page.close(code)


def _empty(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
