# SPDX-License-Identifier: BSD-3-Clause
"""An open page: send it the changes, and execute its requests."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import logging
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final

from aiohttp import WSCloseCode, WSMsgType, web

from flexbt_common.errors import ResourceError
from flexbt_console.errors import ConsoleError, RefusedError
from flexbt_console.mirror.fleet import RobotOverview
from flexbt_console.mirror.records import OperatorCommand
from flexbt_console.present.json_form import encode_json
from flexbt_console.present.style import tone_of
from flexbt_console.ui.station import Session, Station
from flexbt_core.clock.clock import SteadyClock
from flexbt_core.clock.rates import SenderRates
from flexbt_core.values.text import escape_lines, one_line

from .access import Access
from .drawings import NO_DRAWING, Drawing, Drawings, machine_drawing
from .past import PagePast, moment_part
from .picture import COMMAND_PART, PERIOD, Pictures, map_message, map_part, robot_lines
from .requests import (
    BURST,
    QUICK_CHARACTERS,
    RATE,
    SHOWS_PAST,
    folded_paths,
    is_harmless,
    is_stop,
    operator_name,
    past_of,
    read,
    understood,
)
from .users import User

PULSE: Final = 1.0
"""Seconds after which a page gets a message in any case: without it, it takes the server for lost."""

SEND_SECONDS: Final = 10.0
MOST_AT_ONCE: Final = 4
"""Requests of a page that wait for the robot or the simulator at the same time; more are refused."""

DRAWINGS_KEPT: Final = 16
"""Number of drawings that a page is assumed to have. It keeps more of them, since they arrive in another order than
requested."""

_LOGGER: Final = logging.getLogger(__name__)


class PageLink:
    """A page at its WebSocket after its first message, ``hello``; ``operator`` is the name that its user gives."""

    _pictures: Pictures
    _session: Session

    def __init__(
        self, socket: web.WebSocketResponse, drawings: Drawings, access: Access, hello: dict[str, Any]
    ) -> None:
        self.user: User = hello['user']
        self.operator = self.user.name or operator_name(hello)
        self._access = access
        self._socket = socket
        self._drawings = drawings
        self._changed = asyncio.Event()
        self._shown: Mapping[str, str] = {}
        self._log: frozenset[tuple[str, int]] = frozenset()
        self._drawn: dict[str, None] = {}
        self._map = b''
        self._is_past = False
        self._run: tuple[str, str] | None = None
        """Executive and run whose driven path the page has; None if it has none of now."""
        self._folded: frozenset[str] = frozenset()
        self._machine = NO_DRAWING
        self._tasks: set[asyncio.Task[None]] = set()
        self._waiting = 0
        self._left: Future[None] = Future()
        self._waits = ThreadPoolExecutor(MOST_AT_ONCE, 'waits')  # separate: nothing else waits for these threads
        self._reader = ThreadPoolExecutor(1, 'reader')
        self._reading = asyncio.Lock()
        self._unread = 0
        self._sending = asyncio.Lock()

    def wake(self) -> None:
        """Note a change; on the thread of the loop."""
        self._changed.set()

    async def serve(self, robot: str, station: Station, pictures: Pictures, past: PagePast, **features: bool) -> None:
        """Show a robot, and a line for each other one, until the page or server ends it.

        ``past`` is what the page can show of it, and of recordings. ``features`` are told to the page: ``asks_name``,
        it asks its user for a name; ``studio``, the studio is there.
        """
        self._past = past
        self._pictures, self._session = pictures, Session(station, SteadyClock())
        hello = {'robot': robot, 'commands': COMMAND_PART, 'operator': station.builder.operator, **features}
        try:
            await self._send({'hello': hello})
        except (ConnectionError, TimeoutError):
            return  # the page is gone
        show = asyncio.create_task(self._show())
        try:
            await self._hear()
        finally:
            await asyncio.sleep(0)  # a stop that came just before the end is sent
            self._left.set_result(None)
            for threads in (self._waits, self._reader):
                threads.shutdown(wait=False, cancel_futures=True)
            for task in (show, *self._tasks):
                task.cancel()
            await asyncio.gather(show, *self._tasks, return_exceptions=True)

    async def refuse(self, word: str, text: str, robots: Sequence[RobotOverview] = ()) -> None:
        """Send an accepted page the reason why it shows no robot, and the list of robots. The page retries."""
        with contextlib.suppress(ConnectionError, TimeoutError):
            await self._send({'refused': {'word': word, 'text': text, 'robots': robot_lines(robots)}})
        await self._socket.close(code=WSCloseCode.TRY_AGAIN_LATER)

    # Messages to the page

    async def _show(self) -> None:
        try:
            while self._access.admits(self.user):
                self._changed.clear()
                await self._tell_changes()
                await asyncio.sleep(PERIOD)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._changed.wait(), PULSE - PERIOD)
            await self._socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b'the user was removed')
        except (ConnectionError, TimeoutError):
            await self._socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b'the page takes nothing')
        except Exception as error:  # internal fault: the operator sees it, and gets a new page
            _LOGGER.exception('fault in the server of the page')
            text = ''.join(traceback.format_exception(error))
            with contextlib.suppress(Exception):
                await self._tell(['fault in the server of the page:', *escape_lines(text)], 'error')
            await self._socket.close(code=WSCloseCode.INTERNAL_ERROR, message=b'fault in the server, see its log')

    async def _tell_changes(self) -> None:
        picture = await self._pictures.newest()
        view = picture.view
        self._session.station.attention.pending([view, *(one.view for one in picture.robots)])
        new = {name: text for name, text in picture.parts.items() if self._shown.get(name) is not text}
        self._shown = picture.parts
        run = (view.snapshot.executive_id, view.snapshot.run_id) if view.snapshot else ('', '')
        if run != self._run:  # from then on the page follows the pose
            self._run = run
            new['driven'] = encode_json([[round(x, 2), round(y, 2)] for x, y in view.surroundings.driven])
        if picture.log.keys() - self._log:
            new['log'] = f'[{", ".join(text for key, text in picture.log.items() if key not in self._log)}]'
            self._log = frozenset(picture.log)
        new['times'] = picture.times
        drawing = machine_drawing(view.structure, self._folded) if view.structure else None
        if drawing and (drawing.key != self._machine or 'machine' in new):
            self._machine = drawing.key
            new['folded'] = encode_json(drawing.key)
        await self._send_text('{"parts": {' + ', '.join(f'"{name}": {text}' for name, text in new.items()) + '}}')
        if picture.map and picture.map is not self._map and not self._is_past:
            self._map = picture.map
            async with self._sending, asyncio.timeout(SEND_SECONDS):
                await self._socket.send_bytes(picture.map)
        if drawing:
            self._offer(drawing)
        for lines in self._session.news(view):
            await self._tell(lines, tone_of(lines[0]).name.lower())

    def _offer(self, drawing: Drawing) -> None:
        """Send a drawing that the page does not have."""
        if drawing.key != NO_DRAWING and drawing.key not in self._drawn:
            self._drawn[drawing.key] = None
            if len(self._drawn) > DRAWINGS_KEPT:
                del self._drawn[next(iter(self._drawn))]
            self._begin(self._draw(drawing.key, self._drawings.wanted(drawing)))

    async def _draw(self, key: str, made: asyncio.Task[str]) -> None:
        try:
            picture = await asyncio.shield(made)
        except ResourceError as error:
            await self._send({'drawing': {'key': key, 'problem': one_line(str(error))}})
        else:
            await self._send({'drawing': {'key': key, 'svg': picture}})

    async def _tell(self, text: list[str], tone: str) -> None:
        await self._send({'told': {'text': '\n'.join(text), 'tone': tone}})

    async def _send(self, message: Any) -> None:
        await self._send_text(encode_json(message))

    async def _send_text(self, text: str) -> None:
        async with self._sending, asyncio.timeout(SEND_SECONDS):
            await self._socket.send_str(text)

    # Messages of the page

    async def _hear(self) -> None:
        rates = SenderRates(RATE, BURST, time.monotonic)
        async for message in self._socket:
            if message.type is not WSMsgType.TEXT:
                await self._socket.close(code=WSCloseCode.UNSUPPORTED_DATA, message=b'messages are text')
                return
            if not self._access.admits(self.user):
                return
            if not rates.allows(b'page'):
                await self._socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b'too many messages')
                return
            self._begin(self._answer(message.data))

    def _begin(self, work: Any) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _answer(self, text: str) -> None:
        try:
            message = read(text)
            if 'fold' in message:
                self._folded = folded_paths(message)
                self._changed.set()
                return
            if asked := message.keys() & {'lanes', 'moment', 'recordings'}:
                try:
                    await self._show_past(message)
                except ConsoleError as error:
                    problem = {'problem': one_line(str(error)), 'of': message.get('of', '')}
                    await self._send({'lanes' if 'lanes' in asked else 'past': problem})
                return
            if self._is_past and not is_harmless(message):
                raise RefusedError(SHOWS_PAST)
            reading = functools.partial(
                understood, message, self._session, self._left, self._session.station.mirror.view().stops
            )
            if len(text) <= QUICK_CHARACTERS and is_stop(message):  # it waits for nothing
                answer = reading()()
            else:
                answer = await self._in_order(reading)
            if callable(answer):
                answer = await self._later(answer)
            if isinstance(answer, OperatorCommand):
                self._changed.set()
            elif isinstance(answer, dict):
                await self._send(answer)
            elif answer is not None and answer.title:
                data = {'data': answer.value} if message.get('data') is True else {}
                await self._send({'read': {'title': answer.title, 'text': '\n'.join(answer.text), **data}})
            elif answer is not None:
                await self._tell(answer.text, 'plain')
        except ConsoleError as error:
            await self._tell(escape_lines(str(error)), 'warning')
        except (ConnectionError, TimeoutError):
            pass  # the page is gone
        except Exception as error:
            text = ''.join(traceback.format_exception(error))
            with contextlib.suppress(ConnectionError, TimeoutError):
                await self._tell(['fault in the server of the page, which continues:', *escape_lines(text)], 'error')

    async def _in_order(self, reading: Callable[[], Callable[[], Any]]) -> Any:
        """Read a request on another thread, and carry it out after those before it. Raises ConsoleError."""
        if self._unread >= BURST:
            raise RefusedError(f'{BURST} requests of this page are not read yet; nothing was sent. Send it again later')
        self._unread += 1
        try:
            async with self._reading:
                carry_out = await asyncio.get_running_loop().run_in_executor(self._reader, reading)
            return carry_out()
        finally:
            self._unread -= 1

    async def _show_past(self, message: dict[str, Any]) -> None:
        """Send the lanes of the time line, a moment (None: now again), or the recordings. Raises ConsoleError."""
        if 'recordings' in message:
            await self._send({'recordings': await self._later(self._past.names)})
            return
        name, number = past_of(message)
        if 'lanes' in message:
            revision = int(number or 0)
            made_lanes = self._later(
                lambda: encode_json({'lanes': {'of': name, **self._past.of(name).lanes(revision)}})
            )
            await self._send_text(await made_lanes)
            return
        was_past, self._is_past = self._is_past, number is not None
        if number is None:
            self._map, self._run = (b'', None) if was_past else (self._map, self._run)  # they are sent again
            self._changed.set()
            return

        def made() -> tuple[Drawing | None, str, bytes]:
            mirror = self._past.of(name).moment(number)
            view = mirror.view()
            drawing = machine_drawing(view.structure, self._folded) if view.structure else None
            map = b'' if view.surroundings.map is None else map_message(*map_part(view.surroundings.map))
            more = {'of': name, 'time': number, 'folded': drawing.key if drawing else '', 'map': bool(map)}
            return drawing, encode_json({'past': {**moment_part(mirror, None), **more}}), map

        drawing, text, map = await self._later(made)
        is_new = self._is_past and map != self._map
        self._map = map if is_new else self._map
        if is_new and map:
            async with self._sending, asyncio.timeout(SEND_SECONDS):
                await self._socket.send_bytes(map)
        await self._send_text(text)
        if drawing:
            self._offer(drawing)

    async def _later(self, wait: Callable[[], Any]) -> Any:
        """On another thread. Raises ConsoleError."""
        if self._waiting >= MOST_AT_ONCE:
            raise RefusedError(f'{MOST_AT_ONCE} requests of this page wait for their answers; ask again later')
        self._waiting += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._waits, wait)
        finally:
            self._waiting -= 1
