# SPDX-License-Identifier: BSD-3-Clause
"""Trees of scripted leaves in a short notation, for tables of what a node does tick by tick.

``control('IfThenElse', 'FS', 'R')`` is the XML of a node whose children are leaves with the scripts ``FS`` and ``R``: a
letter for each call, over and over. The treatment of the tree is a row of steps with ``|`` between them, for example
``'F 0F | R 0S 1R | halt 1!'``:

* ``S``, ``F``, ``R``, ``K``: the status SUCCESS, FAILURE, RUNNING, SKIPPED;
* first word of a step: what the tick of the tree results in; ``halt``: instead of a tick the tree is halted; ``error``:
  the tick raises NodeExecutionError;
* further words: what the leaves do meanwhile, in this order and nothing else: ``0S`` leaf 0 is called and gives
  SUCCESS, ``1!`` leaf 1 is halted;
* before the first word: ``x=3`` writes an entry of the blackboard (``x='3'`` a text), ``-x`` removes it.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from flexbt_core.behavior_tree.engine.leaf import StatefulAction
from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2.registration import Nav2Branch, register_nav2
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock

PATIENCE = 10.0
"""Time limit for the actions of another thread, s of wall time."""

LETTERS = {'S': NodeStatus.SUCCESS, 'F': NodeStatus.FAILURE, 'R': NodeStatus.RUNNING, 'K': NodeStatus.SKIPPED}
NAMES = {status: letter for letter, status in LETTERS.items()}


class Step(StatefulAction):
    """A leaf with the name ``script_number``: it returns one letter of the script at each call, repeatedly.

    It records its calls and halts.
    """

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.script, self.number = config.name.split('_')
        self.calls = 0

    def call(self) -> NodeStatus:
        letter = self.script[self.calls % len(self.script)]
        self.calls += 1
        self.services.append(self.number + letter)
        return LETTERS[letter]

    def on_start(self) -> NodeStatus:
        return self.call()

    def on_running(self) -> NodeStatus:
        return self.call()

    def on_halted(self) -> None:
        self.services.append(self.number + '!')


def make(
    body: str,
    clock: ManualClock | None = None,
    branch: Nav2Branch = 'jazzy',
    extra: Sequence[type[TreeNode]] = (),
    enums: Mapping[str, int] = {},
) -> tuple[Tree, list[str]]:
    """Return the tree, and the list of its leaves' actions. ``extra`` are further node classes."""
    calls: list[str] = []
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    library = TreeLibrary([load_xml(text, 'f', _registry(branch, tuple(extra), tuple(enums.items())))])
    return Tree(library, 'Main', clock=clock or ManualClock(), services=calls), calls


@functools.cache
def _registry(
    branch: Nav2Branch, extra: tuple[type[TreeNode], ...], enums: tuple[tuple[str, int], ...]
) -> NodeRegistry:
    registry = builtin_registry()
    register_nav2(registry, branch)
    registry.register_classes((Step, *extra))
    for name, number in enums:
        registry.scripts.register_enum(name, number)
    return registry


def step(script: str, number: int = 0) -> str:
    return f'<Step name="{script}_{number}"/>'


def control(tag: str, *scripts: str, **ports: str) -> str:
    """Return the XML of a node named ``top`` over leaves with these scripts."""
    attributes = ''.join(f' {name}="{value}"' for name, value in ports.items())
    children = ''.join(step(script, index) for index, script in enumerate(scripts))
    return f'<{tag}{attributes} name="top">{children}</{tag}>'


def check(body: str, expected: str, branch: Nav2Branch = 'jazzy') -> Tree:
    """Assert that the tree does what is ``expected``, in the notation above. Return the tree in its final state."""
    tree, calls = make(body, branch=branch)
    for number, text in enumerate(expected.split('|')):
        words = text.split()
        while '=' in words[0] or words[0].startswith('-'):
            _write(tree, words.pop(0))
        result, *wanted = words
        if result == 'halt':
            tree.halt()
            assert all(node.status is NodeStatus.IDLE for node in tree.nodes), 'a halt leaves every node IDLE'
        elif result == 'error':
            with pytest.raises(NodeExecutionError):
                tree.tick_once()
        else:
            assert NAMES[tree.tick_once()] == result, f'step {number} of {expected}; calls {calls}'
        assert calls == wanted, f'step {number} of {expected}'
        calls.clear()
    return tree


def _write(tree: Tree, word: str) -> None:
    if word.startswith('-'):
        tree.blackboard.unset(word[1:])
        return
    key, _, text = word.partition('=')
    value: Any = text.strip("'")
    if text.lstrip('-').replace('.', '', 1).isdigit():
        value = float(text) if '.' in text else int(text)
    tree.blackboard.set(key, value)


def first_failure(body: str) -> tuple[str, str, list[str]]:
    """Return the failure of the first completed tick: node at fault, reason, and chain from the root."""
    tree, _ = make(body)
    for _ in range(20):
        status = tree.tick_once()
        if status is NodeStatus.FAILURE:
            assert tree.failure is not None
            return tree.failure.path, tree.failure.reason, list(tree.failure.chain)
        assert status is NodeStatus.RUNNING, status
    raise AssertionError('the tree does not end')


class Woken:
    """A receiver of a tree's wake-ups, which a test can wait for."""

    def __init__(self, tree: Tree) -> None:
        self._event = threading.Event()
        tree.context.on_wake = self._event.set

    def wait(self) -> None:
        assert self._event.wait(PATIENCE), 'the tree was not woken'
        self._event.clear()
