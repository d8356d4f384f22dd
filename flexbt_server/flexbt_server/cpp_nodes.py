# SPDX-License-Identifier: BSD-3-Clause
"""Leaves of C++ libraries for BehaviorTree.CPP (``BT_REGISTER_NODES``). They run in processes of their own.

The program ``bt_plugin_host`` of the package ``flexbt_plugin_host`` loads the libraries; its source describes the
protocol. The server starts one process for each entry of its parameter ``plugins``, and again after a crash. Ports are
resolved here: a blackboard entry crosses when it has changed, as JSON.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import re
import signal
import socket
import struct
import subprocess
import threading
from abc import ABCMeta
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, cast

from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_package_share_directory

from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.behavior_tree.engine.context import TreeContext
from flexbt_core.behavior_tree.engine.leaf import LeafNode
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import EMPTY, Entry
from flexbt_core.behavior_tree.model.blackboard_json import TYPE_FIELD, JsonTypes
from flexbt_core.behavior_tree.model.errors import (
    ConversionError,
    NodeExecutionError,
    RegistrationError,
    ScriptError,
    TickAbandoned,
)
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port, PortDirection, PortType
from flexbt_core.behavior_tree.model.status import IDLE, RUNNING, SKIPPED, NodeKind, NodeStatus
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.values.text import one_line, short_repr

from .errors import BtServerError
from .leaves.leaf_services import ServerNode
from .leaves.service_leaf import ANSWER_SECONDS
from .runs.run_events import RunEnded, RunEvent, RunEvents, RunReader, RunStarted
from .trees.ros_ports import RosJsonTypes

PACKAGE: Final = 'flexbt_plugin_host'
PROGRAM: Final = 'bt_plugin_host'
LOAD_SECONDS: Final = 10.0
"""Time for a host to load its libraries, s."""
SEND_SECONDS: Final = 0.5
"""Time for a host to read a request that does not fit into the buffer of the socket, s."""
MOST_BYTES: Final = 100_000_000
"""Maximum size of an answer."""
_NUMBERS: Final = {'.nan': math.nan, '.inf': math.inf, '-.inf': -math.inf}
"""Numbers that JSON lacks, by their names in lists and objects: those of YAML, which the texts of messages have."""
_NAMES: Final = {str(number): name for name, number in _NUMBERS.items()}
_MESSAGE: Final = re.compile(r'(\w+)::msg::(\w+)_<std::allocator<void> ?>')
KINDS: Final = {'Action': NodeKind.ACTION, 'Condition': NodeKind.CONDITION}
"""Kinds of nodes that are served. Others have children."""


class PluginHostError(BtServerError):
    """A library, or the process for its nodes, cannot be used."""


class CppNodeError(BtServerError):
    """A C++ node threw an exception."""


# -- the processes -----------------------------------------------------------------------------------------------------


class _Process:
    """A running host. ``introduction`` describes its node types."""

    def __init__(self, command: Sequence[str], libraries: Sequence[str], arguments: Sequence[str]) -> None:
        """Start the host. Raises PluginHostError if it does not introduce itself in time."""
        self._killed_because = ''
        self._control, theirs = socket.socketpair()
        with theirs:
            number = theirs.fileno()
            try:
                # Standard output may be that of a program that prints a model. A session of its own keeps Ctrl-C away.
                self._process = subprocess.Popen(  # noqa: S603 - the command is that of an installed package
                    [*command, str(number), *libraries, *arguments],
                    pass_fds=(number,), stdin=subprocess.DEVNULL, stdout=2, start_new_session=True,
                )  # fmt: skip
            except OSError as error:
                raise PluginHostError(f'{command[0]} cannot be started: {error}') from error
        self._control.settimeout(LOAD_SECONDS)
        self.introduction = self._read_introduction()
        self._control.settimeout(None)

    def _read_introduction(self) -> dict[str, Any]:
        loading = 'its libraries'
        try:
            with self._control.makefile('rb') as lines:
                for line in itertools.islice(iter(lambda: lines.readline(MOST_BYTES), b''), 10_000):
                    told = json.loads(line)
                    if 'nodes' in told:
                        return dict(told)
                    loading = str(told['loading'])
        except TimeoutError:
            self.kill(f'did not load {loading} within {LOAD_SECONDS:g} s')
        except OSError:  # the end is reported below
            pass
        except (ValueError, TypeError, LookupError, RecursionError) as error:
            self.kill(f'sent an invalid introduction: {one_line(str(error), 200)}')
        raise PluginHostError(f'{self.why_ended()}, while it loaded {loading}')

    @property
    def has_ended(self) -> bool:
        return bool(self._killed_because) or self._process.poll() is not None

    def connect(self) -> socket.socket:
        """Return a connection for the nodes of a run."""
        ours, theirs = socket.socketpair()
        with theirs:
            try:
                socket.send_fds(self._control, [b'+'], [theirs.fileno()])
            except OSError:
                ours.close()
                raise PluginHostError(self.why_ended()) from None
        milliseconds = int(SEND_SECONDS * 1000.0)
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack('ll', 0, milliseconds * 1000))
        return ours

    def kill(self, why: str) -> None:
        """End the process because it does something wrong: ``why`` follows a subject. The first reason counts."""
        self._killed_because = self._killed_because or why
        self._process.kill()

    def why_ended(self) -> str:
        """Return how the process has ended, and wait for that. From a thread that may wait."""
        try:
            code = self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.kill('closed its connection')
            code = self._process.wait()
        if self._killed_because:
            return f'{PROGRAM} {self._killed_because}, and was ended'
        if code >= 0:
            return f'{PROGRAM} ended with exit code {code}'
        names = {one.value: one.name for one in signal.Signals}
        return f'{PROGRAM} was ended by {names.get(-code, f"signal {-code}")}'

    def close(self) -> None:
        """End the process: it gets half a second to destroy its nodes."""
        self._control.close()
        try:
            self._process.wait(0.6)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class PluginHost:
    """A host for some libraries, started again when it has ended. Use it from any thread.

    ``name`` is what the parameter ``plugins`` says. As a watcher of runs, it destroys the nodes of a tree at the end of
    its run.
    """

    def __init__(self, name: str, command: Sequence[str], libraries: Sequence[str], arguments: Sequence[str]) -> None:
        """Start the host. Raises PluginHostError."""
        self.name = name
        self._arguments = command, libraries, arguments
        self._process = _Process(*self._arguments)
        self._is_open = True
        self._lock = threading.Lock()
        self._sessions: dict[TreeContext, Session] = {}

    @property
    def introduction(self) -> Mapping[str, Any]:
        """Description of the node types, as the host sent it."""
        return self._process.introduction

    def open(self, _events: RunEvents) -> RunReader:
        return _EndOfRun(self)

    def session(self, context: TreeContext) -> Session:
        """Return the session of a running tree; a new one if the previous one is lost. On the thread of the tree."""
        session = self._sessions.get(context)
        if session is None or session.lost:
            session = self._sessions[context] = Session(self, context.wake)
        return session

    def end_session(self, context: TreeContext) -> None:
        """Destroy the nodes of a tree whose run has ended. From any thread."""
        session = self._sessions.pop(context, None)
        if session is not None:
            session.close()

    def connect(self) -> tuple[_Process, socket.socket]:
        """Return the process, which may have to be started, and a connection to it. Blocks.

        Raises PluginHostError.
        """
        with self._lock:
            if self._process.has_ended:
                before = self._process
                before.close()
                process = _Process(*self._arguments)
                if process.introduction != before.introduction or not self._is_open:
                    process.close()
                    raise PluginHostError(f'the libraries of {self.name} have changed; restart the BT server')
                self._process = process
            return self._process, self._process.connect()

    def close(self) -> None:
        """End the process. Does not wait for a process that is being started."""
        self._is_open = False
        self._process.close()


class _EndOfRun(RunReader):
    """A reader that destroys the nodes of a run at its end."""

    def __init__(self, host: PluginHost) -> None:
        self._host = host
        self._tree: Tree | None = None

    def read(self, event: RunEvent) -> None:
        if isinstance(event, RunStarted):
            self._tree = event.tree
        elif isinstance(event, RunEnded) and self._tree is not None:
            self._host.end_session(self._tree.context)


@dataclass(eq=False)
class Request:
    """A request to a host. It is done when there is an answer, or the reason why there is none, ``lost``.

    That sets ``answered`` while a tick waits for it (``is_awaited``); else it wakes the tree.
    """

    text: bytes
    answered: WakeEvent
    wake: Callable[[], None]
    is_awaited: bool = True
    answer: Mapping[str, Any] | None = None
    lost: str = ''

    @property
    def is_done(self) -> bool:
        return self.answer is not None or bool(self.lost)

    def finish(self, answer: Mapping[str, Any] | None, lost: str = '') -> None:
        """Set the answer, or the reason why there is none."""
        self.answer, self.lost = answer, lost
        if self.is_awaited:
            self.answered.set()
        else:
            self.wake()


class Session:
    """The nodes of one running tree in a host. The host gets a request when it has answered the previous one."""

    def __init__(self, host: PluginHost, wake: Callable[[], None]) -> None:
        self.lost = ''
        """Why the nodes are gone; '' while they exist."""
        self.numbers = itertools.count(1)
        self._host = host
        self._wake = wake
        self._lock = threading.Lock()
        self._requests: deque[Request] = deque()
        self._connection: tuple[_Process, socket.socket] | None = None
        self._is_open = True
        threading.Thread(target=self._run, name=f'plugin_host {host.name}', daemon=True).start()

    def request(self, request: Request) -> None:
        """Send a request when its turn comes. On the thread of the tree; does not wait."""
        with self._lock:
            lost = self.lost
            if not lost:
                self._requests.append(request)
            is_next = self._connection is not None and len(self._requests) == 1
        if lost:
            request.finish(None, lost)
        elif is_next:
            self._send(request)

    def close(self) -> None:
        """Destroy the nodes, at the end of the run. A host with a node that does not return is ended."""
        with self._lock:
            self._is_open = False
            connection, is_busy = self._connection, bool(self._requests)
        if connection is not None:
            process, end = connection
            if is_busy and not self.lost:
                process.kill('has a node that does not return although its run has ended')
            with contextlib.suppress(OSError):  # the host was faster
                end.shutdown(socket.SHUT_RDWR)

    def _send(self, request: Request) -> None:
        assert self._connection is not None  # connected
        process, end = self._connection
        try:
            end.sendall(request.text)
        except BlockingIOError:
            process.kill(f'did not read a request within {SEND_SECONDS:g} s')
        except OSError:  # the thread that reads reports the end
            pass

    def _run(self) -> None:
        try:
            connection = self._host.connect()
        except PluginHostError as error:
            self._lose(str(error))
            return
        process, end = connection
        with self._lock:
            self._connection = connection
            first = self._requests[0] if self._requests else None
            is_open = self._is_open
        if first is not None and is_open:
            self._send(first)
        with end:
            if is_open:
                self._read(process, end)
            self._lose('the run has ended' if not self._is_open else process.why_ended())

    def _read(self, process: _Process, end: socket.socket) -> None:
        try:
            with end.makefile('rb') as lines:
                while line := lines.readline(MOST_BYTES):
                    self._take(json.loads(line))
        except OSError:  # the host, or the run, has ended
            pass
        except (ValueError, TypeError, LookupError, RecursionError) as error:
            process.kill(f'sent an invalid answer: {one_line(str(error), 200)}')

    def _take(self, answer: Any) -> None:
        if answer == {'wake': True}:
            self._wake()
            return
        if not isinstance(answer['out'], dict) or not ('error' in answer or answer['status'] in NodeStatus.__members__):
            raise ValueError(short_repr(answer))
        with self._lock:
            request = self._requests.popleft()  # IndexError: nothing was requested
            following = self._requests[0] if self._requests else None
        request.finish(answer)
        if following is not None:
            self._send(following)

    def _lose(self, why: str) -> None:
        with self._lock:
            self.lost = why
            requests, self._requests = self._requests, deque()
        for request in requests:
            request.finish(None, why)
        self._wake()


# -- the leaves --------------------------------------------------------------------------------------------------------


@dataclass(slots=True, repr=False)
class CppObject:
    """A value of a C++ type with a JSON definition (``BT::RegisterJsonDefinition``). Each type has a derived class."""

    fields: dict[str, Any]

    def __repr__(self) -> str:
        return f'{type(self).__name__}({self.fields!r})'


class CppLeaf(ServerNode, LeafNode):
    """A leaf in a host.

    A tick waits for the answer of the host, as for that of a service. An action whose answer takes longer is RUNNING
    until it comes; a condition fails after ``server_timeout``. A halt takes place when the tick has returned. If the
    host ends, the leaf fails, and its next start starts the host again.
    """

    __slots__ = ('_answered', '_is_created', '_number', '_sent', '_session', '_ticking')

    goes_on = 'a C++ node is not told of a pause'
    plugin: ClassVar[PluginHost]
    types: ClassVar[JsonTypes]

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._answered = WakeEvent()
        self._is_created = False
        self._number = 0
        self._sent: dict[str, tuple[Entry, int] | None] = {}
        self._session: Session | None = None
        self._ticking: Request | None = None

    def execute(self) -> NodeStatus:
        self._reason = ''
        try:
            status = self._tick()
        except NodeExecutionError:
            raise
        except BaseException as error:
            raise self.fault(error) from error
        if status is not SKIPPED:
            self.status = self.checked(status)
        return status

    def halt(self) -> None:
        # A condition may be late, and does nothing that a halt would stop.
        if self.kind is not NodeKind.CONDITION and (self.stored_status is RUNNING or self._ticking is not None):
            self.stop_by(self._halt_in_host)
        self.status = IDLE

    def _tick(self) -> NodeStatus:
        before = self.stored_status
        is_condition = self.kind is NodeKind.CONDITION
        until = self.host.runtime.steady.now() + (self.host.server_timeout if is_condition else ANSWER_SECONDS)
        if is_condition and self._ticking is not None:  # which came too late for its tick
            if not self._await(self._ticking, until):
                return self.fail('the host still has not answered')
            late, self._ticking = self._ticking, None
            self._taken(late)
        if before is RUNNING and self._session is not None and self._session.lost and self._ticking is None:
            return self.fail(self._session.lost)
        request = self._ticking
        if request is None:
            request = self._ticking = self._request_tick(is_reset=before is IDLE)
            self._await(request, until)
            if self.context.stopping and not request.is_done:
                raise TickAbandoned(self.path, self.id, 'the tree was stopped while the host executed this node')
        if not request.is_done:
            if is_condition:
                return self.fail(f'the host did not answer within {self.host.server_timeout:g} s')
            self.host.warn_once(
                f'[{self.id}]: a tick takes longer than {ANSWER_SECONDS:g} s; meanwhile the node is RUNNING'
            )
            return RUNNING
        self._ticking = None
        if request.lost:
            return self.fail(request.lost)
        return NodeStatus[self._taken(request)['status']]

    def _request_tick(self, *, is_reset: bool) -> Request:
        session = self.plugin.session(self.context)
        message: dict[str, Any] = {'op': 'tick', 'reset': is_reset}
        if session is not self._session:
            self._session = session
            self._number = next(session.numbers)
            self._is_created = False
            self._sent = {}
        if not self._is_created:
            ports = {name: value.text for name, value in self.port_values.items()}
            message['create'] = {'id': self.id, 'name': self.name, 'path': self.path, 'uid': self.uid, 'ports': ports}
        changes: dict[str, Any] = {}
        sent = dict(self._sent)
        for name, value in self.port_values.items():
            if value.key is None or not self.ports[name].readable:
                continue
            entry = self.blackboard.entry(value.key)
            state = None if entry is None or entry.value is EMPTY else (entry, entry.sequence)
            if state != sent.get(name):
                sent[name] = state
                changes[name] = None if state is None else self._as_json(name, state[0].value)
        self._sent = sent
        return self._request(session, message | {'in': changes})

    def _request(self, session: Session, message: Mapping[str, Any]) -> Request:
        text = json.dumps({'node': self._number, **message}, allow_nan=False).encode() + b'\n'
        request = Request(text, self._answered, self.wake)
        session.request(request)
        return request

    def _await(self, request: Request, until: float) -> bool:
        """Wait for the answer until this time, or until the tree is stopped; return whether it has come."""
        clock = self.host.runtime.steady
        request.is_awaited = True
        while not request.is_done and clock.now() < until and not self.context.stopping:
            self.context.wait(self._answered, clock, until)
        request.is_awaited = request.is_done
        return request.is_done

    def _halt_in_host(self) -> None:
        session, ticking, self._ticking = self._session, self._ticking, None
        if session is None or session.lost:
            return
        request = self._request(session, {'op': 'halt'})

        def take() -> None:
            if ticking is not None:  # which may have written outputs, or thrown, in the meantime
                self._taken(ticking)
            self._taken(request)

        if self._await(request, self.host.runtime.steady.now() + ANSWER_SECONDS):
            take()
            return

        def advance() -> None:
            if request.is_done:
                work.done()
                self.stop_by(take)

        work = self.context.add_unfinished(f'[{self.path}] is coming to its end in {PROGRAM}', advance)
        self.wake()  # the answer may have come before the work was registered

    def _taken(self, request: Request) -> Mapping[str, Any]:
        """Write the outputs of an answer, and return it. Raises CppNodeError if the node threw."""
        answer = request.answer or {'out': {}}
        for port, value in answer['out'].items():
            self.set_output(port, self._from_json(port, value))
        if 'error' in answer:
            self._sent = {}  # it may have read only some of the changes
            raise CppNodeError(one_line(str(answer['error']), 2000))
        self._is_created = True
        return answer

    def _as_json(self, port: str, value: Any) -> Any:
        if isinstance(value, float) and not math.isfinite(value):
            return str(value)  # which convertFromString understands
        if isinstance(value, str | int | float):
            return value
        if isinstance(value, list):
            return [_named(one) if isinstance(one, float) else self._as_json(port, one) for one in value]
        if isinstance(value, NodeStatus):
            return value.name
        known = self.types.of_class(type(value))
        if known is not None:
            return _named(known.to_json(value)) | {TYPE_FIELD: known.name}
        raise ConversionError(f'port [{port}]: {type(value).__name__} cannot be sent to a C++ node')

    def _from_json(self, port: str, value: Any) -> Any:
        kind = self.ports[port].type
        if isinstance(value, list) and kind is not None and kind.name == 'std::vector<double>':
            return [_NUMBERS.get(one, one) for one in value]
        if not isinstance(value, dict):
            return value
        fields = dict(value)
        name = str(fields.pop(TYPE_FIELD, ''))
        known = self.types.of_name(_type_name(name))
        if known is None:
            raise ConversionError(f'a value of the unknown C++ type {name!r}')
        return known.from_json(fields if issubclass(known.type.python_type, CppObject) else _untyped(fields))


# -- libraries and node types ------------------------------------------------------------------------------------------


def start_hosts(
    runtime: Runtime, plugins: Sequence[str], registry: NodeRegistry, on_broken: Callable[[str, Exception], None]
) -> list[PluginHost]:
    """Start a host for each entry of the parameter ``plugins``, and register its node types.

    An entry is a directory of libraries or a library, as ``package/path`` below the share of the package or as an
    absolute path, or the name of a library for the dynamic loader: ``my_nodes`` for ``libmy_nodes.so``.
    ``on_broken(nodes, error)`` is called for what cannot be used.
    """
    node = runtime.node
    remaps = ('-r', f'__ns:={node.get_namespace()}')
    is_simulated = str(node.get_parameter('use_sim_time').value).lower()
    arguments = ('--ros-args', *remaps, '-p', f'use_sim_time:={is_simulated}')
    hosts = []
    for name in plugins:
        try:
            host = PluginHost(name, host_command(), libraries_of(name), arguments)
        except (PluginHostError, OSError) as error:
            on_broken(f'the nodes of {name}', error)
            continue
        runtime.on_close(host.close)
        register_nodes(registry, host, on_broken)
        hosts.append(host)
    return hosts


def host_command() -> list[str]:
    """Return the command line of the host. Raises PluginHostError if it is not installed."""
    remedy = f'install BehaviorTree.CPP (ros-jazzy-behaviortree-cpp), and build {PACKAGE}'
    try:
        program = Path(get_package_prefix(PACKAGE)) / 'lib' / PACKAGE / PROGRAM
    except PackageNotFoundError:
        raise PluginHostError(f'C++ nodes need the package {PACKAGE}, which is not installed: {remedy}') from None
    if not program.exists():
        raise PluginHostError(f'{PACKAGE} was built without BehaviorTree.CPP, so it has no {PROGRAM}: {remedy} again')
    return [str(program)]


def libraries_of(name: str) -> list[str]:
    """Return the libraries of an entry of the parameter ``plugins``. Raises PluginHostError."""
    if '/' not in name:
        return [name if '.so' in name else f'lib{name}.so']
    place = Path(name)
    if not place.is_absolute():
        package, _, rest = name.partition('/')
        try:
            place = Path(get_package_share_directory(package)) / rest
        except (PackageNotFoundError, ValueError):
            raise PluginHostError(f'there is no package {package!r}') from None
    if place.is_dir():
        libraries = sorted(map(str, place.glob('*.so')))
        if not libraries:
            raise PluginHostError(f'{place} has no libraries (*.so)')
        return libraries
    if not place.exists():
        raise PluginHostError(f'there is no {place}')
    return [str(place)]


def register_nodes(registry: NodeRegistry, host: PluginHost, on_broken: Callable[[str, Exception], None]) -> None:
    """Register the node types of a host, and the enumerations that its libraries add to scripts."""
    for problem in host.introduction['problems']:
        on_broken(f'nodes of {host.name}', PluginHostError(one_line(str(problem), 2000)))
    for name, number in host.introduction['enums'].items():
        try:
            registry.scripts.register_enum(name, number)
        except (ScriptError, ValueError) as error:
            on_broken(f'the enumerator {name} of {host.name}', error)
    for node in host.introduction['nodes']:
        try:
            registry.register(node['id'], _node_class(host, node, registry))
        except (PluginHostError, RegistrationError) as error:
            on_broken(f'the node type [{node["id"]}] of {host.name}', error)


def _node_class(host: PluginHost, node: Mapping[str, Any], registry: NodeRegistry) -> type[CppLeaf]:
    kind = KINDS.get(node['kind'])
    if kind is None:
        raise PluginHostError(
            f'it is a {node["kind"]}, and {PROGRAM} serves actions and conditions only: a node with children has to be '
            'written in Python'
        )
    attributes = {
        '__slots__': (),
        '__doc__': str(node['description']) or f'A C++ node of {host.name}.',
        '__module__': __name__,
        'kind': kind,
        'plugin': host,
        'types': RosJsonTypes(registry.json_types),
        'ports': {port['name']: _port(port, registry.json_types) for port in node['ports']},
    }
    return cast('type[CppLeaf]', ABCMeta(node['id'], (CppLeaf,), attributes))


def _port(port: Mapping[str, Any], types: JsonTypes) -> Port:
    name, form = str(port['type']), port['form']
    kind: PortType | None = None
    if form == 'known':
        kind = types.port_type(name)
    elif form == 'json':
        kind = _object_type(name, types)
    elif form == 'text':
        kind = PortType(name, str, 'text', str, immutable=True)
    elif form == 'none':
        way = 'BT::RegisterJsonDefinition' if port['direction'] != 'Input' else (
            'convertFromString or BT::RegisterJsonDefinition'
        )  # fmt: skip
        raise PluginHostError(f'the type {name} of its port [{port["name"]}] cannot cross to the server: add {way}')
    return Port(
        PortDirection[port['direction'].upper()],
        kind,
        port.get('default', NO_DEFAULT),
        str(port['description']),
        literal=kind if form == 'known' else None,
        declares=form != 'text',
    )


def _object_type(name: str, types: JsonTypes) -> PortType:
    """Return the port type of a C++ type with a JSON definition. The host converts its text.

    Values are messages if the type is that of a message, whose JSON definition must have the names of its fields.
    """
    known = RosJsonTypes(types).of_name(_type_name(name))
    if known is None:
        made = type(name, (CppObject,), {'__slots__': (), '__qualname__': name})
        types.register(name, made, lambda value: value.fields, made)
        return PortType(name, made, 'object', str)
    return PortType(name, known.type.python_type, 'object', str)


def _type_name(name: str) -> str:
    """Return the name of the message type that a C++ type implements; for another type, its name."""
    message = _MESSAGE.fullmatch(name)
    return f'{message[1]}/msg/{message[2]}' if message else name


def _named(value: Any) -> Any:
    """Return JSON with names for the numbers that JSON lacks."""
    if isinstance(value, float) and not math.isfinite(value):
        return _NAMES[str(value)]
    if isinstance(value, list):
        return [_named(one) for one in value]
    if isinstance(value, dict):
        return {key: _named(one) for key, one in value.items()}
    return value


def _untyped(value: Any) -> Any:
    """Return JSON without the names of types in it."""
    if isinstance(value, list):
        return [_untyped(one) for one in value]
    if isinstance(value, dict):
        return {key: _untyped(one) for key, one in value.items() if key != TYPE_FIELD}
    return value
