# SPDX-License-Identifier: BSD-3-Clause
"""A program of BehaviorTree.CPP as a robot of the live view: a client of the protocol by which Groot2 watches it.

The program sends the XML of its tree, the statuses of the nodes, blackboards, and the breakpoints that were reached. It
has breakpoints and fixed results of nodes; there they are called hooks.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import shlex
import time
from collections.abc import Awaitable, Callable, Iterator
from typing import Any, Final

import msgpack
import zmq
import zmq.asyncio

from flexbt_console.mirror.records import BreakpointKind, ExecutiveSnapshot, TreeBreakpoint, TreeHold
from flexbt_core.behavior_tree.model.errors import Source, TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.xml.parser import Element, parse
from flexbt_core.values.text import did_you_mean, one_line, short_repr, xml_attribute
from flexbt_server.groot2.log_file import described_nodes
from flexbt_server.groot2.protocol import (
    DEFAULT_PORT,
    RefusedRequest,
    RequestType,
    read_reply,
    read_statuses,
    request_header,
)
from flexbt_studio.documents.project import MOST_BYTES
from flexbt_studio.errors import StudioError

from .jobs import Tell
from .live import debugged

PERIOD: Final = 0.1
"""Time between two requests for statuses, s. After 5 s without any, a program ignores its hooks."""
RESTS: Final = 3.0
"""Times as long as a request took, until the next one: a tree of 65,535 nodes is asked for less often."""
LONGEST_REST: Final = 1.0
"""Time at most until the next request, s."""
HOOKS_SECONDS: Final = 1.0
"""Time between two requests for the hooks that are known, s: others may have removed them."""
ANSWER_SECONDS: Final = 3.0
"""Time for an answer, s; then the program counts as lost, and is asked again."""
LARGEST_ANSWER: Final = 32 << 20
"""Maximum size of an answer, bytes."""
LONGEST_VALUE: Final = 1000
"""Maximum number of characters of a value of a blackboard that are shown."""
PREFIX: Final = 'groot2 '
_MAX_DEPTH: Final = 1000
_ADDRESS: Final = re.compile(r'(?:(?P<host>[^:\s]+|\[[0-9a-fA-F:.%]+\]):)?(?P<port>\d{1,5})')
_RESULTS: Final = ('SUCCESS', 'FAILURE', 'SKIPPED')

Show = Callable[[str, str], Awaitable[None]]


def robot_name(address: str) -> str:
    """Return the name of the program at an address HOST:PORT. Raises StudioError if it is none."""
    found = _ADDRESS.fullmatch(address.strip())
    if found is None or not 0 < int(found['port']) < 65535:
        raise StudioError(
            f"{short_repr(address)} is no address of a program with Groot2's port: write HOST:PORT, as in "
            f'127.0.0.1:{DEFAULT_PORT}'
        )
    return f'{PREFIX}{found["host"] or "127.0.0.1"}:{int(found["port"])}'


class Groot2Robot:
    """The program that :func:`robot_name` names. Used on the thread of the loop.

    ``tell`` sends an event to all pages; ``show`` opens a document that cannot be edited, by the name of the file and
    its text.
    """

    def __init__(self, name: str, tell: Tell, show: Show) -> None:
        self.name = name
        self._host, _, port = name.removeprefix(PREFIX).rpartition(':')
        self._port = int(port)
        self._tell = tell
        self._show = show
        self._context = zmq.asyncio.Context()
        self._requests: zmq.asyncio.Socket | None = None
        self._ends: zmq.asyncio.Socket | None = None
        """Where the ends of the connection are told."""
        self._asking = asyncio.Lock()
        self._looking = asyncio.Lock()
        self._tree = b''
        """What identifies the tree that is known; nothing while none is."""
        self._trees = 0
        """Number of trees that were read."""
        self._refused = b'', ''
        """What identifies a tree that cannot be shown, and why."""
        self._nodes: dict[int, str] = {}
        """Path of each node of that tree in a run, by its uid."""
        self._boards: dict[str, str] = {}
        """Path of each sub-tree, by the name of its blackboard."""
        self._id = self._file = ''
        self._statuses: dict[int, NodeStatus] = {}
        self._held = 0
        """Uid of the node at whose breakpoint the tree stands; 0 for none."""
        self._held_since = 0.0
        self._points: dict[int, TreeBreakpoint] = {}
        """What is set before the tick of each node."""
        self._hooks_due = 0.0
        self._problem = 'it has not answered yet'
        self._shown: dict[str, Any] = {}
        self._task = asyncio.create_task(self._watch())

    async def close(self) -> None:
        """Stop watching. The program goes on, without the breakpoints that were set here."""
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        if not self._problem:
            with contextlib.suppress(StudioError):
                await self._ask(RequestType.REMOVE_ALL_HOOKS)
        self._context.destroy(linger=0)

    def show_again(self) -> None:
        """Send the event, even if it is the same: a page asks that has not seen it."""
        self._shown = {}
        self._show_event()

    async def command(self, line: str) -> Any:
        """Carry out a line of the operator, as of the console. The options that name the tree are not needed.

        ``break NODE``, ``tree run-to NODE``, ``tree force NODE RESULT`` (once), ``tree dummy NODE RESULT``, ``tree
        continue``, ``tree clear [NODE]``, by which a tree that is held there goes on, and ``tree blackboard``, which
        returns what the console returns for it.

        Raises StudioError if it cannot be done.
        """
        match _words(line):
            case ['break', path]:
                await self._insert(path, is_break=True)
            case ['tree', 'force' | 'dummy' as how, path, str(result)] if result in _RESULTS:
                await self._insert(path, result, once=how == 'force')
            case ['tree', 'clear']:
                await self._ask(RequestType.REMOVE_ALL_HOOKS)
            case ['tree', 'clear', path]:
                await self._ask(RequestType.HOOK_REMOVE, _json({'uid': self._uid(path), 'position': 0}))
            case ['tree', 'run-to', path]:
                point = self._points.get(self._uid(path))
                if point is None or point.kind is not BreakpointKind.BREAK or point.problem:
                    await self._insert(path, is_break=True, once=True)  # else it is reached anyway
                if self._held:
                    await self._unlock()
            case ['tree', 'continue']:
                if not self._held:
                    raise StudioError('the tree is held at no breakpoint')
                await self._unlock()
            case ['tree', 'blackboard']:
                return await self._blackboards()
            case _:
                raise StudioError(f'{short_repr(line)}: this is not possible with a program that is watched by Groot2')
        await self._read_hooks()
        self._show_event()
        return None

    async def _insert(self, path: str, result: str = 'SKIPPED', *, is_break: bool = False, once: bool = False) -> None:
        hook: dict[str, Any] = {'uid': self._uid(path), 'position': 0, 'enabled': True, 'once': once}
        hook |= {'mode': 0 if is_break else 1, 'desired_status': result}
        await self._ask(RequestType.HOOK_INSERT, _json(hook))

    async def _unlock(self) -> None:
        wanted = {'uid': self._held, 'position': 0, 'desired_status': 'SKIPPED', 'remove_when_done': False}
        await self._ask(RequestType.BREAKPOINT_UNLOCK, _json(wanted))
        self._held = 0

    def _uid(self, path: str) -> int:
        uids = {one: uid for uid, one in self._nodes.items()}
        if path not in uids:
            raise StudioError(f'the tree of {self.name} has no node {short_repr(path)}{did_you_mean(path, list(uids))}')
        return uids[path]

    # What the program says.

    async def _watch(self) -> None:
        hearing = asyncio.create_task(self._hear())
        try:
            while True:
                began = time.monotonic()
                try:
                    async with self._looking:
                        await self._look()
                    self._problem = ''
                except StudioError as error:
                    self._problem = one_line(str(error), 300)
                self._show_event()
                await asyncio.sleep(min(max(PERIOD, RESTS * (time.monotonic() - began)), LONGEST_REST))
        finally:
            hearing.cancel()
            await asyncio.gather(hearing, return_exceptions=True)

    async def _look(self) -> None:
        """Ask for the statuses, and first for the tree if it is another one. Raises StudioError.

        What identifies a tree is the same each time a program of BehaviorTree.CPP 4.8 is started, so the tree is asked
        for after each end of the connection as well.
        """
        tree, statuses = await self._ask_statuses()
        if self._ends is not None and await self._ends.poll(0):
            while await self._ends.poll(0):
                await self._ends.recv_multipart()
            self._forget()
        if tree == self._refused[0]:
            raise StudioError(self._refused[1])
        if tree != self._tree or statuses.keys() != self._nodes.keys():
            await self._read_tree()
            await self._read_hooks()
            return
        if self._held and self._statuses and statuses != self._statuses:
            self._held = 0  # somebody else has let it go on
        self._statuses = statuses
        if (self._points and time.monotonic() >= self._hooks_due) or any(one.once for one in self._points.values()):
            await self._read_hooks()  # they may be gone

    def _forget(self) -> None:
        """Ask for the tree before its statuses are shown again."""
        self._tree, self._refused = b'', (b'', '')

    async def _ask_statuses(self) -> tuple[bytes, dict[int, NodeStatus]]:
        tree, content = await self._ask(RequestType.STATUS)
        try:
            return tree, read_statuses(content)
        except ValueError as error:
            raise StudioError(f'{self.name}: {error}') from error

    async def _read_tree(self) -> None:
        tree, content = await self._ask(RequestType.FULL_TREE)
        text = content.decode('utf-8', 'replace')
        try:
            known = await asyncio.to_thread(described, self.name, text)
        except StudioError as error:
            self._refused = tree, str(error)
            raise
        self._id, document, self._nodes, self._boards = known
        self._tree, self._statuses, self._held = tree, {}, 0
        self._trees += 1
        self._file = f'{self.name}.xml'
        await self._show(self._file, document)

    async def _read_hooks(self) -> None:
        self._hooks_due = time.monotonic() + HOOKS_SECONDS
        try:
            _, content = await self._ask(RequestType.HOOKS_DUMP)
            self._points = {
                int(one['uid']): TreeBreakpoint(
                    BreakpointKind.BREAK
                    if one['mode'] == 0
                    else BreakpointKind.FORCE
                    if one['once'] is True
                    else BreakpointKind.DUMMY,
                    self._id,
                    self._nodes[one['uid']],
                    status=NodeStatus[one['desired_status']] if one['mode'] else 0,
                    once=one['once'] is True,
                    stamp=self._points[one['uid']].stamp if one['uid'] in self._points else time.time(),
                    problem='' if one['enabled'] is True else 'it is disabled',
                )
                for one in json.loads(content)
                if one['uid'] in self._nodes and one['position'] == 0
            }
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise StudioError(f'{self.name} sends no list of hooks: {error!r}') from error
        if self._held not in self._points:
            self._held = 0

    async def _blackboards(self) -> dict[str, Any]:
        """Return all entries, as the console does for "tree blackboard". Who wrote them is not told by programs."""
        _, content = await self._ask(RequestType.BLACKBOARD, ';'.join(self._boards).encode())
        try:
            boards = msgpack.unpackb(content, strict_map_key=False, unicode_errors='replace') or {}
            entries = [
                {
                    'scope': self._boards.get(str(name), str(name)),
                    'key': str(key),
                    'text': json.dumps(value, default=repr, ensure_ascii=False)[:LONGEST_VALUE],
                    'writes': [],
                }
                for name, board in boards.items()
                for key, value in (board or {}).items()
            ]
        except (ValueError, TypeError, AttributeError, RecursionError, msgpack.exceptions.UnpackException) as error:
            raise StudioError(f'{self.name} sends no blackboards: {error!r}') from error
        return {'tree': self._id, 'recorded': True, 'entries': entries}

    async def _hear(self) -> None:
        """Note the breakpoints that are reached."""
        notices = self._socket(zmq.SUB, self._port + 1)
        notices.set(zmq.SUBSCRIBE, b'')
        while True:
            frames = await notices.recv_multipart()
            text = frames[1] if len(frames) == 2 else b''
            uid = int(text) if text.isdigit() and len(text) < 6 else 0
            if uid in self._points and self._points[uid].kind is not BreakpointKind.BREAK:
                continue
            async with self._looking:
                with contextlib.suppress(StudioError):
                    await self._look()  # it may be another tree by now
                    if uid in self._nodes and uid not in self._points:  # somebody else has set it
                        await self._read_hooks()
                if uid in self._points and self._points[uid].kind is BreakpointKind.BREAK:
                    self._held, self._held_since = uid, time.time()
                    self._show_event()

    # The protocol.

    def _socket(self, kind: int, port: int) -> zmq.asyncio.Socket:
        socket = self._context.socket(kind)
        socket.set(zmq.LINGER, 0)
        socket.set(zmq.MAXMSGSIZE, LARGEST_ANSWER)
        socket.set(zmq.IPV6, self._host.startswith('['))
        try:
            socket.connect(f'tcp://{self._host}:{port}')
        except zmq.ZMQError as error:
            socket.close()
            raise StudioError(f'{self.name}: {error}') from error
        return socket

    async def _ask(self, type: RequestType, *content: bytes) -> tuple[bytes, bytes]:
        """Return what identifies the tree, and the content of the answer. Raises StudioError."""
        async with self._asking:
            header = request_header(type)
            answered = False
            try:
                if self._requests is None:
                    self._requests = self._socket(zmq.REQ, self._port)
                    self._ends = self._requests.get_monitor_socket(zmq.EVENT_DISCONNECTED)
                async with asyncio.timeout(ANSWER_SECONDS):
                    await self._requests.send_multipart([header, *content])
                    frames = await self._requests.recv_multipart()
                answered = True
                return read_reply(header, frames)
            except (TimeoutError, zmq.ZMQError):
                raise StudioError(
                    f'{self.name} does not answer within {ANSWER_SECONDS:g} s; is it a program with a Groot2Publisher?'
                ) from None
            except RefusedRequest as error:
                raise StudioError(f'{self.name}: {one_line(str(error), 300)}') from error
            except ValueError as error:
                raise StudioError(f'{self.name} speaks another protocol than Groot2: {error}') from error
            finally:
                if not answered and self._requests is not None:  # a REQ socket waits for its answer forever
                    self._requests.disable_monitor()
                    self._requests.close()
                    self._requests = self._ends = None
                    self._forget()

    # What pages are told.

    def _show_event(self) -> None:
        event = self._event()
        if event != self._shown:
            self._shown = event
            self._tell(event)

    def _event(self) -> dict[str, Any]:
        is_running = NodeStatus.RUNNING in self._statuses.values()
        tree: dict[str, Any] = {
            'run': f'{self.name} {self._trees}',
            'tree': self._id,
            'file': self._file,
            'running': is_running,
            'nodes': len(self._nodes),
            'statuses': {self._nodes[uid]: status.name for uid, status in self._statuses.items() if status},
        }
        hold = TreeHold(tree['run'], self._id, self._nodes.get(self._held, ''), '', self._held_since, 'breakpoint')
        holds, points = ((hold,) if self._held else ()), tuple(self._points.values())
        snapshot = ExecutiveSnapshot('', 0, tree_holds=holds, tree_breakpoints=points)
        return {
            'event': 'live',
            'robot': self.name,
            'link': 'lost' if self._problem else 'live',
            'problem': self._problem,
            'behavior': self._id,
            'state': 'held' if self._held else 'running' if is_running else 'not running',
            'active': [],
            'trees': [tree] if self._id else [],
            **debugged(snapshot),
        }


def _words(line: str) -> list[str]:
    """Return the words of a line without the options that name the tree."""
    try:
        words = iter(shlex.split(line))
    except ValueError as error:
        raise StudioError(f'{short_repr(line)}: {error}') from error
    return [word for word in words if word not in ('--tree', '--run') or next(words, None) is None]


def _json(value: Any) -> bytes:
    return json.dumps(value).encode()


# The XML by which a program describes its tree: a tree for each place where a sub-tree is used, with uids.


def described(name: str, text: str) -> tuple[str, str, dict[int, str], dict[str, str]]:
    """Return the ID of the main tree, a document with each tree once and without uids, the paths of nodes by uid, and
    the paths of sub-trees by the name of their blackboard. Raises StudioError."""
    try:
        root = parse(Source(name, text), max_bytes=4 * MOST_BYTES, max_depth=_MAX_DEPTH)
    except TreeLoadError as error:
        raise StudioError(f'the tree that {name} sends cannot be read: {one_line(str(error), 300)}') from error
    trees = [one for one in root.children if one.tag == 'BehaviorTree' and one.attributes.get('ID')]
    if not trees:
        raise StudioError(f'{name} sends no tree')
    boards = _placed(trees)
    document = '\n'.join(_lines(root, trees)) + '\n'
    if len(document) > MOST_BYTES:
        raise StudioError(f'the tree of {name} has more than {MOST_BYTES} characters, which is more than is shown')
    nodes = {uid: node.path for uid, node in described_nodes(root)}
    return trees[0].attributes['ID'], document, nodes, boards


def _placed(trees: list[Element]) -> dict[str, str]:
    """Give each tree the path of its sub-tree, and return these paths by the names of the blackboards.

    In BehaviorTree.CPP the tree of a sub-tree that is named like its tree has another path than the sub-tree.
    """
    known = {tree.attributes.get('_fullpath', '') for tree in trees}
    places: dict[str, str] = {}
    boards: dict[str, str] = {}
    for tree in trees:
        path = tree.attributes.get('_fullpath', '')
        place = places.get(path, path)
        boards.setdefault(path or tree.attributes['ID'], place)  # of two with one name, programs send the first
        tree.attributes = tree.attributes | {'_fullpath': place}
        pending = list(tree.children)
        while pending:
            one = pending.pop()
            pending.extend(one.children)
            below = one.attributes.get('_fullpath')
            if below is not None:
                placed = _within(place, below.removeprefix(_within(path, '')))
                one.attributes = one.attributes | {'_fullpath': placed}
                places[below if below in known else _within(path, one.attributes.get('ID', ''))] = placed
    return boards


def _within(path: str, name: str) -> str:
    return f'{path}/{name}' if path else name


def _lines(root: Element, trees: list[Element]) -> Iterator[str]:
    yield f'<root BTCPP_format="4" main_tree_to_execute={xml_attribute(trees[0].attributes["ID"])}>'
    used: set[str] = set()
    for id, tree in {one.attributes['ID']: one for one in trees}.items():
        yield f'  <BehaviorTree ID={xml_attribute(id)}>'
        yield from _elements(tree.children, 2, used, tree.attributes.get('_fullpath', ''))
        yield '  </BehaviorTree>'
    models = [one for one in root.children if one.tag == 'TreeNodesModel']
    yield '  <TreeNodesModel>'
    for model in (one for models_of in models for one in models_of.children):
        if model.tag != 'SubTree' and model.attributes.get('ID') in used:
            yield from _elements([model], 2, set(), '')
    yield '  </TreeNodesModel>'
    yield '</root>'


def _elements(elements: list[Element], level: int, used: set[str], scope: str) -> Iterator[str]:
    """Yield elements of the sub-tree that has the path ``scope``."""
    pending: list[tuple[int, Element | str]] = [(level, one) for one in reversed(elements)]
    while pending:
        level, one = pending.pop()
        indent = '  ' * level
        if isinstance(one, str):
            yield f'{indent}</{one}>'
            continue
        used.add(one.tag)
        attributes = ''.join(f' {key}={xml_attribute(value)}' for key, value in _attributes(one, scope).items())
        yield f'{indent}<{one.tag}{attributes}{">" if one.children else "/>"}'
        if one.children:
            pending.append((level, one.tag))
            pending.extend((level + 1, child) for child in reversed(one.children))


def _attributes(element: Element, scope: str) -> dict[str, str]:
    """Return the attributes of a node as they are written to load it; a name only if one was given."""
    found = {key: value for key, value in element.attributes.items() if key not in ('_uid', '_fullpath')}
    if element.tag == 'SubTree' and '_fullpath' in element.attributes:
        name = element.attributes['_fullpath'].removeprefix(_within(scope, ''))
        usual = f'{found.get("ID")}::{element.attributes.get("_uid")}'
        return found if name == usual else {'name': name, **found}
    return {key: value for key, value in found.items() if (key, value) != ('name', element.tag)}
