# SPDX-License-Identifier: BSD-3-Clause
"""Run scripted cases (see ``scripted_nodes``) on BehaviorTree.CPP, through the PyPI wheel ``behaviortreepy``.

The library shows inner statuses only to its console logger. So this file is a separate program whose standard output is
a memory file. The logger and the scripted leaves both write to it line by line, so the order is exact. The program
reads one JSON case per line from standard input, and writes one trace per line to its original output.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import select
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

STATUS_NAMES = {'S': 'SUCCESS', 'F': 'FAILURE', 'R': 'RUNNING', 'K': 'SKIPPED', 'I': 'IDLE'}
LETTERS = {name: letter for letter, name in STATUS_NAMES.items()}
_COLOUR = re.compile(r'\x1b\[\d+m')
_TRANSITION = re.compile(r'^\[-?\d+\.\d+\]: (.*?) +([A-Z]+) -> ([A-Z]+)$')
_MARK = '\x02'
_KEPT: list[Any] = []


class ConsoleTape:
    """Everything written to file descriptor 1, as events."""

    def __init__(self) -> None:
        self._file = os.memfd_create('events')
        self._position = 0
        os.dup2(self._file, 1)

    def add(self, event: Sequence[Any]) -> None:
        os.write(1, (_MARK + json.dumps(event) + '\n').encode())

    def take(self) -> list[Any]:
        """Return the events since the last call."""
        end = os.lseek(self._file, 0, os.SEEK_END)
        text = os.pread(self._file, end - self._position, self._position).decode('utf-8', 'replace')
        self._position = end
        events: list[Any] = []
        for line in text.splitlines():
            if _MARK in line:
                events.append(json.loads(line[line.index(_MARK) + 1 :]))
                continue
            match = _TRANSITION.match(_COLOUR.sub('', line))
            if match is not None:
                events.append(['st', match.group(1), LETTERS[match.group(2)], LETTERS[match.group(3)]])
        return events


class WheelRun:
    """A case that runs on BehaviorTree.CPP."""

    def __init__(self, library: Any, tape: ConsoleTape, case: dict[str, Any]) -> None:
        self._library = library
        self._tape = tape
        self._case = case
        self._scripts = _attributes_by_name(case['xml'])
        self._calls: dict[str, int] = {}
        self._boards: dict[str, Any] = {}
        self._statuses = {letter: getattr(library.NodeStatus, name) for letter, name in STATUS_NAMES.items()}
        self._tree: Any = None

    def trace(self) -> dict[str, Any]:
        library = self._library
        factory = library.BehaviorTreeFactory()
        factory.register_simple_action('Sync', lambda node: self._call(node, 'tick'))
        factory.register_simple_condition('Cond', lambda node: self._call(node, 'tick'))
        factory.register_simple_decorator('Deco', self._decorate)
        factory.register_simple_stateful_action(
            'Act',
            lambda node: self._call(node, 'start'),
            lambda node: self._call(node, 'run'),
            lambda node: self._tape.add(['halt', node.full_path()]),
        )
        board = library.Blackboard.create()
        for key, value in self._case.get('bb', {}).items():
            kind = {bool: 'b', int: 'i', float: 'd', str: 's'}[type(value)]
            _write(board, key, kind, value)
        self._boards[''] = board
        try:
            self._tree = factory.create_tree_from_text(self._case['xml'], board)
        except Exception as error:
            self._tape.take()
            return {'load_error': str(error), 'steps': []}
        logger = library.StdCoutLogger(self._tree)
        self._tape.take()
        steps = []
        for op in self._case['ops']:
            steps.append(self._step(op))
            if steps[-1]['error']:
                break
        result = {'load_error': None, 'steps': steps, 'final': self._step(['halt'])}
        if '_onHalted' in self._case['xml']:
            # The destructor of a tree runs these scripts again, and an exception there ends the process.
            _KEPT.append((logger, self._tree, factory))
        del logger
        # Delete the tree before the factory, whose manifests it uses.
        self._tree = None
        self._tape.take()
        return result

    def _call(self, node: Any, phase: str) -> Any:
        # An exception would be printed and treated as FAILURE, so none may leave this method.
        path = node.full_path()
        script = self._scripts.get(node.name(), {})
        scope = path.rpartition('/')[0]
        if scope not in self._boards or '_write' in script or '_read' in script:
            board = node.config().blackboard
            self._boards.setdefault(scope, board)
            for item in filter(None, script.get('_write', '').split(';')):
                key, kind, text = item.split(':', 2)
                try:
                    _write(board, key, kind, text)
                    self._tape.add(['write', path, key, 'ok'])
                except Exception:
                    self._tape.add(['write', path, key, 'error'])
            for key in filter(None, script.get('_read', '').split(';')):
                self._tape.add(['read', path, key, _content(board, key)])
        letters = script.get('_script') or 'S'
        count = self._calls.get(path, 0)
        self._calls[path] = count + 1
        letter = letters[count % len(letters)]
        self._tape.add(['call', path, phase, letter])
        return self._statuses[letter]

    def _decorate(self, child_status: Any, node: Any) -> Any:
        letter = LETTERS[child_status.name]
        results = dict(pair.split('>') for pair in self._scripts.get(node.name(), {}).get('_map', '').split())
        result = results.get(letter, letter)
        self._tape.add(['deco', node.full_path(), letter, result])
        return self._statuses[result]

    def _step(self, op: list[Any]) -> dict[str, Any]:
        status: str | None = None
        error: str | None = None
        try:
            match op:
                case ['tick']:
                    status = LETTERS[self._tree.tick_exactly_once().name]
                case ['once']:
                    status = LETTERS[self._tree.tick_once().name]
                case ['halt']:
                    self._tree.halt_tree()
                case ['sleep', milliseconds]:
                    time.sleep(milliseconds / 1000.0)  # let the timer threads of the library run
                case ['set', key, kind, value]:
                    _write(self._boards[''], key, kind, value)
                case ['unset', key]:
                    self._boards[''].unset(key)
                case _:
                    raise ValueError(f'unknown operation {op}')
        except Exception as caught:
            error = str(caught)
        boards = {
            path: {key: _content(board, key) for key in sorted(board.get_keys())}
            for path, board in self._boards.items()
        }
        return {'op': op, 'status': status, 'error': error, 'events': self._tape.take(), 'bb': boards}


def _attributes_by_name(xml: str) -> dict[str, dict[str, str]]:
    """Return the script attributes of the case, which the library does not show to its nodes."""
    try:
        root = ElementTree.fromstring(xml)  # noqa: S314 - cases are made by this project
    except ElementTree.ParseError:
        return {}
    return {element.get('name') or element.get('ID') or element.tag: dict(element.attrib) for element in root.iter()}


def _write(board: Any, key: str, kind: str, value: Any) -> None:
    if kind == 'i':
        board.set_int(key, int(value))
    elif kind == 'd':
        board.set_double(key, float(value))
    elif kind == 'b':
        board.set_bool(key, value in (True, '1', 'true'))
    else:
        board.set_string(key, str(value))


def _content(board: Any, key: str) -> list[str]:
    """Return an entry as ``scripted_nodes.content`` does. Its kind follows from which getters refuse it, and how."""
    try:
        board.get_bool(key)
        refusal = ''
    except Exception as error:
        refusal = str(error)
    try:
        text = board.get_string(key)
    except Exception as error:
        if 'Missing key' in str(error):
            return ['-', '']
        return ['e', ''] if 'initialized' in str(error) or 'empty' in str(error) else ['x', '']
    if 'no known safe conversion' in refusal:
        return ['s', text]
    if any(mark in text for mark in ('.', 'inf', 'nan')):
        return ['d', repr(board.get_double(key))]
    return ['i', text]


def available() -> bool:
    """Return whether the wheel is installed and can be imported."""
    command = [sys.executable, '-c', 'import behaviortreepy']
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def traces(cases: Iterable[dict[str, Any]], deadline: float = 5.0) -> Iterator[dict[str, Any]]:
    """Yield the traces of the cases, in order.

    Yield ``{'crash': ...}`` for a case that kills the library, or takes longer than ``deadline`` seconds.
    """
    process: subprocess.Popen[bytes] | None = None
    try:
        for number, case in enumerate(cases):
            # Replace the process from time to time, because abandoned trees keep their timer threads.
            if process is not None and number % 500 == 0:
                _end(process)
                process = None
            if process is None:
                command = [sys.executable, str(Path(__file__).resolve())]
                process = subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0
                )
            trace = _ask(process, case, deadline)
            if 'crash' in trace:
                _end(process)
                process = None
            yield trace
    finally:
        if process is not None:
            _end(process)


def _ask(process: subprocess.Popen[bytes], case: dict[str, Any], deadline: float) -> dict[str, Any]:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write((json.dumps(case) + '\n').encode())
    answer = b''
    while not answer.endswith(b'\n'):
        if not select.select([process.stdout], [], [], deadline)[0]:
            return {'crash': f'no answer within {deadline} s'}
        piece = process.stdout.read(1 << 16)
        if not piece:
            return {'crash': f'exit code {process.wait()}'}
        answer += piece
    trace: dict[str, Any] = json.loads(answer)
    return trace


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.communicate()


def main() -> None:
    """Write the traces of the cases on standard input."""
    output = os.fdopen(os.dup(1), 'w')
    tape = ConsoleTape()
    library = importlib.import_module('behaviortreepy')
    for line in sys.stdin:
        json.dump(WheelRun(library, tape, json.loads(line)).trace(), output)
        output.write('\n')
        output.flush()
    # Timer threads of the library may be alive; the destructors at exit must not become part of the trace.
    os._exit(0)


if __name__ == '__main__':
    main()
