# SPDX-License-Identifier: BSD-3-Clause
"""The first messages of pages at their WebSockets, with bounds for those who send none."""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from typing import Any, Final

from aiohttp import WSCloseCode, web

from flexbt_core.values.json_data import load_json

from .access import Access, WrongTokens, source_of

HELLO_SECONDS: Final = 10.0
"""Time for the first message of a page, s."""

MOST_GREETING: Final = 32
"""Maximum number of WebSockets that have not sent the first message of a page yet. To accept one more, the server
closes the oldest of the source that has the most."""

GREETING_OF_SOURCE: Final = 8
"""Maximum number of such WebSockets from one source."""


class Greetings:
    """The WebSockets of a server that have not sent their first message yet."""

    def __init__(self, access: Access) -> None:
        self._access = access
        self._wrong = WrongTokens()
        self._waiting: dict[asyncio.Transport, str] = {}
        """The source of each."""

    async def hello(self, socket: web.WebSocketResponse, request: web.Request) -> dict[str, Any] | None:
        """Return the first message of a page if it has the token; else close the WebSocket and return None.

        Nothing is sent before that. To make room, the oldest that waits is ended. The message gets the key ``user``.
        """
        transport, source = request.transport, source_of(request.remote)
        if transport is None:
            return None
        of_source = Counter(self._waiting.values())
        most = source
        if len(self._waiting) >= MOST_GREETING:
            most = max(of_source, key=of_source.__getitem__)
        if len(self._waiting) >= MOST_GREETING or of_source[most] >= GREETING_OF_SOURCE:
            oldest = next(one for one, its_source in self._waiting.items() if its_source == most)
            del self._waiting[oldest]
            oldest.abort()
        self._waiting[transport] = source
        try:
            return await self._received(socket, source)
        finally:
            self._waiting.pop(transport, None)

    async def _received(self, socket: web.WebSocketResponse, source: str) -> dict[str, Any] | None:
        with contextlib.suppress(TimeoutError, TypeError, ValueError, RecursionError):
            hello = load_json(await socket.receive_str(timeout=HELLO_SECONDS))
            if not isinstance(hello, dict):
                raise TypeError
            while wait := self._access.wait(self._wrong, source):
                await asyncio.sleep(wait)
            user = self._access.user_of(hello['hello']) if 'hello' in hello else None
            if user is not None:
                return {**hello, 'user': user}
            self._wrong.note(source)
        await socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b'the token is missing or wrong')
        return None
