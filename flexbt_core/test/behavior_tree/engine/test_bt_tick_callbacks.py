# SPDX-License-Identifier: BSD-3-Clause
"""Pre- and post-tick callbacks: no trace of those that return None, replaced results, order, halting, cost unused."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.parents import ControlNode
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeLibrary
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, NodeExecutionError, TickAbandoned
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_testing.behavior_trees.random_trees import wheel_case
from flexbt_testing.behavior_trees.scripted_nodes import Act, Cond, Deco, Run, Script, Sync, registry
from flexbt_testing.waiting import DEADLINE

S, F, R, K, I = (  # noqa: E741
    NodeStatus.SUCCESS,
    NodeStatus.FAILURE,
    NodeStatus.RUNNING,
    NodeStatus.SKIPPED,
    NodeStatus.IDLE,
)
Events = list[Any]


def build(body: str, events: Events | None = None, more: str = '') -> Tree:
    """Return a tree of scripted leaves."""
    told: Events = [] if events is None else events
    xml = f'<root BTCPP_format="4" main_tree_to_execute="T"><BehaviorTree ID="T">{body}</BehaviorTree>{more}</root>'
    tree = Tree(TreeLibrary([load_xml(xml, 'callbacks.xml', registry())]), 'T', clock=ManualClock())
    for node, definition in zip(tree.nodes, tree.definitions, strict=True):
        if isinstance(node, Act | Sync | Cond | Deco):
            node.script = Script(node, definition.extra, told)
    return tree


def named(tree: Tree, name: str) -> TreeNode:
    return next(node for node in tree.nodes if node.name == name)


class CallbackRun(Run):
    """Sets callbacks before, and removes them between, steps of a scripted case."""

    def __init__(self, case: Mapping[str, Any], set_callbacks: Callable[[Tree], None], *, observed: bool) -> None:
        super().__init__(case, observed=observed)
        self._set_callbacks = set_callbacks

    def _step(self, tree: Tree, op: list[Any]) -> dict[str, Any]:
        self._set_callbacks(tree)
        return super()._step(tree, op)


@pytest.mark.parametrize('observed', [True, False])
def test_callbacks_that_return_none_change_nothing(observed: bool) -> None:
    """Whenever they come and go, on whatever nodes: the trace is the same. And each sees every tick of its node."""
    seen = 0
    for seed in range(400):
        chance = random.Random(seed)
        case = wheel_case(seed)

        def come_and_go(tree: Tree, chance: random.Random = chance) -> None:
            nonlocal seen
            for node in tree.nodes:
                choice = chance.random()
                if choice < 0.3:
                    tree.callbacks.set_pre_tick(node, before)
                    tree.callbacks.set_post_tick(node, after)
                elif choice < 0.6:
                    tree.callbacks.set_pre_tick(node, None)
                    tree.callbacks.set_post_tick(node, None)
            if chance.random() < 0.2:
                tree.callbacks.clear()

        def before(node: TreeNode) -> NodeStatus:
            nonlocal seen
            seen += 1
            assert node.status in (I, R, K)
            return K

        def after(node: TreeNode, status: NodeStatus) -> NodeStatus:
            nonlocal seen
            seen += 1
            assert status is K or node.status is status
            return status

        plain = Run(case, observed=observed).trace()
        assert CallbackRun(case, come_and_go, observed=observed).trace() == plain, case['xml']
    assert seen > 5_000


def test_a_replaced_node_is_as_one_of_the_engine_in_its_place() -> None:
    """Everybody else in the tree sees what they would see of an AlwaysSuccess or AlwaysFailure with its conditions."""
    compared = 0
    for seed in range(400):
        case = wheel_case(seed)
        chance = random.Random(seed)
        result, stand_in = chance.choice([(S, 'AlwaysSuccess'), (F, 'AlwaysFailure')])
        choice = chance.random()
        called_back = ticks(case, pre_tick=(choice, result))
        if called_back is not None:
            assert called_back == ticks(case, stand_in=(choice, stand_in)), case['xml']
            compared += 1
    assert compared > 200


def ticks(
    case: Mapping[str, Any],
    *,
    pre_tick: tuple[float, NodeStatus] | None = None,
    stand_in: tuple[float, str] | None = None,
) -> list[Any] | None:
    """Return the results, and what the other leaves did, in some ticks of a tree in which one node is replaced.

    None when the case cannot tell: it is refused, or the node is a sub-tree, whose scope is not that of the stand-in.
    """
    nodes = registry()
    told: Events = []
    try:
        document = load_xml(case['xml'], 'case.xml', nodes)
        library = TreeLibrary([document])
        tree = Tree(library, document.main or '')
    except BehaviorTreeError:
        return None
    index = int((pre_tick or stand_in or (0.0,))[0] * len(tree.nodes))
    if tree.definitions[index].tree_id is not None:
        return None
    count = -1

    def substitute(definition: NodeDefinition, path: str) -> NodeDefinition:
        nonlocal count
        count += 1
        made = None if stand_in is None or count != index else nodes.get(stand_in[1])
        return definition if made is None else definition._replace(manifest=made, values={}, children=())

    board = Blackboard()
    for key, value in case.get('bb', {}).items():
        board.set(key, value)
    tree = Tree(library, document.main or '', blackboard=board, clock=ManualClock(), substitute=substitute)
    for node, definition in zip(tree.nodes, tree.definitions, strict=True):
        if isinstance(node, Act | Sync | Cond | Deco):
            node.script = Script(node, definition.extra, told)
    if pre_tick is not None:
        result = pre_tick[1]
        tree.callbacks.set_pre_tick(tree.nodes[index], lambda node: result)
    results: list[Any] = []
    for _ in range(6):
        try:
            results.append(tree.tick_exactly_once())
        except NodeExecutionError as error:
            results.append(error.node_path.split('::')[0])
            break
    # Paths have the uid of nodes without a name, and those that follow have other ones.
    return [*results, *([event[0], event[1].rpartition('/')[2].split('::')[0], *event[2:]] for event in told)]


def test_a_result_that_is_replaced_afterwards_is_what_the_parent_gets() -> None:
    events: Events = []
    tree = build('<Fallback><Cond name="a" _script="F"/><Cond name="b"/></Fallback>', events)
    seen = []

    def turn(node: TreeNode, status: NodeStatus) -> NodeStatus:
        seen.append((node.name, status))
        return S if status is F else F

    tree.callbacks.set_post_tick(named(tree, 'a'), turn)
    assert tree.tick_once() is S
    assert seen == [('a', F)]
    assert [event[1] for event in events] == ['a']


def test_callbacks_come_after_pre_conditions_and_post_conditions() -> None:
    order: list[str] = []
    tree = build('<Sequence><Sync name="a" _skipIf="skip" _onSuccess="x := x + 1"/></Sequence>')
    tree.blackboard.set('skip', False)
    tree.blackboard.set('x', 0)

    def before(node: TreeNode) -> NodeStatus:
        order.append(f'before {tree.blackboard.get("x")}')
        return S

    def after(node: TreeNode, status: NodeStatus) -> NodeStatus:
        order.append(f'after {status.name} {tree.blackboard.get("x")}')
        return status

    node = named(tree, 'a')
    tree.callbacks.set_pre_tick(node, before)
    tree.callbacks.set_post_tick(node, after)
    assert tree.tick_once() is S
    assert order == ['before 0', 'after SUCCESS 1']
    order.clear()
    tree.blackboard.set('skip', True)
    tree.tick_once()
    assert order == ['after SKIPPED 1']


@pytest.mark.parametrize('place', ['before', 'after'])
def test_a_running_node_is_halted_before_its_result_is_replaced(place: str) -> None:
    events: Events = []
    tree = build('<Sequence><Sequence name="inner"><Act name="a" _script="R"/></Sequence></Sequence>', events)
    assert tree.tick_once() is R
    inner = named(tree, 'inner')
    if place == 'before':
        tree.callbacks.set_pre_tick(inner, lambda node: S)
    else:
        tree.callbacks.set_post_tick(inner, lambda node, status: S)
    events.clear()
    assert tree.tick_once() is S
    assert ['halt', 'a'] in events
    assert named(tree, 'a').status is I


def test_a_callback_may_set_others_for_the_rest_of_its_tick() -> None:
    tree = build('<Sequence><Cond name="a"/><Cond name="b"/><Cond name="c"/></Sequence>')
    reached: list[str] = []

    def step(node: TreeNode) -> NodeStatus:
        reached.append(node.name)
        tree.callbacks.set_pre_tick(node, None)
        following = tree.nodes.index(node) + 1
        if following < len(tree.nodes):
            tree.callbacks.set_pre_tick(tree.nodes[following], step)
        return K

    tree.callbacks.set_pre_tick(named(tree, 'a'), step)
    assert tree.tick_once() is S
    assert reached == ['a', 'b', 'c']


def test_the_tick_that_a_callback_abandons_begins_nothing_more() -> None:
    events: Events = []
    tree = build('<Parallel><Act name="a" _script="R"/><Deco><Cond name="b"/></Deco><Act name="c"/></Parallel>', events)
    arrived = threading.Event()
    released = threading.Event()
    tree.callbacks.on_release = released.set

    def wait(node: TreeNode) -> NodeStatus:
        arrived.set()
        assert released.wait(60.0)
        assert tree.callbacks.released
        raise TickAbandoned(node.path, node.id, 'stopped')

    tree.callbacks.set_pre_tick(named(tree, 'b'), wait)
    raised: list[BaseException] = []

    def tick() -> None:
        try:
            tree.tick_once()
        except TickAbandoned as error:
            raised.append(error)

    thread = threading.Thread(target=tick)
    thread.start()
    assert arrived.wait(60.0)
    tree.callbacks.release()
    thread.join(DEADLINE)
    assert len(raised) == 1
    assert [event[1] for event in events if event[0] == 'call'] == ['a']
    tree.halt()
    assert ['halt', 'a'] in events
    assert {node.status for node in tree.nodes} == {I}


def test_a_node_that_was_skipped_and_is_ticked_again_calls_its_callback_again() -> None:
    tree = build('<Parallel><Sync name="a" _script="K"/><Act name="b" _script="R"/></Parallel>')
    seen: list[str] = []

    def note(node: TreeNode) -> NodeStatus:
        seen.append(node.name)
        return R

    tree.callbacks.set_pre_tick(named(tree, 'a'), note)
    for _ in range(2):
        assert tree.tick_once() is R
    assert seen == ['a', 'a']


def test_what_a_callback_raises_is_an_error_of_its_node() -> None:
    tree = build('<Sequence><Cond name="a"/></Sequence>')
    tree.callbacks.set_pre_tick(named(tree, 'a'), lambda node: NodeStatus(1 // 0))
    with pytest.raises(NodeExecutionError, match=r'\[a\].*ZeroDivisionError') as caught:
        tree.tick_once()
    assert caught.value.node_path == 'a'


def test_a_tree_without_callbacks_is_ticked_as_if_there_were_none() -> None:
    """Also after there were some: parents have the plain callables again."""
    tree = build('<Sequence><Cond name="a"/><Sync name="b" _skipIf="false"/></Sequence>')
    root = tree.root
    assert isinstance(root, ControlNode)
    tree.tick_once()
    plain = root._ticks[0]
    tree.callbacks.set_pre_tick(root, lambda node: K)
    tree.tick_once()
    assert root._ticks[0] != plain
    tree.callbacks.set_pre_tick(root, None)
    tree.tick_once()
    assert root._ticks[0] == plain == root.children[0].execute
    assert 'ask_and_execute' not in repr(root._ticks)


def test_a_deep_tree_has_room_for_callbacks() -> None:
    depth, trees = 200, 25
    more = ''
    for number in range(trees):
        inner = f'<SubTree ID="D{number + 1}"/>' if number + 1 < trees else '<AlwaysSuccess/>'
        more += f'<BehaviorTree ID="D{number}">{"<Inverter>" * depth}{inner}{"</Inverter>" * depth}</BehaviorTree>'
    tree = build('<SubTree ID="D0"/>', more=more)
    count = 0

    def before(node: TreeNode) -> NodeStatus:
        nonlocal count
        count += 1
        return K

    for node in tree.nodes:
        tree.callbacks.set_pre_tick(node, before)
        tree.callbacks.set_post_tick(node, lambda node, status: status)
    assert tree.tick_once() is S
    assert count == len(tree.nodes) == depth * trees + trees + 1


def test_each_owner_has_a_callback_of_its_own_and_the_first_result_counts() -> None:
    tree = build('<Sequence><AlwaysSuccess name="a"/></Sequence>')
    node = named(tree, 'a')
    told: list[str] = []

    def teller(name: str, result: NodeStatus) -> Callable[[TreeNode], NodeStatus]:
        def tell(node: TreeNode) -> NodeStatus:
            told.append(name)
            return result

        return tell

    for name, result in (('one', K), ('two', F), ('three', S)):
        tree.callbacks.set_pre_tick(node, teller(name, result), name)
    assert tree.tick_exactly_once() is F and told == ['one', 'two']
    told.clear()
    tree.callbacks.set_pre_tick(node, None, 'two')
    tree.callbacks.set_pre_tick(node, None, 'nobody')
    assert tree.tick_exactly_once() is S and told == ['one', 'three']
    tree.callbacks.set_pre_tick(node, None, 'one')
    assert tree.callbacks.active
    tree.callbacks.set_pre_tick(node, None, 'three')
    assert not tree.callbacks.active
