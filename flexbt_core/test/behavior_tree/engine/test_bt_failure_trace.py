# SPDX-License-Identifier: BSD-3-Clause
"""Why a tree failed, from the node at fault up to the root: for every node, and for random trees."""

from __future__ import annotations

from typing import Any

import pytest

from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, FailureStep, FailureTrace, NodeExecutionError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_testing.behavior_trees import scripted_nodes as bt_scripted
from flexbt_testing.behavior_trees.random_trees import script_case, wheel_case
from flexbt_testing.behavior_trees.steps import control, make, step

F0, F1, F2 = (f'F_{number}: Step returned FAILURE' for number in range(3))


def decorator(tag: str, script: str = 'F', **ports: str) -> str:
    given = ''.join(f' {name}="{value}"' for name, value in ports.items())
    return f'<{tag} name="top"{given}>{step(script)}</{tag}>'


@pytest.mark.parametrize(
    ('body', 'expected'),
    [
        (control('Sequence', 'S', 'F', 'S'), [F1, 'top: Sequence: child 2 of 3 failed']),
        (control('ReactiveSequence', 'F', 'S'), [F0, 'top: ReactiveSequence: child 1 of 2 failed']),
        (control('AsyncSequence', 'F', 'S'), [F0, 'top: AsyncSequence: child 1 of 2 failed']),
        (control('SequenceWithMemory', 'F'), [F0, 'top: SequenceWithMemory: child 1 of 1 failed']),
        (
            control('Fallback', 'F', 'F'),
            [F1, 'top: Fallback: none of 2 children succeeded'],
        ),
        # One that was skipped is not to blame.
        (control('Fallback', 'K', 'F', 'K'), [F1, 'top: Fallback: none of 3 children succeeded']),
        (control('ReactiveFallback', 'F', 'K'), [F0, 'top: ReactiveFallback: none of 2 children succeeded']),
        (control('AsyncFallback', 'F', 'K'), [F0, 'top: AsyncFallback: none of 2 children succeeded']),
        (
            control('Parallel', 'F', 'S', 'F', success_count='2', failure_count='2'),
            [F2, 'top: Parallel: 2 of 3 children failed (success_count="2", failure_count="2")'],
        ),
        (
            control('ParallelAll', 'F', 'S', 'F', max_failures='1'),
            [F2, 'top: ParallelAll: 2 of 3 children failed (max_failures="1")'],
        ),
        (
            control('IfThenElse', 'S', 'F'),
            [F1, 'top: IfThenElse: child 2 of 2 failed'],
        ),
        (control('WhileDoElse', 'F', 'S'), [F0, 'top: WhileDoElse: child 1 of 2 failed']),
        (control('Switch2', 'S', 'F', 'S', variable='x', case_2='x'),
         [F1, 'top: Switch2: child 2 of 3 failed']),
        (control('TryCatch', 'F', 'S'), [F0, 'top: TryCatch: child 1 of 2 failed; [S_1] has cleaned up']),
        (decorator('Inverter', 'S'), ['top: Inverter: the child [S_0] succeeded']),
        (decorator('ForceFailure'), ['top: ForceFailure: the child [F_0] completed']),
        (decorator('Repeat', 'SSF', num_cycles='5'),
         ['SSF_0: Step returned FAILURE', 'top: Repeat: cycle 3 failed (num_cycles="5")']),
        (
            decorator('RetryUntilSuccessful', num_attempts='3'),
            [F0, 'top: RetryUntilSuccessful: all 3 attempts failed (num_attempts="3")'],
        ),
        (
            decorator('RetryUntilSuccessful', num_attempts='1'),
            [F0, 'top: RetryUntilSuccessful: the attempt failed (num_attempts="1")'],
        ),
        (
            decorator('RetryUntilSuccessful', num_attempts='0'),
            ['top: RetryUntilSuccessful: no attempt is allowed (num_attempts="0")'],
        ),
        (decorator('KeepRunningUntilFailure'), [F0, 'top: KeepRunningUntilFailure: the child failed']),
        (decorator('RunOnce'), [F0, 'top: RunOnce: the child failed in its one run']),
        (decorator('Timeout', msec='1000'), [F0, 'top: Timeout: the child failed']),
        (decorator('Delay', delay_msec='0'), [F0, 'top: Delay: the child failed']),
        (decorator('Precondition', **{'if': '1 > 3'}), ['top: Precondition: [1 > 3] does not hold']),
        (decorator('Precondition', **{'if': 'true'}), [F0, 'top: Precondition: the child failed']),
        (decorator('LoopInt', queue='1;2', value='{v}'), [F0, 'top: LoopInt: the child failed']),
        (
            decorator('LoopInt', queue='', value='{v}', if_empty='FAILURE'),
            ['top: LoopInt: the queue is empty (if_empty="FAILURE")'],
        ),
        ('<ScriptCondition name="top" code="1 > 3"/>', ['top: ScriptCondition: [1 > 3] does not hold']),
        ('<WasEntryUpdated name="top" entry="{x}"/>',
         ['top: WasEntryUpdated: entry [x] was not written since the last tick']),
        ('<SetBlackboard name="top" value="{x}" output_key="y"/>',
         ['top: the entry [x] that is to be copied was never written']),
        ('<InitialPoseReceived name="top"/>', ['top: no first pose of the robot was received']),
        ('<AreErrorCodesPresent name="top" error_codes_to_check="9;7"/>', ['top: error code 0 is none of [7, 9]']),
        ('<AlwaysSuccess name="top" _failureIf="3 > 1"/>', ['top: AlwaysSuccess: [3 > 1] of _failureIf holds']),
        (
            f'<Sequence name="top"><Sequence name="in" _failureIf="true">{step("F")}</Sequence></Sequence>',
            ['in: Sequence: [true] of _failureIf holds', 'top: Sequence: child 1 of 1 failed'],
        ),
        # Nav2
        (control('RecoveryNode', 'F', 'S', number_of_retries='1'),
         [F0, 'top: RecoveryNode: no recovery was left (number_of_retries="1")']),
        (control('RecoveryNode', 'F', 'F', number_of_retries='1'),
         [F0, 'top: RecoveryNode: the recovery failed (number_of_retries="1")']),
        (control('RecoveryNode', 'F', 'S', number_of_retries='-1'),
         ['top: RecoveryNode: no attempt is allowed (number_of_retries="-1")']),
        (control('RoundRobin', 'F', 'F'), [F1, 'top: RoundRobin: none of 2 children succeeded']),
        (control('PipelineSequence', 'S', 'F'), [F1, 'top: PipelineSequence: child 2 of 2 failed']),
        (decorator('RateController', hz='1'), [F0, 'top: RateController: the child failed']),
        (decorator('SingleTrigger'), [F0, 'top: SingleTrigger: the child failed']),
        (
            f'<PipelineSequence name="top"><SingleTrigger name="once">{step("S")}</SingleTrigger>{step("R", 1)}'
            '</PipelineSequence>',
            ['once: SingleTrigger: the child [S_0] had its one run before',
             'top: PipelineSequence: child 1 of 2 failed'],
        ),
    ],
)  # fmt: skip
def test_each_node_tells_its_part(body: str, expected: list[str]) -> None:
    tree, _ = make(body)
    for _ in range(20):
        if tree.tick_once() is NodeStatus.FAILURE:
            break
    assert tree.failure is not None
    assert tree.failure.lines() == expected
    assert tree.failure.chain == tuple(line.partition(':')[0] for line in reversed(expected))


