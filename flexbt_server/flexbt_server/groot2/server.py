# SPDX-License-Identifier: BSD-3-Clause
"""The server that Groot2 connects to. It shows one tree at a time, and needs no ROS::

with Groot2Server(1667) as groot2:
    with groot2.watch(tree):
        tree.tick_while_running(wait)
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import TracebackType
from typing import Final

import zmq

from flexbt_core.behavior_tree.engine.node import StatusObserver
from flexbt_core.behavior_tree.engine.observers import StatusLog
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard_json import JsonTypes

from . import protocol
from .json_requests import RequestError, parse
from .log_file import LogBuffer
from .protocol import RequestType
from .watched_tree import WatchedTree, clock

SILENCE: Final = 5.0
"""Time without a request after which the client counts as gone, s: its hooks block nothing until it returns."""

LARGEST_REQUEST: Final = 1 << 20
_SEND_MILLISECONDS: Final = 1000
_logger = logging.getLogger(__name__)


class Groot2Server:
    """A server that shows running trees to Groot2, on ``port`` for requests and the next port for breakpoints that were
    reached.

    Clients see the tree that started last. When it ends, they see the latest tree that still runs, or else the ended
    one. A tree that a breakpoint holds when another one starts stays visible until it ends. Each run has a unique ID,
    by which clients notice a new run. Hooks of hidden trees have no effect. The next run of the same tree inherits the
    hooks of the visible tree.

    With ``only``, the ID of a tree, clients see only runs of this tree.
    """

    def __init__(
        self,
        port: int = protocol.DEFAULT_PORT,
        address: str = '127.0.0.1',
        *,
        only: str = '',
        types: JsonTypes | None = None,
        silence: float = SILENCE,
    ) -> None:
        """Begin to answer. ``types`` converts blackboard values of custom types. Raises OSError if it cannot listen."""
        self._only = only
        self._types = types if types is not None else JsonTypes()
        self._silence = silence
        self._running: list[WatchedTree] = []
        self._shown: WatchedTree | None = None
        self._silent = False
        self._lock = threading.Lock()
        self._publishing = threading.Lock()
        self._context = zmq.Context()
        try:
            self._replies = self._bound(zmq.REP, address, port)
            self._notices = self._bound(zmq.PUB, address, port + 1)
            self._stop = self._context.socket(zmq.PAIR)
            self._stop.bind('inproc://stop')
            self._stopped = self._context.socket(zmq.PAIR)
            self._stopped.connect('inproc://stop')
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise OSError(
                error.errno, f'cannot listen on {address}, ports {port} and {port + 1}, for Groot2: {error}'
            ) from error
        self._thread = threading.Thread(target=self._serve, name='groot2', daemon=True)
        self._thread.start()

    def _bound(self, kind: int, address: str, port: int) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        socket.set(zmq.LINGER, 0)
        socket.set(zmq.SNDTIMEO, _SEND_MILLISECONDS)
        socket.set(zmq.MAXMSGSIZE, LARGEST_REQUEST)
        socket.set(zmq.IPV6, ':' in address)
        socket.bind(f'tcp://{f"[{address}]" if ":" in address else address}:{port}')
        return socket

    def __enter__(self) -> Groot2Server:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the server. Every tree that a breakpoint holds continues."""
        with suppress(zmq.ZMQError):
            self._stop.send(b'')
        self._thread.join()  # a request would set the hooks off again
        self._hear(silent=True)
        with self._publishing:
            self._context.destroy(linger=0)

    # -- the trees -----------------------------------------------------------------------------------------------------

    def add(
        self, tree: Tree, log: LogBuffer, on_held: Callable[[bool], None] = lambda held: None
    ) -> WatchedTree | None:
        """Show a tree before its first tick. Return None if the server does not show it.

        The tree writes to ``log``, with the clock of ``watched_tree``. Call ``settle`` of the returned object after
        each round. ``on_held`` is called on the ticking thread when a breakpoint holds or releases the tree.
        """
        if self._only and tree.key.id != self._only:
            return None
        if not self._fits(tree):
            return None
        watched = WatchedTree(tree, log, self._types, self._tell, on_held)
        with self._lock:
            before = self._shown
            if before is not None and before.same_tree(watched):
                watched.breakpoints.take_over(before.breakpoints)
            self._running.append(watched)
            if before is None or not before.breakpoints.held:
                self._shown = watched
            self._mute()
        return watched

    def expanded(self, before: WatchedTree, on_held: Callable[[bool], None] = lambda held: None) -> WatchedTree | None:
        """Replace a watched tree whose nodes have changed between two ticks; clients see another tree. Return the new
        watched tree, or None if it is too large."""
        before.end()
        if not self._fits(before.tree):
            before.breakpoints.end()
            self.remove(before)
            return None
        watched = WatchedTree(before.tree, before.log, self._types, self._tell, on_held)
        with self._lock:
            watched.breakpoints.take_over_from(before.breakpoints)
            self._running[self._running.index(before)] = watched
            if self._shown is before:
                self._shown = watched
            self._mute()
        return watched

    def _fits(self, tree: Tree) -> bool:
        count = len(tree.nodes)
        if count > protocol.MAX_UID:
            _logger.warning('tree [%s] has %d nodes: Groot2 can show %d', tree.key.id, count, protocol.MAX_UID)
        return count <= protocol.MAX_UID

    def remove(self, watched: WatchedTree) -> None:
        """Stop showing a tree whose run is over."""
        with self._lock:
            self._running.remove(watched)
            if self._shown is watched and self._running:
                self._shown = self._running[-1]
            self._mute()

    def watch(self, tree: Tree) -> WatchHandle:
        """Return a context manager that shows a tree, for programs without another observer."""
        return WatchHandle(self, tree)

    def _mute(self) -> None:
        for watched in self._running:
            watched.breakpoints.mute(self._silent or watched is not self._shown)

    def _tell(self, uid: int) -> None:
        """Publish a reached breakpoint. On the thread of a run."""
        header = protocol.request_header(RequestType.BREAKPOINT_REACHED)
        with self._publishing, suppress(zmq.ZMQError):
            self._notices.send_multipart([header, str(uid).encode()], zmq.NOBLOCK)

    # -- requests ------------------------------------------------------------------------------------------------------

    def _serve(self) -> None:
        poller = zmq.Poller()
        poller.register(self._replies, zmq.POLLIN)
        poller.register(self._stopped, zmq.POLLIN)
        heard = time.monotonic()
        while True:
            wait = None if self._silent else int(max(0.0, heard + self._silence - time.monotonic()) * 1000.0) + 1
            ready = dict(poller.poll(wait))
            if self._stopped in ready:
                return
            if self._replies in ready:
                heard = time.monotonic()
                self._hear(silent=False)
                # Ignore clients that have gone, and data that is not a message.
                with suppress(zmq.ZMQError):
                    self._replies.send_multipart(self.answer(self._replies.recv_multipart()))
            elif time.monotonic() >= heard + self._silence:
                self._hear(silent=True)

    def _hear(self, silent: bool) -> None:
        with self._lock:
            if silent is not self._silent:
                self._silent = silent
                self._mute()

    def answer(self, frames: Sequence[bytes]) -> list[bytes]:
        """Return the frames of the reply to a request with any frames."""
        try:
            return self._answer(frames)
        except RequestError as error:
            text = str(error)
        except Exception:  # an internal fault must not end the server
            _logger.exception('a request of Groot2 could not be answered')
            text = 'Unknown error while processing request'
        return [b'error', text.encode('utf-8', 'replace')]

    def _answer(self, frames: Sequence[bytes]) -> list[bytes]:
        if not frames or len(frames[0]) != protocol.HEADER_BYTES:
            raise RequestError('wrong request header')
        with self._lock:
            shown = self._shown
        if shown is None:
            raise RequestError('no tree has been started yet')
        kind = frames[0][1]
        if kind in _WITH_CONTENT:
            if len(frames) != 2:
                raise RequestError('must be 2 parts message')
            content = _WITH_CONTENT[kind](shown, frames[1])
        elif kind in _PLAIN:
            content = _PLAIN[kind](shown)
        else:
            raise RequestError('Request not recognized')
        return [protocol.reply_header(frames[0], shown.uuid), *([] if content is None else [content])]


