# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that raise anything or return anything: the tree names them, and can be halted and used again."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from flexbt_core.behavior_tree.engine.leaf import Condition
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_testing.behavior_trees import faulty_leaves as bt_faulty_leaves

BODIES = [
    '<RaisesInTick kind="{kind}"/>',
    '<RaisesInCondition kind="{kind}"/>',
    '<RaisesInStart kind="{kind}"/>',
    '<RaisesWhileRunning kind="{kind}"/>',
    '<RaisesInThread kind="{kind}"/>',
    '<RaisesInCoroutine kind="{kind}"/>',
    '<RaisesInDecorator kind="{kind}"><AlwaysSuccess/></RaisesInDecorator>',
    '<Parallel failure_count="1"><RaisesInHalt kind="{kind}"/><AlwaysFailure/></Parallel>',
]


def make_tree(body: str) -> Tree:
    registry: NodeRegistry = builtin_registry()
    bt_faulty_leaves.register(registry)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main"><Inverter>{body}</Inverter></BehaviorTree></root>'
    return Tree(TreeLibrary([load_xml(text, 'file.xml', registry)]), 'Main', clock=ManualClock())


def run(tree: Tree) -> None:
    """Tick until it ends. The ticks of a tree that waits for a thread come when that is over."""
    woken = threading.Event()
    tree.context.on_wake = woken.set
    while tree.tick_once() is NodeStatus.RUNNING:
        woken.wait(0.1)


def within_a_thread(work: Callable[[], None]) -> BaseException | None:
    """Return what ``work`` raises in a thread that is not the main one."""
    raised: list[BaseException] = []

    def catch() -> None:
        try:
            work()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=catch)
    thread.start()
    thread.join()
    return raised[0] if raised else None


@pytest.fixture(autouse=True)
def other_tests_count_their_own_work() -> Iterator[None]:
    """Of leaves that raise here, the count of what goes on is left as it may be."""
    yield
    for thread in threading.enumerate():
        if thread.name.startswith('leaf '):
            thread.join(10.0)
    bt_faulty_leaves.Work._running.clear()


@pytest.mark.parametrize('kind', bt_faulty_leaves.FAULTS)
@pytest.mark.parametrize('body', BODIES, ids=lambda body: body[1:].split()[0] if body[1] == 'R' else 'RaisesInHalt')
def test_whatever_a_node_raises_is_an_error_that_names_it(body: str, kind: str) -> None:
    tree = make_tree(body.replace('{kind}', kind))
    for _ in range(2):  # and once more, after the halt
        error = within_a_thread(lambda: run(tree))
        assert isinstance(error, NodeExecutionError), error
        assert error.node_id.startswith('RaisesIn') or error.node_id == 'RaisesWhileRunning'
        assert error.node_path == f'{error.node_id}::{error.node_path.rpartition("::")[2]}'
        assert isinstance(error.cause, BaseException) and error.__cause__ is error.cause
        assert kind in str(error) or kind == 'ExceptionGroup'
        tree.halt()
        assert all(node.status is NodeStatus.IDLE for node in tree.nodes)
        assert not tree.unfinished


@pytest.mark.parametrize('body', [body for body in BODIES if 'Thread' not in body])
def test_what_the_user_presses_on_the_main_thread_is_not_taken_for_a_fault_of_a_node(body: str) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(make_tree(body.replace('{kind}', 'KeyboardInterrupt')))


def test_nodes_whose_constructors_raise_are_told_with_their_places() -> None:
    class Unready(Condition):
        def __init__(self, config: NodeConfig) -> None:
            super().__init__(config)
            raise KeyError('arm')

        def tick(self) -> NodeStatus:
            return NodeStatus.SUCCESS

    registry = builtin_registry()
    registry.register_class(Unready)
    body = '<Fallback><Unready name="u"/>\n<Unready/></Fallback>'
    text = f'<root BTCPP_format="4"><BehaviorTree>\n{body}</BehaviorTree></root>'
    library = TreeLibrary([load_xml(text, 'file.xml', registry)])
    with pytest.raises(TreeLoadError) as caught:
        Tree(library, 'BehaviorTree_0', clock=ManualClock())
    assert str(caught.value).split('\n') == [
        "file.xml:2:11: <Unready 'u'>: Unready cannot be made: KeyError: 'arm'",
        "file.xml:3:1: <Unready>: Unready cannot be made: KeyError: 'arm'",
    ]


@pytest.mark.parametrize('leaf', ['Returns', 'ReturnsFromStart'])
@pytest.mark.parametrize('what', bt_faulty_leaves.NONSENSE)
def test_what_is_no_status_is_an_error_of_the_node(leaf: str, what: str) -> None:
    tree = make_tree(f'<{leaf} what="{what}"/>')
    with pytest.raises(NodeExecutionError) as caught:
        run(tree)
    assert caught.value.node_path == f'{leaf}::2'
    if what != 'unprintable':
        assert what in str(caught.value) or what == 'class'


def test_a_machine_without_threads_is_an_error_of_the_node_and_no_work_that_never_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(self: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    tree = make_tree('<InThread/>')
    monkeypatch.setattr(threading.Thread, 'start', refuse)
    with pytest.raises(NodeExecutionError, match='new thread') as caught:
        tree.tick_once()
    assert caught.value.node_id == 'InThread'
    tree.halt()
    assert not tree.unfinished
    monkeypatch.undo()
    assert tree.tick_once() is NodeStatus.RUNNING
    tree.halt()
