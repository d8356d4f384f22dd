# SPDX-License-Identifier: BSD-3-Clause
"""Runs a scripted case on the engine and records a trace; ``wheel`` does the same on BehaviorTree.CPP.

A case is ``{'xml', 'bb', 'ops'}``. Its leaves follow scripts in attributes that both engines pass over:

* ``<Act _script="RRS"/>`` a stateful action, ``<Sync>`` and ``<Cond>`` a synchronous action and a condition: one letter
  for each call, over and over; S, F, R (running), K (skipped), I (idle, which is an error);
* ``<Deco _map="S>F">`` a decorator that exchanges results;
* ``_write="x:i:3;y:s:text"`` and ``_read="x;y"``: what a leaf does with the blackboard at each call.

A pair of ``_map`` is ``of the child>own``: ``S>F R>S`` turns SUCCESS into FAILURE and RUNNING into SUCCESS. An item of
``_write`` is ``key:type:value``, with the types i (integer), d (real), s (text) and b (bool).

Operations: tick, once, halt, sleep (ms), set (key, type, value), unset (key).

Events of the trace, each a list, in the order in which they happened:

* ``st`` name, status before, status after: a node has changed its status, as a letter from above;
* ``call`` path, ``start`` | ``run`` | ``tick``, letter: a leaf was called, and what it returned;
* ``halt`` path: a running leaf was halted;
* ``deco`` path, letter of the child, letter that the decorator made of it;
* ``write`` path, key, ``ok`` | ``error``; ``read`` path, key, entry (its type and text, see :func:`content`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from flexbt_core.behavior_tree.engine.function_nodes import SimpleAction
from flexbt_core.behavior_tree.engine.leaf import Condition, StatefulAction
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.script.interpreter import WARM_UP, ScriptLibrary
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_core.monitors.tree_monitor import TreeMonitor

LETTERS = {
    'S': NodeStatus.SUCCESS,
    'F': NodeStatus.FAILURE,
    'R': NodeStatus.RUNNING,
    'K': NodeStatus.SKIPPED,
    'I': NodeStatus.IDLE,
}
NAMES = {status: letter for letter, status in LETTERS.items()}
PYTHON_TYPES: dict[str, Any] = {'i': int, 'd': float, 's': str, 'b': lambda text: text in (True, '1', 'true')}

Event = list[Any]


class Script:
    """The script of a leaf: its results and blackboard accesses, call by call."""

    def __init__(self, node: TreeNode, extra: Mapping[str, str], events: list[Event]) -> None:
        self._node = node
        self._letters = extra.get('_script') or 'S'
        self._writes = [item for item in extra.get('_write', '').split(';') if item]
        self._reads = [key for key in extra.get('_read', '').split(';') if key]
        self._calls = 0
        self._events = events
        self.results = dict(pair.split('>') for pair in extra.get('_map', '').split())

    def call(self, phase: str) -> NodeStatus:
        path, board = self._node.path, self._node.blackboard
        for item in self._writes:
            key, kind, text = item.split(':', 2)
            try:
                board.set(key, PYTHON_TYPES[kind](text))
                self._events.append(['write', path, key, 'ok'])
            except BehaviorTreeError:
                self._events.append(['write', path, key, 'error'])
        for key in self._reads:
            self._events.append(['read', path, key, content(board, key)])
        letter = self._letters[self._calls % len(self._letters)]
        self._calls += 1
        self._events.append(['call', path, phase, letter])
        return LETTERS[letter]


class Act(StatefulAction):
    script: Script

    def on_start(self) -> NodeStatus:
        return self.script.call('start')

    def on_running(self) -> NodeStatus:
        return self.script.call('run')

    def on_halted(self) -> None:
        self.script._events.append(['halt', self.path])


class Sync(SimpleAction):
    script: Script

    def call(self) -> NodeStatus:
        return self.script.call('tick')


class Cond(Condition):
    script: Script

    def tick(self) -> NodeStatus:
        return self.script.call('tick')


class Deco(Decorator):
    script: Script

    def tick(self) -> NodeStatus:
        letter = NAMES[self.tick_child()]
        result = self.script.results.get(letter, letter)
        self.script._events.append(['deco', self.path, letter, result])
        return LETTERS[result]


def registry() -> NodeRegistry:
    """Return the registry of the engine with the scripted nodes."""
    # Generate code at the second run of a script, so that longer tests cover both of its forms.
    nodes = builtin_registry(ScriptLibrary(min(1, WARM_UP)))
    nodes.register_classes((Act, Sync, Cond, Deco))
    return nodes


def content(board: Blackboard, key: str) -> list[str]:
    """Return an entry as type letter and text: s text, i integer or bool, d double, e empty, - missing."""
    entry = board.entry(key)
    if entry is None:
        return ['-', '']
    value = entry.value
    if value is EMPTY:
        return ['e', '']
    if isinstance(value, str):
        return ['s', value]
    if isinstance(value, int):
        return ['i', str(int(value))]
    return ['d', repr(value)]


class Run:
    """A case that runs on the engine."""

    def __init__(self, case: Mapping[str, Any], *, observed: bool = True, monitor: TreeMonitor | None = None) -> None:
        """Build the tree. Without ``observed`` the trace omits status changes, and the tree does not report them."""
        self._case = case
        self._monitor = monitor
        self._observers = (self._transition,) if observed else ()
        self._events: list[Event] = []
        self._clock = ManualClock()

    def trace(self) -> dict[str, Any]:
        """Run the case and return ``{'load_error', 'steps', 'final'}``.

        A step is ``{'op', 'status', 'error', 'events', 'bb', 'statuses'}``. ``statuses`` has the statuses of all nodes
        after the step, which the library does not show.
        """
        board = Blackboard()
        for key, value in self._case.get('bb', {}).items():
            board.set(key, value)
        try:
            library = TreeLibrary([load_xml(self._case['xml'], 'case.xml', registry())])
            main = next(iter(library.documents.values())).main
            if main is None:
                return {'load_error': 'no main tree', 'steps': []}
            monitor = self._monitor
            tree = Tree(
                library,
                main,
                blackboard=board,
                clock=self._clock,
                substitute=None if monitor is None else monitor.watched,
            )
        except BehaviorTreeError as error:
            return {'load_error': str(error), 'steps': []}
        tree.observe(*self._observers)
        if monitor is not None:
            monitor.begins(tree)
        for node, definition in zip(tree.nodes, tree.definitions, strict=True):
            if isinstance(node, Act | Sync | Cond | Deco):
                node.script = Script(node, definition.extra, self._events)
        steps = []
        for op in self._case['ops']:
            steps.append(self._step(tree, op))
            if steps[-1]['error']:
                break
        return {'load_error': None, 'steps': steps, 'final': self._step(tree, ['halt'])}

    def _transition(self, node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        self._events.append(['st', node.name, NAMES[before], NAMES[after]])

    def _step(self, tree: Tree, op: list[Any]) -> dict[str, Any]:
        status: str | None = None
        error: str | None = None
        try:
            match op:
                case ['tick']:
                    status = NAMES[tree.tick_exactly_once()]
                case ['once']:
                    status = NAMES[tree.tick_once()]
                case ['halt']:
                    tree.halt()
                case ['sleep', milliseconds]:
                    self._clock.advance(milliseconds / 1000.0)
                case ['set', key, kind, value]:
                    tree.blackboard.set(key, PYTHON_TYPES[kind](value))
                case ['unset', key]:
                    tree.blackboard.unset(key)
                case _:
                    raise ValueError(f'unknown operation {op}')
            if self._monitor is not None and status is not None:
                self._monitor.ticked(tree.status)
            elif self._monitor is not None and op == ['halt']:
                self._monitor.halted()
        except BehaviorTreeError as caught:
            error = str(caught)
        events = list(self._events)
        self._events.clear()
        boards = {
            subtree.path: {key: content(subtree.blackboard, key) for key in sorted(subtree.blackboard.keys())}
            for subtree in tree.subtrees
        }
        statuses = ''.join(NAMES[node.status] for node in tree.nodes)
        return {'op': op, 'status': status, 'error': error, 'events': events, 'bb': boards, 'statuses': statuses}
