# SPDX-License-Identifier: BSD-3-Clause
"""The web server of the page: serves its files and a WebSocket for each open page until the operator ends it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import ssl
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from importlib.resources import files
from typing import TYPE_CHECKING, Final
from weakref import WeakSet

from aiohttp import WSCloseCode, web
from aiohttp.http import HttpProcessingError
from aiohttp.typedefs import Handler

from flexbt_common.files import USER_DIRECTORY, home_path
from flexbt_common.pictures.markup import STYLE
from flexbt_console.commands.spec import Role
from flexbt_console.errors import UsageError
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.ui.station import Station
from flexbt_core.clock.rates import RepeatedReports
from flexbt_core.values.text import did_you_mean, one_line, short_repr

from .access import Access, guard, source_of
from .costmaps import show_costmaps
from .drawings import Drawings
from .greetings import Greetings
from .page_files import PageFiles
from .page_link import PageLink
from .past import LivePast, PagePast, Recordings
from .picture import Pictures
from .requests import MESSAGE_BYTES
from .users import User

if TYPE_CHECKING:
    from flexbt_console.link.fleet_link import FleetLink

MOST_PAGES: Final = 32
"""Maximum number of open pages."""

MOST_OPERATORS: Final = 15
"""Maximum number of operators at open pages. An executive knows 16 operators of one process, one of which is the
server itself."""

MOST_WAITING: Final = 256
"""Maximum number of threads that wait for the node, which may be busy, and compress large messages of pages: so many
that neither pages nor commands of programs use all of them up."""

PING_SECONDS: Final = 10.0


class WebServer:
    """A server of the pages of all robots, including those that appear later.

    ``station`` makes the station of an operator at a robot. ``operator`` returns the operator at a page by the name
    that the page gives, '' for none; by default all pages are those of one operator, and ask for no name.
    """

    def __init__(
        self,
        robots: FleetLink,
        station: Callable[[Mirror, RobotLink, str], Station],
        access: Access,
        operator: Callable[[str], str] | None = None,
    ) -> None:
        self._robots = robots
        self._station = station
        self._access = access
        self._operator = operator
        self._greetings = Greetings(access)
        self._pages: dict[PageLink, tuple[str, str]] = {}
        self._pictures: dict[tuple[str, str], Pictures] = {}
        self._encoder = ThreadPoolExecutor(1, 'encoder')
        self._recordings = Recordings(home_path(USER_DIRECTORY))
        self._drawings: Drawings | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._is_told = False
        self._has_studio = False
        self._costmap_pages = 0
        self._files = PageFiles(files(__package__) / 'page', page='index.html')
        self._files.add('pictures.css', STYLE.encode(), 'css')
        self.file = self._files.answer
        """Answers a request for the file of the page that ``name`` of the route names."""

    def application(self, **mounted: web.Application | None) -> web.Application:
        """Return a new aiohttp application that serves the pages, and the applications that are mounted, such as the
        ``studio``, at their names."""
        application = web.Application(middlewares=[guard(self._access)], client_max_size=0)
        self._has_studio = mounted.get('studio') is not None
        for name, one in mounted.items():
            if one is not None:
                application.add_subapp(f'/{name}/', one)
        application.on_startup.append(self.start)
        application.on_cleanup.append(self.end)
        application.router.add_get('/link', self.open_page)
        application.router.add_get('/costmaps', self.open_costmaps)
        application.router.add_get('/{name:[a-z_.]*}', self.file)
        return application

    async def start(self, application: web.Application | None = None) -> None:
        """Begin to serve. On the thread of the loop."""
        self._loop = asyncio.get_running_loop()
        self._loop.set_default_executor(ThreadPoolExecutor(MOST_WAITING, 'waiting'))
        self._drawings = Drawings()
        self._robots.fleet.add_listener(self._wake)

    async def end(self, application: web.Application | None = None) -> None:
        """End what :meth:`start` began."""
        if self._drawings is not None:
            await self._drawings.close()
        self._encoder.shutdown(wait=False, cancel_futures=True)

    def _wake(self) -> None:
        """Wake the pages; several changes cause one wake-up. From any thread."""
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

    async def open_page(self, request: web.Request) -> web.StreamResponse:
        """Answer the request of a page for its WebSocket, until the page ends."""
        socket = web.WebSocketResponse(max_msg_size=MESSAGE_BYTES, heartbeat=PING_SECONDS)
        assert self._drawings is not None
        await socket.prepare(request)
        hello = await self._greetings.hello(socket, request)
        if hello is None:
            return socket
        page = PageLink(socket, self._drawings, self._access, hello)
        name = request.query.get('robot', '')
        robot = self._named(name)
        if robot is None:
            await page.refuse('NO SUCH ROBOT', self._not_found(name), self._robots.fleet.overview())
            return socket
        if len(self._pages) >= MOST_PAGES:
            await page.refuse('TOO MANY PAGES', f'{MOST_PAGES} pages are open already; close one')
            return socket
        operator = self.operator(page.operator, page.user)
        operators = {one for _, one in self._pages.values()}
        if operator not in operators and len(operators) >= MOST_OPERATORS:
            await page.refuse('TOO MANY OPERATORS', f'{MOST_OPERATORS} operators have pages open; close one')
            return socket
        seat = self._pages[page] = robot, operator
        try:
            try:
                mirror, link = self._robots.robot(robot)
                past = PagePast(LivePast(*self._robots.fleet.past(robot, mirror), mirror.now), self._recordings)
                await open_robot(self._robots, robot, operator)
            except KeyError:  # the robot was forgotten just now
                await page.refuse('NO SUCH ROBOT', self._not_found(robot), self._robots.fleet.overview())
                return socket
            except (RuntimeError, TimeoutError) as error:  # no more threads can be started, or the node is busy
                await page.refuse('TRY AGAIN', f'the server of the page cannot open {one_line(robot)} now: {error}')
                return socket
            try:
                station = replace(self._station(mirror, link, operator), role=page.user.role)
                if seat not in self._pictures:
                    self._pictures[seat] = Pictures(self._robots.fleet, robot, station, self._encoder)
                asks_name = self._operator is not None and not page.user.name
                features = {'asks_name': asks_name, 'studio': self._has_studio}
                await page.serve(robot, station, self._pictures[seat], past, **features)
            finally:
                await asyncio.to_thread(self._robots.close, robot, operator)
        finally:
            del self._pages[page]
            if seat in self._pictures and seat not in self._pages.values():
                self._pictures.pop(seat).close()
        return socket

    async def open_costmaps(self, request: web.Request) -> web.StreamResponse:
        """Answer the request of a page for the costmaps of its robot, until the page ends."""
        socket = web.WebSocketResponse(max_msg_size=MESSAGE_BYTES, heartbeat=PING_SECONDS)
        await socket.prepare(request)
        robot = self._named(request.query.get('robot', ''))
        hello = await self._greetings.hello(socket, request)
        if hello is None:
            return socket
        if robot is None or self._costmap_pages >= MOST_PAGES:
            await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b'no such robot, or too many pages')
            return socket
        self._costmap_pages += 1
        try:
            link = await asyncio.to_thread(self._robots.costmaps.open, robot)
            try:
                await show_costmaps(socket, link, lambda: self._access.admits(hello['user']))
            finally:
                await asyncio.to_thread(self._robots.costmaps.close, robot)
        except TimeoutError:  # the node is busy
            await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b'the node is busy')
        finally:
            self._costmap_pages -= 1
        return socket

    def operator(self, name: str, user: User) -> str:
        """Return the operator for a name and a user; '' for that of the server, and for those who only look."""
        return self._operator(name) if self._operator is not None and user.role > Role.OBSERVER else ''

    def _named(self, name: str) -> str | None:
        """Return the robot that a page requests by name, with or without the leading slash; None if it is unknown.
        Without a name, return our own robot if it is known, otherwise the most urgent one."""
        known = self._robots.fleet.names
        if name:
            return next((one for one in (name, f'/{name}') if one in known), None)
        own = self._robots.own
        return own if own in known else next((one.name for one in self._robots.fleet.overview()), own)

    def _not_found(self, name: str) -> str:
        meant = did_you_mean(f'/{name.strip("/")}', self._robots.fleet.names)
        return f'no robot {short_repr(name)} was found{meant or ", and no other one yet"}'


async def open_robot(robots: FleetLink, robot: str, operator: str = '') -> None:
    """Open a robot on another thread; raises what :meth:`FleetLink.open` does, and RuntimeError if there is no thread.

    Then it is not open, nor later: an executor keeps what it has refused for its next free thread.
    """
    is_given_up = threading.Event()

    def open() -> None:
        if not is_given_up.is_set():
            robots.open(robot, operator)
            if is_given_up.is_set():
                robots.close(robot, operator)

    try:
        await asyncio.to_thread(open)
    except BaseException:
        is_given_up.set()
        raise


# Run the server until the operator ends it.

SHUTDOWN_SECONDS: Final = 1.0

MOST_CONNECTIONS: Final = 256
"""Maximum number of connections, see :class:`_Connections`."""

REQUEST_SECONDS: Final = 10.0
"""Time that a new connection has to send a request, and that a connection may be idle after an answer, s. Then it is
closed."""

REPORT_SECONDS: Final = 10.0
"""Minimum time between two log lines about malformed requests, s."""

REPORT_CHARACTERS: Final = 200


def run_web(application: web.Application, access: Access, port: int, report: Callable[[str], None]) -> None:
    """Serve until SIGINT or SIGTERM. Call this on the main thread.

    ``port`` 0 chooses a free port. ``report`` is called with the address of the page.

    Raises:
        UsageError: the address or port cannot be used.
    """
    asyncio.run(_serve(application, access, port, report))


async def _serve(application: web.Application, access: Access, port: int, report: Callable[[str], None]) -> None:
    ended = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, ended.set)
    async with serving(application, access.address, port, access.certificate) as used:
        report(access.page_address(used))
        await ended.wait()


@contextlib.asynccontextmanager
async def serving(
    application: web.Application, address: str, port: int, certificate: ssl.SSLContext | None = None
) -> AsyncIterator[int]:
    """Serve during a ``with`` block, and yield the port. ``port`` 0 chooses a free one. HTTPS with a ``certificate``.

    Raises:
        UsageError: the address or port cannot be used.
    """
    connections = _Connections()
    application.middlewares.insert(0, connections.in_hand)
    application.on_response_prepare.append(connections.opened)
    application.on_shutdown.append(connections.close_sockets)
    runner = web.AppRunner(
        application,
        access_log=None,
        shutdown_timeout=SHUTDOWN_SECONDS,
        keepalive_timeout=REQUEST_SECONDS,
        logger=_request_logger(),
    )
    await runner.setup()
    try:
        assert runner.server is not None
        loop, accept = asyncio.get_running_loop(), partial(connections.accept, runner.server)
        try:
            listener = await loop.create_server(accept, address, port, reuse_address=True, ssl=certificate)
        except (OSError, OverflowError) as error:
            raise UsageError(
                f'cannot serve at {address}, port {port}: {error}; --port names another, --port 0 takes a free one'
            ) from None
        try:
            yield listener.sockets[0].getsockname()[1]
        finally:
            listener.close()
    finally:
        await runner.cleanup()


class _Connections:
    """The connections of a server. At most MOST_CONNECTIONS are open, plus those that arrive at the same moment: to
    accept a new one, the server closes idle ones, the oldest of the source with the most first.

    A connection needs no token, and aiohttp waits for its first request without limit. Here the limit is
    REQUEST_SECONDS.
    """

    def __init__(self) -> None:
        self._in_hand: set[object] = set()
        self._silent: set[object] = set()
        self._sockets: WeakSet[web.WebSocketResponse] = WeakSet()

    async def opened(self, request: web.Request, response: web.StreamResponse) -> None:
        """Note a WebSocket that is opened now."""
        if isinstance(response, web.WebSocketResponse):
            self._sockets.add(response)

    async def close_sockets(self, application: web.Application) -> None:
        """Tell all open pages that the server ends, and wait for their answers, at most SHUTDOWN_SECONDS.

        Without this, aiohttp waits twice as long for the pages to close.
        """
        closing = [one.close(code=WSCloseCode.GOING_AWAY, message=b'the server ends') for one in self._sockets]
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(SHUTDOWN_SECONDS):
                await asyncio.gather(*closing, return_exceptions=True)

    @web.middleware
    async def in_hand(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Mark the connection as busy while its request is answered; for a WebSocket, as long as it is open."""
        self._silent.discard(request.protocol)
        self._in_hand.add(request.protocol)
        try:
            return await handler(request)
        finally:
            self._in_hand.discard(request.protocol)

    def accept(self, server: web.Server) -> asyncio.Protocol:
        """Return the protocol of a new connection; close idle connections to make room."""
        known = [(one, one.transport) for one in server.connections]
        live = [(one, to) for one, to in known if isinstance(to, asyncio.Transport) and not to.is_closing()]
        idle = [(_source(to), to) for one, to in live if one not in self._in_hand]
        of_source = Counter(source for source, _ in idle)
        for _ in range(min(len(idle), len(live) - MOST_CONNECTIONS + 1)):  # several may have arrived together
            most = max(of_source, key=of_source.__getitem__)
            of_source[most] -= 1
            oldest = next(entry for entry in idle if entry[0] == most)
            idle.remove(oldest)
            oldest[1].abort()
        protocol = server()
        self._silent.add(protocol)
        asyncio.get_running_loop().call_later(REQUEST_SECONDS, self._end_silent, protocol)
        return protocol

    def _end_silent(self, protocol: web.RequestHandler) -> None:
        if protocol in self._silent:
            self._silent.discard(protocol)
            if isinstance(protocol.transport, asyncio.Transport):
                protocol.transport.abort()