def test_a_timeout_tells_which_time() -> None:
    clock = ManualClock()
    body = f'<Sequence name="top"><Timeout name="limit" msec="500">{step("R")}</Timeout></Sequence>'
    tree, _ = make(body, clock=clock)
    tree.tick_once()
    clock.advance(0.5)
    assert tree.tick_once() is NodeStatus.FAILURE
    assert tree.failure is not None
    assert tree.failure.lines() == [
        'limit: Timeout: the time is up for the child [R_0] (msec="500")',
        'top: Sequence: child 1 of 1 failed',
    ]


def test_a_failure_is_told_until_the_next_tick() -> None:
    tree, _ = make(step('FRFS'))
    told = []
    for _ in range(4):
        tree.tick_once()
        told.append(tree.failure is not None)
    assert told == [True, False, True, False]
    tree, _ = make(step('F'))
    tree.tick_once()
    tree.halt()
    assert tree.failure is None


@pytest.mark.parametrize('before', [True, False])
@pytest.mark.parametrize('conditions', ['', ' _skipIf="false"'])
def test_a_hook_that_has_given_the_result_is_named(before: bool, conditions: str) -> None:
    tree, _ = make(
        f'<Sequence name="top"><Fallback name="in"{conditions}>{step("F")}{step("S", 1)}</Fallback></Sequence>'
    )
    inner = tree.nodes[1]
    assert tree.tick_once() is NodeStatus.SUCCESS
    if before:
        tree.callbacks.set_pre_tick(inner, lambda node: NodeStatus.FAILURE)
    else:
        tree.callbacks.set_post_tick(inner, lambda node, status: NodeStatus.FAILURE)
    for _ in range(2):
        assert tree.tick_once() is NodeStatus.FAILURE
        assert tree.failure is not None
        assert tree.failure.lines() == ['in: Fallback: a callback gave FAILURE', 'top: Sequence: child 1 of 1 failed']
    tree.callbacks.set_pre_tick(inner, None)
    tree.callbacks.set_post_tick(inner, None)
    tree.callbacks.set_post_tick(tree.root, lambda node, status: NodeStatus.RUNNING)  # which replaces nothing
    tree.callbacks.set_pre_tick(tree.nodes[3], lambda node: NodeStatus.FAILURE)
    assert tree.tick_once() is NodeStatus.FAILURE
    assert tree.failure is not None
    assert tree.failure.lines()[0] == 'S_1: Step: a callback gave FAILURE'


