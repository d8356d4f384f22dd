# SPDX-License-Identifier: BSD-3-Clause
"""A tree that is shown to Groot2, in a process of its own: on this engine, or on BehaviorTree.CPP (``behaviortreepy``).

Run as a program with ``engine`` or ``wheel`` and a named pipe. Reads ``{"xml", "port", "silence"}`` from the first line
of that, then a command a line: ``tick``, ``halt``, ``log FILE`` (from now on). Writes ``ready``, and the result of each
command. The engine also writes ``held`` when a breakpoint holds the tick up, adds to each line how many hooks have been
reached, and answers ``held?`` at once: ``?``, whether a breakpoint holds the tick up, and how many have. Leaves are
those of ``scripted_nodes``, apart from what they read and write.
"""

from __future__ import annotations

import importlib
import json
import os
import queue
import struct
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import zmq

from flexbt_core.behavior_tree.engine.observers import StatusLog
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import SteadyClock
from flexbt_server.groot2 import protocol
from flexbt_server.groot2.log_file import LogBuffer, LogWriter, TeeLog
from flexbt_server.groot2.server import Groot2Server
from flexbt_server.groot2.watched_tree import clock
from flexbt_testing.behavior_trees.scripted_nodes import LETTERS, Act, Cond, Deco, Script, Sync, registry
from flexbt_testing.behavior_trees.wheel import _attributes_by_name
from flexbt_testing.system.python_processes import python_process
from flexbt_testing.waiting import DEADLINE

_PRELOADED = (
    'behaviortreepy',
    'flexbt_server.groot2.log_file',
    'flexbt_server.groot2.server',
    'flexbt_testing.behavior_trees.scripted_nodes',
    'flexbt_testing.behavior_trees.wheel',
    'flexbt_testing.system.python_processes',
    'zmq',
)


def tell(line: str) -> None:
    """Write a whole line for the program that has started this one: several threads write."""
    os.write(1, line.encode() + b'\n')


class CountingServer(Groot2Server):
    """Knows how many times it has told that a hook was reached."""

    told = 0

    def _tell(self, uid: int) -> None:
        self.told += 1
        super()._tell(uid)


class EngineHost:
    """The tree on this engine."""

    def __init__(self, xml: str, port: int, silence: float) -> None:
        document = load_xml(xml, 'case.xml', registry())
        self._tree = Tree(TreeLibrary([document]), document.main or '', clock=SteadyClock())
        for node, definition in zip(self._tree.nodes, self._tree.definitions, strict=True):
            if isinstance(node, Act | Sync | Cond | Deco):
                node.script = Script(node, definition.extra, [])
        self._server = CountingServer(port, silence=silence)
        self._holds = 0
        self._log = LogBuffer(clock)
        self._watched = self._server.add(self._tree, self._log, self._on_held)
        assert self._watched is not None
        self._writer: LogWriter | None = None
        self._tree.observe(StatusLog(self._log), after_round=self._watched.settle)

    def _on_held(self, held: bool) -> None:
        if held:
            self._holds += 1
            tell(f'held {self._server.told}')

    def held(self) -> str:
        """Return whether a breakpoint holds the tick up, and how many have. In this order: the second may be the newer
        one."""
        assert self._watched is not None
        held = self._watched.breakpoints.held
        return f'? {held} {self._holds}'

    def obey(self, command: str) -> str:
        if command == 'tick':
            status = self._tree.tick_exactly_once().name
        elif command == 'halt':
            self._tree.halt()
            status = 'halted'
        else:
            path = Path(command.removeprefix('log '))
            log = LogBuffer(clock, timed=True)
            self._writer = LogWriter(path, self._tree, log, clock(), time.time(), on_error=sys.exit)
            self._tree.observe(StatusLog(TeeLog([self._log, log])), after_round=self._writer.flush)
            status = 'logging'
        if self._writer is not None:
            self._writer.flush()
        return f'{status} {self._server.told}'


class WheelHost:
    """The tree on BehaviorTree.CPP."""

    def __init__(self, xml: str, port: int, silence: float) -> None:
        library: Any = importlib.import_module('behaviortreepy')
        self._library = library
        self._scripts = _attributes_by_name(xml)
        self._calls: dict[str, int] = {}
        self._statuses = {letter: getattr(library.NodeStatus, status.name) for letter, status in LETTERS.items()}
        self._letters = {status.name: letter for letter, status in LETTERS.items()}
        self._factory = library.BehaviorTreeFactory()
        self._factory.register_simple_action('Sync', self._call)
        self._factory.register_simple_condition('Cond', self._call)
        self._factory.register_simple_decorator('Deco', self._decorate)
        self._factory.register_simple_stateful_action('Act', self._call, self._call, lambda node: None)
        self._tree = self._factory.create_tree_from_text(xml)
        self._publisher = library.Groot2Publisher(self._tree, port)
        self._publisher.set_max_heartbeat_delay(int(silence * 1000))
        self._log: Any = None

    def _call(self, node: Any) -> Any:
        path = node.full_path()
        letters = self._scripts.get(node.name(), {}).get('_script') or 'S'
        count = self._calls.get(path, 0)
        self._calls[path] = count + 1
        return self._statuses[letters[count % len(letters)]]

    def _decorate(self, child_status: Any, node: Any) -> Any:
        results = dict(pair.split('>') for pair in self._scripts.get(node.name(), {}).get('_map', '').split())
        letter = self._letters[child_status.name]
        return self._statuses[results.get(letter, letter)]

    def obey(self, command: str) -> str:
        if command == 'tick':
            return str(self._tree.tick_exactly_once().name)
        if command == 'halt':
            self._tree.halt_tree()
            return 'halted'
        self._log = self._library.FileLogger(self._tree, command.removeprefix('log '))
        return 'logging'