def _source(transport: asyncio.Transport) -> str:
    address = transport.get_extra_info('peername')
    return source_of(address[0] if address else None)


class _MalformedRequests(logging.Filter):
    """A filter for aiohttp's log of malformed requests. Anybody may send these, so it passes one line every
    REPORT_SECONDS, without the traceback."""

    def __init__(self) -> None:
        super().__init__()
        self._reports = RepeatedReports(REPORT_SECONDS, time.monotonic)

    def filter(self, record: logging.LogRecord) -> bool:
        """See :class:`logging.Filter`."""
        error = record.exc_info[1] if record.exc_info else None
        if not isinstance(error, HttpProcessingError):
            return True
        held = self._reports.held_before()
        if held is None:
            return False
        more = f'; {held} more since the last such line' if held else ''
        record.msg, record.args = (
            f'a malformed request was refused: {one_line(str(error), REPORT_CHARACTERS)}{more}',
            (),
        )
        record.exc_info, record.levelno, record.levelname = None, logging.WARNING, 'WARNING'
        return True


def _request_logger() -> logging.Logger:
    logger = logging.Logger(f'{__name__}.requests')
    logger.parent = logging.getLogger(__name__)
    logger.addFilter(_MalformedRequests())
    return logger


def print_address(address: str) -> None:
    """Print the address of the page."""
    print(f'the page is at {address}  (Ctrl-C ends it; the robot continues)', flush=True)
