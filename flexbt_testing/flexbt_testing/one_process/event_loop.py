# SPDX-License-Identifier: BSD-3-Clause
"""``asyncio`` on the scheduler: event loops wait on the clock of the world, and TCP connections are within it.

Tasks of asyncio, timers, ``to_thread`` and ``call_soon_threadsafe`` are those of the standard library. Servers of the
world are found by their port, whatever the host is called; bytes take as long as messages between the two processes
(:mod:`.network`). TLS, other kinds of sockets and processes are refused with a sentence. The only signal of a process
is the SIGTERM of its world.
"""

from __future__ import annotations

import asyncio
import errno
import itertools
import os
import signal
import socket
import weakref
from collections.abc import Callable
from functools import partial
from typing import Any, Final, NoReturn, cast

from .boundary import BOUNDARY, INSTEAD
from .graph import DOMAIN
from .scheduler import SCHEDULER, Process, Task

_FREE_PORTS: Final = 40_000
_REFUSED: Final = (
    'add_reader',
    'add_writer',
    'connect_read_pipe',
    'connect_write_pipe',
    'create_datagram_endpoint',
    'create_unix_connection',
    'create_unix_server',
    'start_tls',
    'subprocess_exec',
    'subprocess_shell',
)


class _Task(asyncio.Task[Any]):
    """A task whose place in a set does not depend on its address, nor on earlier worlds: sets decide the order of
    cancellations."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._number = next(DOMAIN.numbers)
        super().__init__(*args, **kwargs)

    def __hash__(self) -> int:
        return self._number


class _Selector:
    """Stand-in for the selector of an event loop. It waits for the clock of the world, and for other threads."""

    def __init__(self) -> None:
        self._waiting: Task | None = None
        self._is_woken = False

    def select(self, timeout: float | None) -> list[Any]:
        """Wait until :meth:`wake`, or for this time, s."""
        if not self._is_woken:
            if timeout is not None and timeout <= 0.0:
                SCHEDULER.yield_turn()
                return []
            self._waiting = SCHEDULER.current
            try:
                SCHEDULER.block('events of asyncio', None if timeout is None else SCHEDULER.after(timeout))
            finally:
                self._waiting = None
        self._is_woken = False
        return []

    def wake(self) -> None:
        """End the present or the next wait."""
        self._is_woken = True
        if self._waiting is not None:
            SCHEDULER.wake(self._waiting)


class _Transport(asyncio.Transport):
    """One end of a connection. The death of a process ends its connections, as the operating system does."""

    def __init__(self, loop: EventLoop, process: Process, protocol: asyncio.Protocol, own: Any, other: Any) -> None:
        super().__init__({'sockname': own, 'peername': other})
        self._loop, self._process, self._protocol = loop, process, protocol
        self._is_closing = self._is_paused = False
        self._arrived: list[bytes] = []
        self._times: dict[Any, int] = {}
        self.peer: _Transport | None = None
        self._process.kept_files.append(self.write_eof)

    def write(self, data: bytes | bytearray | memoryview[Any]) -> None:
        if data:
            self._send(bytes(data))

    def write_eof(self) -> None:
        self._send(b'')

    def _send(self, data: bytes) -> None:
        peer = self.peer
        if peer is not None and not self._is_closing:
            DOMAIN.transfer(self._process, peer._process, True, self._times, 0, lambda: peer._arrive(data))

    def can_write_eof(self) -> bool:
        return True

    def close(self) -> None:
        if not self._is_closing:
            self.write_eof()
            self._is_closing = True
            self._process.kept_files.remove(self.write_eof)
            self._loop.call_soon(self._protocol.connection_lost, None)

    abort = close

    def is_closing(self) -> bool:
        return self._is_closing

    def pause_reading(self) -> None:
        self._is_paused = True

    def resume_reading(self) -> None:
        self._is_paused = False
        self._loop.call_soon(self._take)

    def is_reading(self) -> bool:
        return not self._is_paused and not self._is_closing

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        self._protocol = cast('asyncio.Protocol', protocol)

    def get_protocol(self) -> asyncio.BaseProtocol:
        return self._protocol

    def get_write_buffer_size(self) -> int:
        return 0

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        pass

    def _arrive(self, data: bytes) -> None:
        if self._is_closing or not self._process.is_alive:
            if data and (peer := self.peer) is not None:
                DOMAIN.transfer(self._process, peer._process, True, self._times, 0, peer._reset)
        elif not self._loop.is_closed():
            self._arrived.append(data)
            self._loop.call_soon_threadsafe(self._take)

    def _reset(self) -> None:
        """End, since the other end takes no data any more."""
        if not self._is_closing and self._process.is_alive and not self._loop.is_closed():
            self._is_closing = True
            self._process.kept_files.remove(self.write_eof)
            error = ConnectionResetError(errno.ECONNRESET, os.strerror(errno.ECONNRESET))
            self._loop.call_soon_threadsafe(self._protocol.connection_lost, error)

    def _take(self) -> None:
        """Give what has arrived to the protocol; b'' is its end."""
        while self._arrived and self.is_reading():
            data = self._arrived.pop(0)
            if data:
                self._protocol.data_received(data)
            elif not self._protocol.eof_received():
                self.close()


class _Server(asyncio.AbstractServer):
    """A server of the world, and its own only socket. It listens from its creation on."""

    listening: Final[dict[int, _Server]] = {}
    """By port; those of dead processes and of closed loops do not count."""

    def __init__(self, loop: EventLoop, factory: Callable[[], asyncio.Protocol], host: str, port: int) -> None:
        self.loop, self.factory, self.process = loop, factory, SCHEDULER.current.process
        self._address = (host or '127.0.0.1', port)
        self.sockets = (self,)
        self._serving: asyncio.Future[None] | None = None
        _Server.listening[port] = self

    @classmethod
    def at(cls, port: int) -> _Server | None:
        """Return the server that listens at a port."""
        found = cls.listening.get(port)
        return found if found is not None and found.process.is_alive and not found.loop.is_closed() else None

    def getsockname(self) -> tuple[str, int]:
        return self._address

    def close(self) -> None:
        if _Server.at(self._address[1]) is self:
            del _Server.listening[self._address[1]]
        if self._serving is not None:
            self._serving.cancel()

    def get_loop(self) -> asyncio.AbstractEventLoop:
        return self.loop

    async def start_serving(self) -> None:
        pass

    async def serve_forever(self) -> None:
        self._serving = self.loop.create_future()
        try:
            await self._serving
        finally:
            self.close()

    def is_serving(self) -> bool:
        return _Server.at(self._address[1]) is self

    async def wait_closed(self) -> None:
        pass


class EventLoop(asyncio.BaseEventLoop):
    """An event loop of a task of the world."""

    def __init__(self) -> None:
        super().__init__()
        self._clock_resolution = 1e-9
        self._selector = _Selector()
        self._handled: set[int] = set()
        """The signals that have a handler."""
        self._connecting: weakref.WeakKeyDictionary[socket.socket, Any] = weakref.WeakKeyDictionary()
        self.set_task_factory(lambda loop, coroutine, **options: _Task(coroutine, loop=loop, **options))

    def _process_events(self, _events: list[Any]) -> None:
        pass

    def _write_to_self(self) -> None:
        self._selector.wake()

    def add_signal_handler(self, sig: int, callback: Callable[..., object], *args: Any) -> None:  # type: ignore[override]
        """Call the function when the process gets the signal."""
        _set_handler(sig, lambda *_: self.call_soon_threadsafe(callback, *args))
        self._handled.add(sig)

    def remove_signal_handler(self, sig: int) -> bool:
        """Let the signal do again what it does without a handler. Return False if there was none."""
        is_handled = sig in self._handled
        if is_handled:
            self._handled.remove(sig)
            _set_handler(sig, signal.SIG_DFL)
        return is_handled

    async def getaddrinfo(self, host: Any, port: Any, **_: Any) -> list[Any]:
        """Any name is that of an address of the world."""
        return [(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP, '', (host, int(port)))]

    async def create_server(  # type: ignore[override]
        self, factory: Callable[[], asyncio.Protocol], host: str | None = None, port: int | None = None, **options: Any
    ) -> _Server:
        _refuse_tls(options)
        found = port or next(one for one in itertools.count(_FREE_PORTS) if _Server.at(one) is None)
        if _Server.at(found) is not None:
            raise OSError(errno.EADDRINUSE, f'{os.strerror(errno.EADDRINUSE)}: port {found}')
        return _Server(self, factory, host or '', found)

    async def sock_connect(self, sock: socket.socket, address: Any) -> None:
        """Note whom the socket will be connected to."""
        if _Server.at(address[1]) is None:
            raise ConnectionRefusedError(errno.ECONNREFUSED, f'nobody listens at port {address[1]} in this world')
        self._connecting[sock] = address

    async def create_connection(  # type: ignore[override]
        self,
        factory: Callable[[], asyncio.Protocol],
        host: str | None = None,
        port: int | None = None,
        *,
        sock: socket.socket | None = None,
        **options: Any,
    ) -> tuple[asyncio.Transport, asyncio.Protocol]:
        _refuse_tls(options)
        address: Any = (host, port) if sock is None else self._connecting.pop(sock)
        if sock is not None:
            sock.close()
        server = _Server.at(address[1])
        if server is None:
            raise ConnectionRefusedError(errno.ECONNREFUSED, f'nobody listens at port {address[1]} in this world')
        protocol, own = factory(), ('127.0.0.1', next(DOMAIN.numbers))
        near = _Transport(self, SCHEDULER.current.process, protocol, own, address)

        def accepted() -> None:
            if not is_made.done():
                is_made.set_result(None)

        def accept() -> None:
            protocol = server.factory()
            far = _Transport(server.loop, server.process, protocol, address, own)
            far.peer, near.peer = near, far
            protocol.connection_made(far)
            self.call_soon_threadsafe(accepted)

        is_made = self.create_future()
        server.loop.call_soon_threadsafe(accept)
        await is_made
        protocol.connection_made(near)
        return near, protocol


def _refuse_tls(options: dict[str, Any]) -> None:
    if options.get('ssl'):
        BOUNDARY.stop('calls asyncio with TLS', 'a connection without it: no stranger listens in a world')


def _refusal(name: str) -> Any:
    instead = INSTEAD['subprocess.Popen' if 'process' in name else 'socket.connect']

    def refuse(*_: Any, **__: Any) -> NoReturn:
        BOUNDARY.stop(f'calls asyncio.{name}', instead)

    return refuse


for _name in _REFUSED:
    setattr(EventLoop, _name, _refusal(_name))


_real_signal: Final = signal.signal
_real_pause: Final = signal.pause


def _set_handler(signalnum: int, handler: Any) -> Any:
    """Stand-in for ``signal.signal``: the handlers of the computer belong to the test."""
    process = SCHEDULER.current.process
    if process is SCHEDULER.main.process:
        return _real_signal(signalnum, handler)
    if signalnum == signal.SIGTERM:
        handle = handler if callable(handler) else lambda *_: None  # SIG_IGN
        process.signal = None if handler == signal.SIG_DFL else partial(handle, signalnum, None)
    return signal.SIG_DFL


def _pause() -> None:
    """Stand-in for ``signal.pause``."""
    process = SCHEDULER.current.process
    if process is SCHEDULER.main.process:
        _real_pause()
        return
    process.pausing.append(SCHEDULER.current)
    SCHEDULER.block('a signal')


def _keep_for_test(real: Callable[..., Any], instead: str, *arguments: Any, **named: Any) -> Any:
    """Stand-in for functions whose signals would come to the test, or for whose sockets the whole world would wait."""
    if BOUNDARY.is_inside:
        BOUNDARY.stop(f'calls {real.__module__.lstrip("_")}.{real.__name__}', instead)
    return real(*arguments, **named)


class _Policy(asyncio.DefaultEventLoopPolicy):
    _loop_factory = EventLoop


def install() -> None:
    """Let ``asyncio.run`` and its like take the loop here, and let programs handle the signals of their process."""
    signal.signal, signal.pause = _set_handler, _pause
    timer = 'threading.Timer, or a timer of a node'
    signal.alarm = partial(_keep_for_test, signal.alarm, timer)
    signal.setitimer = partial(_keep_for_test, signal.setitimer, timer)
    socket.socketpair = partial(_keep_for_test, socket.socketpair, 'queue.Queue between threads')
    asyncio.set_event_loop_policy(_Policy())
