# SPDX-License-Identifier: BSD-3-Clause
"""Nodes that are made of a function each."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest

from flexbt_core.behavior_tree.engine.function_nodes import (
    SimpleAction,
    SimpleDecorator,
    simple_action,
    simple_condition,
    simple_decorator,
)
from flexbt_core.behavior_tree.engine.leaf import Condition
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.ports import INT, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_testing.behavior_trees.steps import make as make_steps
from flexbt_testing.behavior_trees.steps import step

SUCCESS, FAILURE, RUNNING = NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.RUNNING


def make(body: str, *node_classes: type[TreeNode]) -> Tree:
    return make_steps(body, extra=node_classes)[0]


def test_an_action_a_condition_and_a_decorator_are_a_function_each() -> None:
    def double(node: SimpleAction) -> NodeStatus:
        """Write twice the input."""
        node.set_output('out', 2 * node.get_input('in'))
        return SUCCESS

    def is_ten(node: Condition) -> bool:
        return bool(node.get_input('in') == 10)

    def until_ten(status: NodeStatus, node: SimpleDecorator) -> NodeStatus:
        return RUNNING if status is FAILURE else status

    ports = {'in': input_port(INT), 'out': output_port(INT)}
    classes = {
        'Double': simple_action(double, ports),
        'IsTen': simple_condition(is_ten, {'in': ports['in']}),
        'UntilTen': simple_decorator(until_ten),
    }
    assert classes['Double'].__doc__ == 'Write twice the input.'
    told = {(one.__name__, one.__module__) for one in classes.values()}
    assert told == {(name, __name__) for name in ('double', 'is_ten', 'until_ten')}
    assert simple_condition(partial(is_ten)).__name__ == 'partial'  # which has no name
    for name, node_class in classes.items():
        node_class.__name__ = name
    body = '<UntilTen><Sequence><Double in="{x}" out="{y}"/><IsTen in="{y}"/></Sequence></UntilTen>'
    tree = make(body, *classes.values())
    tree.blackboard.set('x', 4)
    assert tree.tick_once() is RUNNING
    tree.blackboard.set('x', 5)
    assert tree.tick_once() is SUCCESS


def named(name: str, node_class: type[TreeNode]) -> type[TreeNode]:
    node_class.__name__ = name
    return node_class


@pytest.mark.parametrize(
    ('result', 'status'), [(True, SUCCESS), (False, FAILURE), (SUCCESS, SUCCESS), (FAILURE, FAILURE)]
)
def test_a_condition_may_give_a_truth_or_a_status(result: Any, status: NodeStatus) -> None:
    assert make('<Own/>', named('Own', simple_condition(lambda _: result))).tick_once() is status


@pytest.mark.parametrize('result', [RUNNING, None, True, NodeStatus.IDLE])
def test_a_function_that_gives_nonsense_is_an_error_of_its_node(result: Any) -> None:
    tree = make('<Own name="own"/>', named('Own', simple_action(lambda _: result)))
    with pytest.raises(NodeExecutionError, match=r'\[own\]'):
        tree.tick_once()


def test_a_function_that_raises_is_an_error_of_its_node() -> None:
    def broken(*_: Any) -> NodeStatus:
        raise OSError('broken')

    for node_class, child in (
        (simple_action(broken), ''),
        (simple_condition(broken), ''),
        (simple_decorator(broken), '<AlwaysSuccess/>'),
    ):
        tree = make(f'<Own name="own">{child}</Own>', named('Own', node_class))
        with pytest.raises(NodeExecutionError, match=r'\[own\] \(Own\): OSError: broken'):
            tree.tick_once()


def test_a_decorator_that_ends_while_its_child_runs_halts_it() -> None:
    tree, calls = make_steps(
        f'<Own>{step("R")}</Own>', extra=(named('Own', simple_decorator(lambda status, node: SUCCESS)),)
    )
    assert tree.tick_once() is SUCCESS
    assert calls == ['0R', '0!']
    assert all(node.status is NodeStatus.IDLE for node in tree.nodes)


def test_a_decorator_that_runs_with_its_child_leaves_it_alone() -> None:
    own = named('Own', simple_decorator(lambda status, node: status))
    tree, calls = make_steps(f'<Own>{step("RRS")}</Own>', extra=(own,))
    assert [tree.tick_once() for _ in range(3)] == [RUNNING, RUNNING, SUCCESS]
    assert calls == ['0R', '0R', '0S']


def test_why_a_decorator_of_a_function_failed() -> None:
    for script, path in (('S', 'own'), ('F', 'F_0')):
        tree = make(
            f'<Own name="own">{step(script)}</Own>', named('Own', simple_decorator(lambda status, node: FAILURE))
        )
        assert tree.tick_once() is FAILURE
        assert tree.failure is not None
        assert tree.failure.path == path
