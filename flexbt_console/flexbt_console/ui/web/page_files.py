# SPDX-License-Identifier: BSD-3-Clause
"""The files of a page, and the headers that keep the scripts of others out of it."""

from __future__ import annotations

from importlib.resources.abc import Traversable
from typing import Final

from aiohttp import web

from .access import CLOSED_HEADERS

_TYPES: Final = {'html': 'text/html', 'css': 'text/css', 'js': 'text/javascript', 'svg': 'image/svg+xml'}


class PageFiles:
    """The files of some folders by their names; '' is the page itself. Of two with one name the later one counts.

    ``scripts`` and ``images`` are from where they may come, as the Content-Security-Policy has it.
    """

    scripts = images = "'self'"

    def __init__(self, *folders: Traversable, page: str) -> None:
        self._contents: dict[str, tuple[bytes, str]] = {}
        for one in (one for folder in folders for one in folder.iterdir()):
            if (suffix := one.name.rpartition('.')[2]) in _TYPES:
                self.add(one.name, one.read_bytes(), suffix)
        self._contents[''] = self._contents[page]

    def add(self, name: str, content: bytes, suffix: str) -> None:
        """Add a file, which is of the type that this suffix means."""
        self._contents[name] = content, _TYPES[suffix]

    def text(self, name: str) -> str:
        """Return the text of a file."""
        return self._contents[name][0].decode()

    async def answer(self, request: web.Request) -> web.Response:
        """Answer a request for the file that ``name`` of the route names."""
        found = self._contents.get(request.match_info['name'])
        if found is None:
            raise web.HTTPNotFound(text='there is no such file')
        return self.response(found[0], request.host, found[1])

    def response(self, content: bytes, host: str, type: str) -> web.Response:
        """Return the answer with a content."""
        headers = {
            'Content-Security-Policy': (
                f"default-src 'none'; script-src {self.scripts}; style-src 'self'; img-src {self.images}; "
                f"connect-src 'self' ws://{host} wss://{host}; "
                "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
            ),
            **CLOSED_HEADERS,
            'Cache-Control': 'no-cache',
        }
        return web.Response(body=content, content_type=type, charset='utf-8', headers=headers)