_PLAIN: Final[dict[int, Callable[[WatchedTree], bytes | None]]] = {
    RequestType.FULL_TREE: WatchedTree.document,
    RequestType.STATUS: WatchedTree.statuses,
    RequestType.HOOKS_DUMP: lambda shown: shown.breakpoints.dump().encode(),
    RequestType.REMOVE_ALL_HOOKS: lambda shown: shown.breakpoints.remove_all(),
    RequestType.DISABLE_ALL_HOOKS: lambda shown: shown.breakpoints.disable_all(),
    RequestType.GET_TRANSITIONS: WatchedTree.transitions,
}

_WITH_CONTENT: Final[dict[int, Callable[[WatchedTree, bytes], bytes | None]]] = {
    RequestType.BLACKBOARD: lambda shown, content: shown.blackboards(content.decode('utf-8', 'replace')),
    RequestType.HOOK_INSERT: lambda shown, content: shown.breakpoints.insert(parse(content)),
    RequestType.HOOK_REMOVE: lambda shown, content: shown.breakpoints.remove(parse(content)),
    RequestType.BREAKPOINT_UNLOCK: lambda shown, content: shown.breakpoints.unlock(parse(content)),
    RequestType.TOGGLE_RECORDING: WatchedTree.toggle_recording,
}


class WatchHandle:
    """A context manager that shows a tree, and observes it meanwhile (:meth:`Tree.observe`)."""

    def __init__(self, server: Groot2Server, tree: Tree) -> None:
        self._server = server
        self._tree = tree
        self._watched: WatchedTree | None = None
        self._observers: tuple[StatusObserver, ...] | None = None

    def __enter__(self) -> WatchHandle:
        log = LogBuffer(clock)
        self._watched = self._server.add(self._tree, log)
        if self._watched is not None:
            self._observers = self._tree.observers
            self._tree.observe(
                *self._observers, StatusLog(log), after_round=self._settle, on_expanded=self._tell_of_expansion
            )
        return self

    def _settle(self) -> None:
        if self._watched is not None:
            self._watched.settle()

    def _tell_of_expansion(self) -> None:
        if self._watched is not None:
            self._watched = self._server.expanded(self._watched)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._observers is not None:
            self._tree.observe(*self._observers)
        if self._watched is not None:
            self._server.remove(self._watched)
