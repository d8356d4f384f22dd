# SPDX-License-Identifier: BSD-3-Clause
"""Runs the server until the operator ends it."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import AsyncIterator, Callable, Sequence
from functools import partial
from typing import Final

from aiohttp import web
from aiohttp.typedefs import Handler

from flexbt_console.errors import UsageError

from .access import Access

SHUTDOWN_SECONDS: Final = 1.0

MOST_CONNECTIONS: Final = 256
"""Connections at the same time."""


def screen_application(command: Sequence[str], title: str, access: Access) -> web.Application:
    """What serves the screen that a command shows. Raises ModuleNotFoundError where textual-serve is missing."""
    from .screen_server import ScreenServer

    return ScreenServer(command, title, access).application()


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
    runner = web.AppRunner(application, access_log=None, shutdown_timeout=SHUTDOWN_SECONDS)
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
    """Of those that ask for nothing the oldest give way, so that there are no more than MOST_CONNECTIONS and what came
    at the same moment.

    A connection needs no token, and aiohttp waits for its first request for ever.
    """

    def __init__(self) -> None:
        self._in_hand: set[object] = set()

    @web.middleware
    async def in_hand(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Marks the connections whose request is being answered; that of a WebSocket is as long as it is open."""
        self._in_hand.add(request.protocol)
        try:
            return await handler(request)
        finally:
            self._in_hand.discard(request.protocol)

    def accept(self, server: web.Server) -> asyncio.Protocol:
        """The protocol of one more connection."""
        known = [(one, one.transport) for one in server.connections]
        live = [(one, to) for one, to in known if isinstance(to, asyncio.Transport) and not to.is_closing()]
        idle = [to for one, to in live if one not in self._in_hand]
        for transport in idle[: max(0, len(live) - MOST_CONNECTIONS + 1)]:  # several may have come together
            transport.abort()
        return server()


def print_address(address: str) -> None:
    """Tell the operator where the page is."""
    print(f'the page is at {address}  (Ctrl-C ends it; the robot goes on)', flush=True)
