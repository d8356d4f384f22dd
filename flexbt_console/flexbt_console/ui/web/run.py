# SPDX-License-Identifier: BSD-3-Clause
"""Runs the server until the operator ends it."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Sequence

from aiohttp import web

from flexbt_console.errors import UsageError

from .access import Access


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
    runner = web.AppRunner(application, access_log=None, shutdown_timeout=1.0)
    ended = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, ended.set)
    await runner.setup()
    try:
        try:
            site = web.TCPSite(runner, access.address, port)
            await site.start()
        except (OSError, OverflowError) as error:
            raise UsageError(
                f'cannot serve at {access.address}, port {port}: {error}; '
                '--port names another, --port 0 takes a free one'
            ) from None
        told(access.page_address(runner.addresses[0][1]))
        await ended.wait()
    finally:
        await runner.cleanup()


def print_address(address: str) -> None:
    """Tell the operator where the page is."""
    print(f'the page is at {address}  (Ctrl-C ends it; the robot goes on)', flush=True)
