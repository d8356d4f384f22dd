# SPDX-License-Identifier: BSD-3-Clause
"""The screen of the terminal in a browser: textual-serve, with bounds, and closed to pages of other sites."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import aiohttp_jinja2
import jinja2
from aiohttp import web
from textual_serve.server import Server

from .access import CLOSED_HEADERS, Access, guard

MOST_SCREENS: Final = 8
"""Screens that are open at the same time: each is a process."""

_HEADERS: Final = {
    'Content-Security-Policy': (
        "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; img-src 'self'; "
        "font-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    **CLOSED_HEADERS,
}


class ScreenServer(Server):
    """Serves what a command shows: to each browser tab a process of its own, which ends with the tab.

    There is no token: whoever has an account on this computer reaches the robot in other ways, too. So it listens on
    this computer alone.
    """

    def __init__(self, command: Sequence[str], title: str, access: Access) -> None:
        super().__init__(f'exec {shlex.join(command)}', title=title)
        self._access = access
        self._open = 0

    def application(self) -> web.Application:
        """The application of aiohttp."""
        application = web.Application(middlewares=[guard(self._access)], client_max_size=0)
        application.on_response_prepare.append(_add_headers)
        aiohttp_jinja2.setup(application, loader=jinja2.FileSystemLoader(self.templates_path))
        application.router.add_get('/', self._index, name='index')
        application.router.add_get('/ws', self._screen, name='websocket')
        application.router.add_static('/static', Path(self.statics_path), name='static')
        return application

    async def _index(self, request: web.Request) -> web.StreamResponse:
        self.public_url = f'http://{request.host}'  # under whichever of its names the browser found us
        page: web.StreamResponse = await self.handle_index(request)
        return page

    async def _screen(self, request: web.Request) -> web.StreamResponse:
        if self._open >= MOST_SCREENS:
            raise web.HTTPServiceUnavailable(text=f'{MOST_SCREENS} screens are open already; close one')
        self._open += 1
        try:
            socket: web.StreamResponse = await self.handle_websocket(request)
            return socket
        finally:
            self._open -= 1


async def _add_headers(request: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(_HEADERS)
