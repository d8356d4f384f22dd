# SPDX-License-Identifier: BSD-3-Clause
"""Trees far deeper than Python's recursion limit: a file nests 256 deep, and sub-trees add up."""

from __future__ import annotations

import threading

import pytest

from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml

LEVELS = 5_000
IN_A_FILE = 200


class Passing(Decorator):
    """A decorator of a user, whose tick is Python code below code of the engine."""

    def tick(self) -> NodeStatus:
        return self.tick_child()


def chain(opening: str, closing: str, leaf: str) -> Tree:
    """Return a tree with so many nodes between its root and its leaf."""
    registry = builtin_registry()
    registry.register('Passing', Passing)
    count = LEVELS // IN_A_FILE
    trees = []
    for number in range(count):
        inner = leaf if number == count - 1 else f'<SubTree ID="T{number + 1}"/>'
        trees.append(f'<BehaviorTree ID="T{number}">{opening * IN_A_FILE}{inner}{closing * IN_A_FILE}</BehaviorTree>')
    text = f'<root BTCPP_format="4" main_tree_to_execute="T0">{"".join(trees)}</root>'
    return Tree(TreeLibrary([load_xml(text, 'deep.xml', registry)]), 'T0')


@pytest.mark.parametrize('observed', [False, True])
@pytest.mark.parametrize('tag', ['Inverter', 'Passing', 'Sequence', 'ReactiveFallback', 'Parallel'])
def test_a_chain_ticks_fails_and_is_halted(tag: str, observed: bool) -> None:
    tree = chain(f'<{tag}>', f'</{tag}>', '<Fallback><Sleep msec="1"/></Fallback>')
    changes: list[NodeStatus] = []
    if observed:
        tree.observe(lambda node, before, after: changes.append(after))
    assert tree.tick_once() is NodeStatus.RUNNING
    assert len(tree.active_nodes()) > LEVELS
    tree.halt()
    assert tree.active_nodes() == []
    assert len(changes) >= (2 * LEVELS if observed else 0)


def test_why_a_deep_tree_failed_is_told() -> None:
    tree = chain('<Passing>', '</Passing>', '<AlwaysFailure/>')
    assert tree.tick_once() is NodeStatus.FAILURE
    assert tree.failure is not None
    assert len(tree.failure.chain) > LEVELS


def test_a_thread_with_a_small_stack_is_enough() -> None:
    tree = chain('<Passing>', '</Passing>', '<AlwaysSuccess/>')
    given: list[NodeStatus] = []
    before = threading.stack_size(256 * 1024)
    try:
        thread = threading.Thread(target=lambda: given.append(tree.tick_once()))
        thread.start()
        thread.join()
    finally:
        threading.stack_size(before)
    assert given == [NodeStatus.SUCCESS]