def test_of_very_many_reasons_those_in_the_middle_are_left_out() -> None:
    trace = FailureTrace(tuple(FailureStep(str(number), 'failed') for number in range(1000)))
    lines = trace.lines(10)
    assert len(lines) == 10
    assert [line.partition(':')[0] for line in lines] == [
        '0', '1', '2', '3', '4', '(991 nodes in between)', '996', '997', '998', '999'
    ]  # fmt: skip
    assert len(trace.lines(1000)) == 1000


SUBTREES = """<root BTCPP_format="4" main_tree_to_execute="Main">
<BehaviorTree ID="Main"><Sequence name="all"><AlwaysSuccess/><SubTree ID="Outer" name="out"/></Sequence></BehaviorTree>
<BehaviorTree ID="Outer"><RetryUntilSuccessful num_attempts="2" name="retry"><SubTree ID="Inner" name="in"/>
</RetryUntilSuccessful></BehaviorTree>
<BehaviorTree ID="Inner"><Parallel name="both"><AlwaysSuccess name="x"/>{leaf}</Parallel></BehaviorTree></root>"""
ABOVE = [
    'out/in/both: Parallel: in child 2 of 2',
    'out/in: Inner: in the child',
    'out/retry: RetryUntilSuccessful: in the child',
    'out: Outer: in the child',
    'all: Sequence: in child 2 of 2',
]


@pytest.mark.parametrize(
    ('leaf', 'reason'),
    [
        ('<Bad name="x"/>', 'ZeroDivisionError: no luck'),
        ('<Script name="x" code="y := z"/>', 'ScriptError: '),
        ('<Sleep name="x" msec="{none}"/>', 'PortError: port [msec] (blackboard key [none]) of Sleep at [out/in/x]'),
    ],
)
def test_an_error_within_sub_trees_has_the_way_to_the_root(leaf: str, reason: str) -> None:
    from flexbt_core.behavior_tree.engine.leaf import SyncAction
    from flexbt_core.behavior_tree.nodes.builtin import builtin_registry

    class Bad(SyncAction):
        def tick(self) -> NodeStatus:
            raise ZeroDivisionError('no luck')

    registry = builtin_registry()
    registry.register('Bad', Bad)
    text = SUBTREES.format(leaf=leaf) if '{none}' not in leaf else SUBTREES.replace('{leaf}', leaf)
    tree = Tree(TreeLibrary([load_xml(text, 'f.xml', registry)]), 'Main')
    with pytest.raises(NodeExecutionError) as raised:
        tree.tick_once()
    error = raised.value
    # Another leaf has the same path: it is not mistaken for the one that raised.
    assert (error.node_path, error.uid) == ('out/in/x', 8)
    first, *others = error.trace.lines()
    assert first.startswith(f'out/in/x: {reason}')
    assert others == ABOVE
    assert tree.failure is None


