# SPDX-License-Identifier: BSD-3-Clause
"""Runs the server until the operator ends it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import signal
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from functools import partial
from typing import Final

from aiohttp import web
from aiohttp.http import HttpProcessingError
from aiohttp.typedefs import Handler

from flexbt_console.errors import UsageError
from flexbt_core.values import one_line

from .access import Access, source_of

SHUTDOWN_SECONDS: Final = 1.0

MOST_CONNECTIONS: Final = 256
"""Connections at the same time."""

REQUEST_SECONDS: Final = 10.0
"""A connection has asked for something by then, or is ended; and so long after an answer it may ask for more."""

TELL_SECONDS: Final = 10.0
"""Between two lines about requests that are none."""

TOLD_CHARACTERS: Final = 200


def run_web(application: web.Application, access: Access, port: int, told: Callable[[str], None]) -> None:
    """Serve at a port, 0 for one that is free, until SIGINT or SIGTERM; on the main thread.

    ``told`` gets the address of the page.

    Raises:
        UsageError: nothing can be served there.
    """
    asyncio.run(_serve(application, access, port, told))


async def _serve(application: web.Application, access: Access, port: int, told: Callable[[str], None]) -> None:
    ended = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, ended.set)
    async with serving(application, access.address, port) as used:
        told(access.page_address(used))
        await ended.wait()


@contextlib.asynccontextmanager
async def serving(application: web.Application, address: str, port: int) -> AsyncIterator[int]:
    """Serve at a port, 0 for one that is free, in the context; gives the port.

    Raises:
        UsageError: nothing can be served there.
    """
    connections = _Connections()
    application.middlewares.insert(0, connections.in_hand)
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
            listener = await loop.create_server(accept, address, port, reuse_address=True)
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
    """Of those that ask for nothing the oldest give way, those of the source that has the most first, so that there are
    no more than MOST_CONNECTIONS and what came at the same moment.

    A connection needs no token, and aiohttp waits for its first request for ever: here, for REQUEST_SECONDS.
    """

    def __init__(self) -> None:
        self._in_hand: set[object] = set()
        self._silent: set[object] = set()

    @web.middleware
    async def in_hand(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Marks the connections whose request is being answered; that of a WebSocket is as long as it is open."""
        self._silent.discard(request.protocol)
        self._in_hand.add(request.protocol)
        try:
            return await handler(request)
        finally:
            self._in_hand.discard(request.protocol)

    def accept(self, server: web.Server) -> asyncio.Protocol:
        """The protocol of one more connection."""
        known = [(one, one.transport) for one in server.connections]
        live = [(one, to) for one, to in known if isinstance(to, asyncio.Transport) and not to.is_closing()]
        idle = [(_source(to), to) for one, to in live if one not in self._in_hand]
        of_source = Counter(source for source, _ in idle)
        for _ in range(min(len(idle), len(live) - MOST_CONNECTIONS + 1)):  # several may have come together
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
    """Of what aiohttp logs of requests that are none, which anybody may send: a line now and then, without a trace."""

    def __init__(self) -> None:
        super().__init__()
        self._told_at = -math.inf
        self._held = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """See :class:`logging.Filter`."""
        error = record.exc_info[1] if record.exc_info else None
        if not isinstance(error, HttpProcessingError):
            return True
        now = time.monotonic()
        if now < self._told_at + TELL_SECONDS:
            self._held += 1
            return False
        more = f'; {self._held} more since the last such line' if self._held else ''
        self._told_at, self._held = now, 0
        record.msg, record.args = f'a malformed request was refused: {one_line(str(error), TOLD_CHARACTERS)}{more}', ()
        record.exc_info, record.levelno, record.levelname = None, logging.WARNING, 'WARNING'
        return True


def _request_logger() -> logging.Logger:
    logger = logging.Logger(f'{__name__}.requests')
    logger.parent = logging.getLogger(__name__)
    logger.addFilter(_MalformedRequests())
    return logger


def print_address(address: str) -> None:
    """Tell the operator where the page is."""
    print(f'the page is at {address}  (Ctrl-C ends it; the robot goes on)', flush=True)
