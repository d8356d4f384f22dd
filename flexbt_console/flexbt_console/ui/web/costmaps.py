# SPDX-License-Identifier: BSD-3-Clause
"""The costmaps of a robot for its page, by a WebSocket of their own: they never keep a decision or a STOP waiting."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any, Final

from aiohttp import WSCloseCode, WSMsgType, web

from flexbt_common import names
from flexbt_console.link.costmap_link import Costmap, CostmapLink
from flexbt_console.present.json_form import fields_of
from flexbt_core.clock.rates import SenderRates
from flexbt_core.values.json_data import load_json

from .picture import map_message
from .requests import BURST, RATE

PERIOD: Final = 1.0
"""Least time between two costmaps of a kind, s."""
SEND_SECONDS: Final = 10.0


async def show_costmaps(socket: web.WebSocketResponse, link: CostmapLink, admitted: Callable[[], bool]) -> None:
    """Send those costmaps that the page asks for by ``{"show": [NAME, ...]}``, until it ends, or is not admitted."""
    wanted: list[str] = []
    asks = asyncio.Event()

    async def send() -> None:
        shown: dict[str, Costmap] = {}
        while admitted():
            asks.clear()
            for name in wanted:
                costmap = link.newest.get(name)
                if costmap is not None and costmap is not shown.get(name):
                    shown[name] = costmap
                    head = {**fields_of(costmap, 'cells'), 'costmap': name}
                    async with asyncio.timeout(SEND_SECONDS):
                        await socket.send_bytes(map_message(head, costmap.cells))
            await asyncio.sleep(PERIOD)
            if not wanted:
                await asks.wait()

    async def send_and_close() -> None:
        try:
            await send()
        finally:
            await socket.close()

    sending = asyncio.create_task(send_and_close())
    sending.add_done_callback(lambda done: None if done.cancelled() else done.exception())
    rates = SenderRates(RATE, BURST, time.monotonic)
    try:
        async for message in socket:
            if not rates.allows(b'page'):
                await socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b'too many messages')
                return
            names_asked = _asked(message.data) if message.type is WSMsgType.TEXT else None
            if names_asked is None:
                await socket.close(code=WSCloseCode.UNSUPPORTED_DATA, message=b'a request is {"show": [NAME, ...]}')
                return
            wanted[:] = [name for name in names.COSTMAPS if name in names_asked]
            asks.set()
    finally:
        sending.cancel()
        with contextlib.suppress(asyncio.CancelledError, ConnectionError, TimeoutError):
            await sending


def _asked(text: str) -> list[Any] | None:
    try:
        asked = load_json(text)
    except (ValueError, RecursionError):
        return None
    found = asked.get('show') if isinstance(asked, dict) else None
    return found if isinstance(found, list) else None