class Host:
    """Such a process, and a Groot2 of its own that is connected to it."""

    def __init__(self, kind: str, xml: str, port: int, silence: float = 60.0) -> None:
        self._holds = 0
        self.told = 0
        """How many times it had told, at the last line, that a hook was reached. Only of the engine."""
        with tempfile.TemporaryDirectory() as directory:
            pipe = str(Path(directory, 'commands'))
            os.mkfifo(pipe)
            self._commands = os.open(pipe, os.O_RDWR)  # does not wait for who reads
            self._process = python_process([str(Path(__file__).resolve()), kind, pipe], _PRELOADED)
            self._lines: queue.Queue[str] = queue.Queue()
            self._answers: queue.Queue[str] = queue.Queue()
            threading.Thread(target=self._listen, daemon=True).start()
            self.expect('opened')
        self._context = zmq.Context()
        self._requests = self._context.socket(zmq.REQ)
        self._notices = self._context.socket(zmq.SUB)
        self.send(json.dumps({'xml': xml, 'port': port, 'silence': silence}))
        self.expect('ready')
        self._connect(port)
        self._id = 0

    def _connect(self, port: int) -> None:
        """Return when notices arrive."""
        for socket, number in ((self._requests, port), (self._notices, port + 1)):
            socket.set(zmq.LINGER, 0)
            socket.set(zmq.RCVTIMEO, int(DEADLINE * 1000))
            monitor = socket.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED)
            socket.connect(f'tcp://127.0.0.1:{number}')
            assert monitor.poll(int(DEADLINE * 1000))
            socket.disable_monitor()
        self._notices.set(zmq.SUBSCRIBE, b'')

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as said:
            for line in said:
                (self._answers if line.startswith('?') else self._lines).put(line.strip())
        self._lines.put('ended')

    def send(self, command: str) -> None:
        """Begin something; its result is a line."""
        os.write(self._commands, command.encode() + b'\n')

    def line(self) -> str:
        """Return the next line."""
        line, _, told = self._lines.get(timeout=DEADLINE).partition(' ')
        self._holds += line == 'held'
        if told:
            self.told = int(told)
        return line

    def is_held(self) -> bool:
        """Return whether the breakpoint that the last ``held`` told of holds the tick up. Only of the engine."""
        self.send('held?')
        return self._answers.get(timeout=DEADLINE) == f'? True {self._holds}'

    def expect(self, line: str) -> None:
        found = self.line()
        assert found == line, found

    def ask(self, type: int, *content: bytes, header: bytes | None = None) -> list[bytes]:
        """Return the reply to a request. It has to have the header of the request."""
        self._id += 1
        sent = struct.pack('<BBI', protocol.PROTOCOL, type, self._id)
        self._requests.send_multipart([sent if header is None else header, *content])
        reply = self._requests.recv_multipart()
        if reply[0] != b'error':
            assert header is None and reply[0][:6] == sent and len(reply[0]) == 22
        return reply

    def notices(self, count: int) -> list[bytes]:
        """So many of the breakpoints that were reached; fails when there are fewer."""
        notices = []
        for _ in range(count):
            header, uid = self._notices.recv_multipart()
            assert header[:2] == bytes((protocol.PROTOCOL, protocol.RequestType.BREAKPOINT_REACHED))
            notices.append(uid)
        return notices

    def more_notices(self) -> list[bytes]:
        """Return those that are there already."""
        notices = []
        while self._notices.poll(0):
            notices.append(self._notices.recv_multipart()[1])
        return notices

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._commands)
        self._context.destroy(linger=0)


def main() -> None:
    """See above."""
    lines = Path(sys.argv[2]).open(encoding='utf-8')  # noqa: SIM115  # as long as the process
    tell('opened')
    options = json.loads(next(lines))
    host = (EngineHost if sys.argv[1] == 'engine' else WheelHost)(**options)
    tell('ready')
    commands: queue.Queue[str] = queue.Queue()

    def obey() -> None:
        while True:
            tell(host.obey(commands.get()))

    threading.Thread(target=obey, daemon=True).start()
    for line in lines:
        if line.strip() == 'held?':
            assert isinstance(host, EngineHost)
            tell(host.held())
        else:
            commands.put(line.strip())
    # The destructors of the library at exit are not part of this.
    os._exit(0)


if __name__ == '__main__':
    main()
