# SPDX-License-Identifier: BSD-3-Clause
"""The server of the page: its files, and a WebSocket for each page that is open. On aiohttp, on one thread."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files
from typing import Final

from aiohttp import web

from flexbt_common.pictures import STYLE
from flexbt_console.commands import CommandedRobot
from flexbt_console.mirror import Mirror
from flexbt_core.values import hint, one_line, shown

from .access import CLOSED_HEADERS, Access, WrongTokens, guard, source_of
from .drawings import Drawings
from .page_link import PageLink
from .picture import Pictures
from .requests import MESSAGE_BYTES
from .station import PageStation, Robots

MOST_PAGES: Final = 32
"""Pages that are open at the same time."""

MOST_GREETING: Final = 32
"""Connections at the same time that have not said yet what a page says first; the oldest of the source that has the
most gives way to one more."""

GREETING_OF_SOURCE: Final = 8
"""Of these, from one source."""

PING_SECONDS: Final = 10.0

_TYPES: Final = {'html': 'text/html', 'css': 'text/css', 'js': 'text/javascript', 'svg': 'image/svg+xml'}


class WebServer:
    """Serves the pages of robots, also of those that come later; ``station`` makes what the page of one needs."""

    def __init__(
        self, robots: Robots, station: Callable[[Mirror, CommandedRobot], PageStation], access: Access
    ) -> None:
        self._robots = robots
        self._station = station
        self._access = access
        self._wrong = WrongTokens()
        self._pages: dict[PageLink, str] = {}
        self._pictures: dict[str, Pictures] = {}
        self._encoder = ThreadPoolExecutor(1, 'encoder')
        self._greeting: dict[PageLink, asyncio.Transport] = {}
        self._drawings: Drawings | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._is_told = False
        page = files(__package__) / 'page'
        self._files = {
            one.name: (one.read_bytes(), _TYPES[one.name.rpartition('.')[2]])
            for one in page.iterdir()
            if one.name.rpartition('.')[2] in _TYPES
        }
        self._files['pictures.css'] = STYLE.encode(), _TYPES['css']
        self._files[''] = self._files['index.html']

    def application(self) -> web.Application:
        """The application of aiohttp."""
        application = web.Application(middlewares=[guard(self._access)], client_max_size=0)
        application.on_startup.append(self._start)
        application.on_cleanup.append(self._end)
        application.router.add_get('/link', self._open)
        application.router.add_get('/{name:[a-z_.]*}', self._file)
        return application

    async def _start(self, application: web.Application) -> None:
        self._loop = asyncio.get_running_loop()
        self._drawings = Drawings()
        self._robots.fleet.add_listener(self._wake)

    async def _end(self, application: web.Application) -> None:
        self._encoder.shutdown(wait=False, cancel_futures=True)

    def _wake(self) -> None:
        """From any thread; many changes make one waking."""
        if not self._is_told and self._loop is not None:
            self._is_told = True
            try:
                self._loop.call_soon_threadsafe(self._wake_pages)
            except RuntimeError:  # the loop is closed: the server has ended
                self._loop = None

    def _wake_pages(self) -> None:
        self._is_told = False
        for page in self._pages:
            page.wake()

    async def _file(self, request: web.Request) -> web.StreamResponse:
        known = self._files.get(request.match_info['name'])
        if known is None:
            raise web.HTTPNotFound(text='there is no such file')
        body, type = known
        return web.Response(body=body, content_type=type, charset='utf-8', headers=self._headers(request.host))

    def _headers(self, host: str) -> dict[str, str]:
        return {
            'Content-Security-Policy': (
                "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
                f"connect-src 'self' ws://{host} wss://{host}; "
                "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
            ),
            **CLOSED_HEADERS,
            'Cache-Control': 'no-cache',
        }

    async def _open(self, request: web.Request) -> web.StreamResponse:
        socket = web.WebSocketResponse(max_msg_size=MESSAGE_BYTES, heartbeat=PING_SECONDS)
        assert self._drawings is not None
        page = PageLink(socket, self._drawings, source_of(request.remote))
        await socket.prepare(request)
        if not await self._greet(page, request):
            return socket
        name = request.query.get('robot', '')
        robot = self._named(name)
        if robot is None:
            await page.refuse('NO SUCH ROBOT', self._not_found(name), self._robots.fleet.overview())
            return socket
        if len(self._pages) >= MOST_PAGES:
            await page.refuse('TOO MANY PAGES', f'{MOST_PAGES} pages are open already; close one')
            return socket
        self._pages[page] = robot
        try:
            try:
                await asyncio.to_thread(self._robots.open, robot)
            except KeyError:  # it was forgotten just now
                await page.refuse('NO SUCH ROBOT', self._not_found(robot), self._robots.fleet.overview())
                return socket
            except (RuntimeError, TimeoutError) as error:  # no thread is left, or the node is busy
                await page.refuse('TRY AGAIN', f'the server of the page cannot open {one_line(robot)} now: {error}')
                return socket
            try:
                station = self._station(*self._robots.robot(robot))
                if robot not in self._pictures:
                    self._pictures[robot] = Pictures(self._robots.fleet, robot, station, self._encoder)
                await page.serve(robot, station, self._pictures[robot])
            finally:
                await asyncio.to_thread(self._robots.close, robot)
        finally:
            del self._pages[page]
            if robot in self._pictures and robot not in self._pages.values():
                self._pictures.pop(robot).close()
        return socket

    def _named(self, name: str) -> str | None:
        """The robot that a page asks for: one by its name, also without the slash; the own one, or the most urgent."""
        known = self._robots.fleet.names
        if name:
            return next((one for one in (name, f'/{name}') if one in known), None)
        own = self._robots.own
        return own if own in known else next((one.name for one in self._robots.fleet.overview()), own)

    def _not_found(self, name: str) -> str:
        meant = hint(f'/{name.strip("/")}', self._robots.fleet.names)
        return f'no robot {shown(name)} was found{meant or ", and no other one yet"}'

    async def _greet(self, page: PageLink, request: web.Request) -> bool:
        """Whether the page is welcome. Who says nothing keeps nobody out."""
        if request.transport is None:
            return False
        of_source = Counter(one.source for one in self._greeting)
        most = page.source
        if len(self._greeting) >= MOST_GREETING:
            most = max(of_source, key=of_source.__getitem__)
        if len(self._greeting) >= MOST_GREETING or of_source[most] >= GREETING_OF_SOURCE:
            oldest = next(one for one in self._greeting if one.source == most)
            self._greeting.pop(oldest).abort()
        self._greeting[page] = request.transport
        try:
            return await page.is_welcome(self._access, self._wrong)
        finally:
            self._greeting.pop(page, None)