def test_an_error_of_a_halt_has_it_too() -> None:
    from flexbt_core.behavior_tree.engine.leaf import StatefulAction
    from flexbt_core.behavior_tree.nodes.builtin import builtin_registry

    class Bad(StatefulAction):
        def on_start(self) -> NodeStatus:
            return NodeStatus.RUNNING

        def on_running(self) -> NodeStatus:
            return NodeStatus.RUNNING

        def on_halted(self) -> None:
            raise OSError('the brake is stuck')

    registry = builtin_registry()
    registry.register('Bad', Bad)
    tree = Tree(TreeLibrary([load_xml(SUBTREES.format(leaf='<Bad name="x"/>'), 'f.xml', registry)]), 'Main')
    assert tree.tick_once() is NodeStatus.RUNNING
    with pytest.raises(NodeExecutionError) as raised:
        tree.halt()
    assert raised.value.trace.lines() == ['out/in/x: OSError: the brake is stuck', *ABOVE]


def scripted(case: dict[str, Any]) -> Tree | None:
    board = Blackboard()
    for key, value in case.get('bb', {}).items():
        board.set(key, value)
    try:
        library = TreeLibrary([load_xml(case['xml'], 'case.xml', bt_scripted.registry())])
        main = library.documents['case.xml'].main
        tree = Tree(library, main or '', blackboard=board, clock=ManualClock())
    except (BehaviorTreeError, LookupError):
        return None
    for node, definition in zip(tree.nodes, tree.definitions, strict=True):
        if isinstance(node, bt_scripted.Act | bt_scripted.Sync | bt_scripted.Cond | bt_scripted.Deco):
            node.script = bt_scripted.Script(node, definition.extra, [])
    return tree


@pytest.mark.parametrize('make_case', [wheel_case, script_case])
def test_all_of_a_chain_have_failed_and_each_is_the_child_of_the_next(make_case: Any) -> None:
    """Who is blamed has failed, as an observer sees it, and the chain follows the structure of the tree."""
    failures = lengths = 0
    for seed in range(500):
        case = make_case(seed)
        tree = None if '_failureIf' in case['xml'] else scripted(case)  # it fails, and its status stays
        if tree is None:
            continue
        parents = {child.uid: node for node in tree.nodes for child in node.attached}
        results: dict[int, NodeStatus] = {}

        def note(node: TreeNode, before: NodeStatus, after: NodeStatus, results: Any = results) -> None:
            if after in (NodeStatus.SUCCESS, NodeStatus.FAILURE):
                results[node.uid] = after

        tree.observe(note)
        try:
            for _ in range(12):
                status = tree.tick_exactly_once()
                if status is not NodeStatus.FAILURE:
                    assert tree.failure is None
                    if status is not NodeStatus.RUNNING:
                        results.clear()
                    continue
                failures += 1
                nodes = [tree.root]
                while (cause := nodes[-1].failure_cause()) is not None:
                    assert parents[cause.uid] is nodes[-1]
                    nodes.append(cause)
                # Below a RunOnce that gives its result again nothing happened this time. A child that an IfThenElse has
                # left as it was changes no more when it fails again.
                once = next((index for index, node in enumerate(nodes, 1) if node.id == 'RunOnce'), len(nodes))
                assert [results.get(node.uid, node.status) for node in nodes[:once]] == [NodeStatus.FAILURE] * once, (
                    nodes
                )
                assert tree.failure is not None
                assert tree.failure.chain == tuple(node.path for node in nodes)
                assert all(step.reason for step in tree.failure.steps)
                lengths = max(lengths, len(nodes))
                results.clear()
        except BehaviorTreeError:
            continue
    assert failures > 150
    assert lengths > 5
